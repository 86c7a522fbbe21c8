"""Events of paths in words: what the tables and pages have said, from their fields."""

import math
from dataclasses import fields

import pytest

from stability import Event
from stability.path import CAUSES, describe

MODE = {"taking_part": 7.4, "sign_changes": True}
HELD = {"cause": "none_found", "taking_part": 1.6, "sign_changes": False, "passed": "held"}


@pytest.mark.parametrize(
    ("kind", "facts", "said"),
    [
        ("yield", {}, ""),
        ("yield", {"cause": "start"}, "from the start"),
        ("opening", {"cause": "stage_end"}, "at the end of the stage"),
        ("unloading", {"count": 2}, "the rate problem has 2 solutions"),
        ("yield", {"spring": "rolling"}, "rolling"),
        ("opening", {"cause": "unloaded"}, "its grain carries nothing"),
        ("opposite_contact", {"count": 13}, "13 pairs of grains at once"),
        ("det_K_zero", {"count": 2}, "2 eigenvalues at once"),
        ("flutter", {"count": 3}, "3 eigenvalues at once"),
        ("det_Ks_zero", {"jump": (0, 1)}, "jump: 0 to 1 negative eigenvalues"),
        ("det_K_zero", {"jump": (0.06716, -0.02809)}, "jump: from 0.0672 to -0.0281"),
        ("branching", {"H": (0.25, 0.0, 0.0, -0.5)},
         "other paths branch off at H11 = 0.25, H22 = -0.5"),
        ("programme_change", {"programme": "drained biaxial"}, "to drained biaxial"),
        ("control_limit", {"cause": "extremum"}, "the loading parameter has an extremum"),
        ("control_limit", {"cause": "turns_back"},
         "the loading parameter has an extremum where the regimes change"),
        ("control_limit", {"cause": "singular"}, "the controlled system is singular"),
        ("control_limit", {"cause": "inconsistent", "count": 531441.0},
         "no choice of regimes is consistent with its own rates (of 5.31e+05 combinations pivoting "
         "from three starts found none; more than 8192 are not all tried)"),
        ("control_limit", {"cause": "never_consistent", "contacts": (1, 4)},
         "contacts [1, 4] have no regime that stays consistent with its rates"),
        ("instability", {"cause": "no_regimes", **MODE, "passed": "dragged", "released": 2.04e-9},
         "no regimes agree: 7 grains taking part, det K changes sign; dragged; 2e-09 released"),
        ("instability", {**HELD, "released": 0.0}, "no regimes that agree were found: "
         "2 grains taking part, det K keeps its sign; held; 0 released"),
        ("instability", {"cause": "no_regimes", **MODE, "passed": "stopped"},
         "no regimes agree: 7 grains taking part, det K changes sign; stopped"),
        ("instability", {"cause": "rattles", "passed": "dragged", "released": 1e-3},
         "a loose grain rattles; dragged; 0.001 released"),
        ("instability", {"cause": "chatters", "passed": "held", "spring": "rolling"},
         "it changes regime again and again; held"),
        ("instability", {"cause": "undecided", "passed": "lost"},
         "neither sticking nor sliding agrees; lost"),
    ],
)  # fmt: skip
def test_an_event_in_words(kind, facts, said):
    assert describe(Event(kind, 0.0, **facts)) == said


def test_every_cause_has_words_of_its_own():
    assert len(set(CAUSES.values())) == len(CAUSES)


def test_an_event_without_facts_has_none():
    plain = Event("yield", 0.5)
    values = {one.name: getattr(plain, one.name) for one in fields(Event)}
    assert math.isnan(values.pop("released")) and math.isnan(values.pop("taking_part"))
    told = {name: value for name, value in values.items() if value}
    assert told == {"kind": "yield", "parameter": 0.5, "spring": "shear"}
