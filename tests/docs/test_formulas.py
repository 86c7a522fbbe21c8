"""`docs/notation.md` names one place in the code for each formula, and its kernel."""

import re
from pkgutil import resolve_name

import pytest

from tests.docs.pages import page

ROWS = re.findall(
    r"^\| (.+?) \| (`.+?) \|(.*)\|$",
    page("notation").split("## One place")[1].split("\n## ")[0],
    re.M,
)
PLACES = re.findall(r"`((?:loops|patterns|stability)\.[\w.]+)`", str(ROWS))


def found(place: str) -> object:
    """The object of a dotted name: in a module, or in a class of one."""
    module, name = place.rsplit(".", 1)
    if name.islower() and not module.rsplit(".", 1)[1].islower():
        module, name = module.rsplit(".", 1)[0], place.split(".", module.count("."))[-1]
    return resolve_name(f"{module}:{name}")


@pytest.mark.parametrize("place", PLACES)
def test_the_place_of_a_formula_is_there(place):
    thing = found(place)
    assert callable(thing) and place.startswith(thing.__module__)


def test_no_place_has_two_formulas():
    assert len(ROWS) > 30 and sorted(set(PLACES)) == sorted(PLACES)
