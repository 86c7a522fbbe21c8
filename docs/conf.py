"""Sphinx: `make docs` builds these pages, the gallery and the docstrings."""

import sys
from importlib.metadata import files
from pathlib import Path

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE / "site"))

project, author = "grainloops", "The grainloops authors"
extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.mathjax",
    "numpydoc",
    "equations",
    "gallery",
]
exclude_patterns = ["figures", "site"]
html_theme = "furo"
html_title = "grainloops"
html_show_copyright = False
html_static_path = ["site/style.css"]
html_css_files = ["style.css"]

myst_enable_extensions = ["dollarmath", "colon_fence"]
# Links to headings, also from page to page.
myst_heading_anchors = 4
numpydoc_show_class_members = False
# The docstrings tell the types.
autodoc_typehints = "none"
# One backtick in a docstring is code.
default_role = "code"
# A reference that leads nowhere is an error; bases of classes outside the site are none of ours.
nitpicky = True

# Formulas are set in the browser by a file of the site itself, all extensions in it: no page asks
# the network.
mathjax_path = "tex-svg-full.js"
mathjax3_config = {
    "options": {"enableMenu": False},
    "svg": {"fontCache": "global"},
}


def setup(app: object) -> None:
    """Find the file that sets formulas."""
    found = [f for f in files("sphinx-mathjax-offline") or () if f.name == "tex-svg-full.js"]
    html_static_path.append(str(found[0].locate()))
