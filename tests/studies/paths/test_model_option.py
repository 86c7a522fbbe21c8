"""The smallest model of a path: the option --model of both commands."""

import pytest

from loops import InputError
from studies.paths.options import DiamondOptions, PolygonOptions
from tests.studies.paths.followed import followed


@pytest.mark.parametrize(
    ("table", "closure"), [pytest.param(1, "affine", marks=pytest.mark.slow), (2, "traction")]
)
def test_all_freedoms_of_the_diamond_against_its_closed_forms(table, closure):
    path = followed(table=table, closure=closure, model="full")
    found = path.model()
    assert (found["choice"], found["freedoms"]) == ("full", "8 of 8")
    assert sorted(found["check"]["differences"]) == ["A", "B", "I"]
    assert max(found["check"]["differences"].values()) < 1e-14


def test_the_diamond_says_that_it_has_two_freedoms():
    found = followed(table=1).model()
    assert (found["symmetry"], found["freedoms"]) == ("D2 (order 4)", "2 of 8")
    assert (found["contact_orbits"], found["check"]) == ("1 of 4", None)


def test_an_unknown_model_is_refused():
    with pytest.raises(InputError, match="--model"):
        DiamondOptions(model="small")
    with pytest.raises(InputError, match="--model"):
        PolygonOptions(5, model="small")
