"""Sphinx: `make docs` builds these pages and the docstrings of the front door and the faces."""

project, author = "grainloops", "The grainloops authors"
extensions = ["myst_parser", "sphinx.ext.autodoc", "numpydoc"]
exclude_patterns = ["figures"]
# Links to headings, also from page to page.
myst_heading_anchors = 4
numpydoc_show_class_members = False
# The docstrings tell the types.
autodoc_typehints = "none"
