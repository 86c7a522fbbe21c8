"""The smallest model of a path: the option --model of both commands."""

import json

import pytest

from loops import InputError
from studies.paths.diamond import model_summary
from studies.paths.options import DiamondOptions, PolygonOptions
from tests.command import run
from tests.studies.paths.followed import followed


@pytest.mark.parametrize(
    ("table", "closure"), [pytest.param(1, "affine", marks=pytest.mark.slow), (2, "traction")]
)
def test_all_freedoms_of_the_diamond_against_its_closed_forms(table, closure):
    path = followed(table=table, closure=closure, model="full")
    found = model_summary(path)
    assert (found["choice"], found["freedoms"]) == ("full", "8 of 8")
    assert sorted(found["check"]["differences"]) == ["A", "B", "I"]
    assert max(found["check"]["differences"].values()) < 1e-14


def test_the_diamond_says_that_it_has_two_freedoms():
    found = model_summary(followed(table=1))
    assert (found["symmetry"], found["freedoms"]) == ("D2 (order 4)", "2 of 8")
    assert (found["contact_orbits"], found["check"]) == ("1 of 4", None)


def test_an_unknown_model_is_refused():
    with pytest.raises(InputError, match="--model"):
        DiamondOptions(model="small")
    with pytest.raises(InputError, match="--model"):
        PolygonOptions(5, model="small")


def test_the_command_takes_and_says_the_model(tmp_path, undrawn, capsys):
    runs = {}
    for model in ("auto", "full"):
        out = tmp_path / model
        words = ["polygon", "--order", "4", "--end", "0.2", "--model", model, "--out", out]
        assert run(*words) == 0
        assert f"model {model}: symmetry" in capsys.readouterr().out
        runs[model] = json.loads((out / "summary.json").read_text())
    assert runs["auto"]["model"]["freedoms"] == "2 of 8"
    assert runs["full"]["model"]["freedoms"] == "8 of 8"
    for event, other in zip(runs["auto"]["events"], runs["full"]["events"], strict=True):
        assert event["E1"] == pytest.approx(other["E1"], abs=1e-13)
        assert event["kind"] == other["kind"]
