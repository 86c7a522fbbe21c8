"""`docs/columns.md`: as the table in the code has it, with every column that the commands write."""

import json

import pyarrow.parquet
import pytest

from patterns import sample_path
from studies.output import DESCRIBED_COMMANDS, described, field_metadata
from tests.command import run_evolve, run_probe, run_series, run_snapshot
from tests.docs.columns_page import page
from tests.docs.pages import DOCS
from tests.golden.test_golden import FOLDER

SLOW = sorted(sample_path("slow/cells.csv").parent.glob("grains_*.parquet"))


def test_the_page_is_up_to_date():
    assert (DOCS / "columns.md").read_text() == page(), (
        "python -m tests.docs.columns_page > docs/columns.md"
    )


@pytest.mark.parametrize("answer", sorted(FOLDER.glob("*.json")), ids=lambda path: path.stem)
def test_columns_of_the_stored_answers_are_described(answer):
    command = answer.stem.split("-")[0]
    if command not in DESCRIBED_COMMANDS:
        return
    tables = json.loads(answer.read_text())["tables"]
    assert tables
    for place, table in tables.items():
        name = f"{command}/{place.split('/')[0]}"
        assert [one for one in table["columns"] if described(name, one) is None] == []


def files_say(command, out, least):
    """Every field of every table holds its unit and meaning."""
    seen = 0
    for path in sorted(out.rglob("*.parquet")):
        name = path.parent.name if path.parent != out else path.stem
        place = f"{command}/{name}"
        for field in pyarrow.parquet.read_schema(path):
            said = {key: field.metadata.get(key) for key in (b"unit", b"meaning")}
            assert said == field_metadata(place, field.name), (path.name, field.name)
            seen += 1
    assert seen >= least


@pytest.mark.slow
def test_files_hold_units_and_meanings(tmp_path):
    cells = sample_path("slow/cells.csv")
    how = {"cells": cells, "workers": 1, "shear_increment": "radii", "figures": False}
    run_series(SLOW[:2], tmp_path / "s", in_packing=True, probe=1, **how)
    files_say("series", tmp_path / "s", 200)


def test_files_of_a_snapshot_and_of_a_probe(tmp_path):
    run_snapshot(sample_path(), tmp_path / "n", in_packing="blocks", figures=False)
    files_say("snapshot", tmp_path / "n", 45)
    run_probe(sample_path(), tmp_path / "p", directions=2, figures=False)
    files_say("probe", tmp_path / "p", 40)


@pytest.mark.slow
def test_files_of_a_path(tmp_path):
    cells = sample_path("slow/cells.csv")
    how = {"cells": cells, "shear_increment": "radii", "figures": False}
    run_evolve(SLOW[:2], tmp_path / "e", to=5e-6, axis=2, rows=1, **how)
    files_say("evolve", tmp_path / "e", 50)


def test_a_name_means_what_its_table_says():
    assert described("snapshot/loops", "area") != described("snapshot/orders", "area")
    assert "frictional" in described("domain/domain", "contacts")[1]
    assert described("series/evolution", "contacts")[0] == "1"
    # Two commands write a table `path`; over the reference area in one alone.
    assert described("diamond/path", "work")[0] == "kn"
    assert described("evolve/path", "work")[0] == "force length"
    assert described("diamond/path", "unheard_of") is None
    assert described("bench/bench", "work") is field_metadata("bench/bench", "work") is None
