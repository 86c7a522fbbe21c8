"""`docs/site/notebooks.py`: the gallery's scripts and first steps as notebooks, their pictures."""

import ast
import json
import sys

import pytest
from matplotlib.testing.compare import compare_images

from studies.output import as_json
from tests.docs.pages import DOCS, page

sys.path.insert(0, str(DOCS / "site"))
try:
    from notebooks import BLOCK, cells_of_page, cells_of_script, draw_pictures, notebook
finally:
    sys.path.pop(0)

EXAMPLES = sorted((DOCS.parent / "studies" / "examples").glob("[!_]*.py"))


def code(cells):
    return [text for kind, text in cells if kind == "code"]


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_a_notebook_holds_the_statements_of_its_script(path):
    source = path.read_text()
    cells = list(cells_of_script(path.stem, source))
    question, *statements, guard = ast.parse(source).body
    assert "".join(cells[0][1][2:].split()) == "".join(question.value.value.split())
    assert ast.unparse(guard).startswith("if __name__ == '__main__'")
    *same, call = ast.parse("".join(code(cells)[:-1])).body
    assert [ast.unparse(part) for part in same] == [ast.unparse(part) for part in statements]
    assert ast.unparse(call) == f"numbers = main(Path('{path.stem}'))"
    # Comments too; the blank lines between two cells aside.
    for line in source.partition('"""\n\n')[2].partition("\nif __name__")[0].splitlines():
        assert any(line in cell for cell in code(cells))


@pytest.mark.slow
def test_a_notebook_of_the_gallery_runs(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (path,) = (path for path in EXAMPLES if path.stem == "three_discs")
    names = {}
    *cells, shows = code(cells_of_script(path.stem, path.read_text()))
    for cell in cells:
        exec(cell, names)
    summary = json.loads((tmp_path / "three_discs" / "summary.json").read_text())
    assert json.loads(as_json(names["numbers"]))["cases"] == summary["cases"]
    (picture,) = (part.value for part in ast.walk(ast.parse(shows))
                  if isinstance(part, ast.Constant))  # fmt: skip
    assert (tmp_path / picture).is_file()


def test_the_notebook_of_first_steps_has_the_blocks_of_the_page():
    made = json.loads(notebook(cells_of_page(page("first-steps"))))
    assert made["nbformat"] == 4
    blocks = [code.strip() for code, *_ in BLOCK.findall(page("first-steps"))]
    assert len(blocks) > 12
    assert [cell["source"] for cell in made["cells"] if cell["cell_type"] == "code"] == blocks
    text = "\n".join(cell["source"] for cell in made["cells"] if cell["cell_type"] == "markdown")
    # What a block prints or draws, the notebook prints and draws itself.
    assert "```" not in text and "![" not in text
    titles = [line for line in page("first-steps").splitlines() if line.startswith("#")]
    assert [line for line in text.splitlines() if line.startswith("#")] == titles


@pytest.mark.slow
def test_pictures_of_first_steps_are_what_its_blocks_draw(tmp_path):
    """`python docs/site/notebooks.py` draws them again."""
    blocks = BLOCK.findall(page("first-steps"))
    draw_pictures(blocks, tmp_path)
    drawn = sorted(path.name for path in tmp_path.iterdir())
    assert drawn == sorted(path.name for path in (DOCS / "figures").glob("first-steps-*.png"))
    assert len(drawn) == page("first-steps").count("](figures/first-steps-") == 6
    for name in drawn:
        # Edges of letters may differ between builds of the fonts' library: 1 % of a colour's 255.
        assert compare_images(DOCS / "figures" / name, tmp_path / name, tol=2.55) is None
