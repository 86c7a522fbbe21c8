"""Sphinx: `make docs` builds these pages, the gallery and the docstrings."""

import sys
from importlib.metadata import files
from inspect import isclass
from pathlib import Path

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE / "site"))

from numbered import shown  # noqa: E402
from numpydoc.xref import DEFAULT_LINKS  # noqa: E402

project, author = "grainloops", "The grainloops authors"
extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.intersphinx",
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
# Local lists of the pages of other libraries that these link to: the site builds without a network.
INVENTORIES = {
    "matplotlib": "https://matplotlib.org/stable",
    "networkx": "https://networkx.org/documentation/stable",
    "numpy": "https://numpy.org/doc/stable",
    "pandas": "https://pandas.pydata.org/docs",
}
intersphinx_mapping = {
    name: (address, f"site/inventories/{name}.inv") for name, address in INVENTORIES.items()
}
# Types in docstrings that become links: the classes of the rooms and of these inventories. `Path`
# does not, for it is a file's or a loop's.
ROOMS = (
    *("stability.packing", "stability", "patterns", "loops.boundary", "loops.system"),
    *("loops.in_place", "loops", "grainloops"),
)
numpydoc_xref_param_type = True
numpydoc_xref_ignore = "all"
numpydoc_xref_aliases = {word: word for word in DEFAULT_LINKS} | {"ndarray": "numpy.ndarray"}
for room in ROOMS:
    for name, what in shown(room):
        if isclass(what) and name != "Path":
            numpydoc_xref_aliases[name] = f"{room}.{name}"
for _, inventory in intersphinx_mapping.values():
    for line in (HERE / inventory).read_text().splitlines()[3:]:
        numpydoc_xref_aliases[line.split()[0]] = f":obj:`{line.split()[0]}`"
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
