"""Equations with a number of their own, the code that computes them, and the way back.

    ```{equation} 4.3
    :paper: 47
    :code: loops.love_weber_stress
    LaTeX
    ```

sets (4.3), says that it is (47) in the paper, and links to the code; the reference of that
code links back, and a docstring's "Theory, equation (4.3)" becomes a link.
"""

from inspect import isclass
from typing import ClassVar

from docutils import nodes
from docutils.parsers.rst import directives
from numbered import CITED, NUMBER, equations, named, shown
from sphinx.directives.patches import MathDirective
from sphinx.domains.python import PythonDomain
from sphinx.util.docutils import SphinxDirective


class Equation(MathDirective):
    """A displayed equation under its own number, with its number in the paper and its code."""

    required_arguments, optional_arguments = 1, 0
    option_spec: ClassVar = {"paper": directives.unchanged, "code": directives.unchanged}

    def run(self):
        """The equation, and the line of its sources."""
        number = self.arguments.pop()
        self.options["label"] = f"eq-{number}"
        found = super().run()
        found[-1]["number"] = number
        self.env.domains["math"].equations[f"eq-{number}"] = (self.env.docname, number)
        said = []
        if "paper" in self.options:
            said.append(f"In the paper: {self.options['paper']}.")
        if "code" in self.options:
            names = self.options["code"].split(", ")
            said.append("Code: " + ", ".join(f"{{py:obj}}`{name}`" for name in names) + ".")
        if said:
            said, messages = self.parse_inline(" ".join(said))
            found += [nodes.paragraph("", "", *said, classes=["equation-source"]), *messages]
        return found


def link_back(app, what, name, obj, options, lines):
    """Link the equations that a docstring cites; add those that name the object."""
    for k, line in enumerate(lines):
        lines[k] = CITED.sub(lambda found: NUMBER.sub(r":eq:`eq-\1`", found.group()), line)
    own = [number for number, there in app.equations_of.items() if any(o is obj for o in there)]
    if own:
        lines += ["", "**Theory:** " + ", ".join(f":eq:`eq-{number}`" for number in own), ""]


class NameTable(SphinxDirective):
    """The functions and classes that a face shows, each with its first line.

    With names as content: only these, in this order, and their full docstrings below.
    """

    required_arguments, has_content = 1, True

    def run(self):
        """A table of links."""
        (face,), chosen = self.arguments, " ".join(self.content).split()
        there = dict(shown(face))
        rows = ["| name | what |", "|---|---|"]
        for name in chosen or there:
            first = (there[name].__doc__ or "").strip().split("\n\n")[0]
            said = " ".join(first.split()).replace("|", r"\|")
            rows.append(f"| {{py:obj}}`~{face}.{name}` | {said} |")
        full = ["", "```{eval-rst}"] if chosen else []
        for name in chosen:
            kind = "autoclass" if isclass(there[name]) else "autofunction"
            full += [f".. {kind}:: {face}.{name}", *["   :members:"] * isclass(there[name]), ""]
        return self.parse_text_to_nodes("\n".join(rows + full + ["```"] * bool(chosen)))


class Domain(PythonDomain):
    """A name that the front door and a room both show has two entries, and no warning."""

    def note_object(self, name, objtype, node_id, aliased=False, location=None):
        """The first entry holds."""
        if not (aliased and name in self.objects):
            super().note_object(name, objtype, node_id, aliased, location)


def setup(app):
    """Read which code the pages name, then follow it both ways."""
    app.equations_of = {
        number: [named(path) for path in said.get("code", ())] for _, number, said in equations()
    }
    app.add_domain(Domain, override=True)
    app.add_directive("names", NameTable)
    app.add_directive("equation", Equation)
    # After numpydoc, which reads the sections of a docstring.
    app.connect("autodoc-process-docstring", link_back, priority=900)
    return {"parallel_read_safe": True}
