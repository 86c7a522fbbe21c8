"""First steps and the scripts of the gallery as notebooks, and the pictures of first steps.

`python docs/site/notebooks.py` draws the pictures of `docs/first-steps.md` by its own blocks: a
block with a picture below it leaves the axes of that picture in `ax`.
"""

import ast
import json
import re
from pathlib import Path

from matplotlib import pyplot

DOCS = Path(__file__).parents[1]
# A block of code, what it prints, the name of its picture.
BLOCK = re.compile(
    r"```python\n(.*?)```(?:\n```text\n(.*?)```)?"
    r"(?:\n\n!\[[^]]*\]\(figures/first-steps-(\w+)\.png\))?",
    re.DOTALL,
)


def draw_pictures(blocks, folder):
    """Run blocks of `BLOCK` in one session and save each picture."""
    names = {"print": lambda *said, **how: None}
    pyplot.switch_backend("agg")
    for code, _, picture in blocks:
        # A cell of a notebook begins without a figure.
        pyplot.close("all")
        exec(compile(code, "first-steps.md", "exec"), names)
        if picture:
            path = Path(folder) / f"first-steps-{picture}.png"
            names["ax"].figure.savefig(path, dpi=110, metadata={"Software": None})


def cells_of_page(text):
    """Kind and text of the notebook's cells: what stands around the blocks, and the blocks."""
    last = 0
    for found in BLOCK.finditer(text):
        yield "markdown", text[last : found.start()]
        yield "code", found[1]
        last = found.end()
    yield "markdown", text[last:]


def cells_of_script(name, source):
    """The same of an example: its question, a cell for each function, then its call."""
    question, *parts = ast.parse(source).body
    title, _, text = question.value.value.partition("\n")
    yield "markdown", f"# {title}\n{text}"
    lines, start, cell = source.splitlines(keepends=True), question.end_lineno, ""
    for part in parts[:-1]:
        defines = isinstance(part, ast.FunctionDef | ast.ClassDef)
        if defines and cell:
            yield "code", cell
            cell = ""
        cell += "".join(lines[start : part.end_lineno])
        start = part.end_lineno
        if defines:
            yield "code", cell
            cell = ""
    yield "code", f'{cell}numbers = main(Path("{name}"))'
    yield "code", f'from IPython.display import Image\n\nImage("{name}/{name}.png")'


def notebook(cells):
    """The text of a notebook."""
    made = []
    for kind, text in cells:
        if text.strip():
            cell = {"cell_type": kind, "metadata": {}, "source": text.strip()}
            made.append(cell | ({"execution_count": None, "outputs": []} if kind == "code" else {}))
    kernel = {"display_name": "Python 3", "language": "python", "name": "python3"}
    whole = {"cells": made, "metadata": {"kernelspec": kernel}, "nbformat": 4, "nbformat_minor": 4}
    return json.dumps(whole, indent=1, ensure_ascii=False) + "\n"


if __name__ == "__main__":
    draw_pictures(BLOCK.findall((DOCS / "first-steps.md").read_text()), DOCS / "figures")
