"""Printed lines: templates over a summary, whose parts are left out where values are unknown."""

import pytest

from studies.commands import CONDITION, Filling, driven_line, printed
from studies.commands.loops import _loop_domain_lines
from studies.output import words

SUMMARY = {
    "share": 0.25,
    "none": None,
    "zero": 0,
    "one": 1,
    "below": -1e-14,
    "minus": -0.0,
    "file": "r-0.0 -0.c",
    "ends": [True, False],
    "events": {"yield": 3, "opening": 2},
    "end": {"P11": 1.0, "P22": None},
    "driven": "H22",
    "nested": {"spread": 0.031, "name with blanks": 4},
}


@pytest.mark.parametrize(
    ("template", "text"),
    [
        ("{share:.2f}", "0.25"),
        ("{share:%.3g} %", "25 %"),
        ("{none}", None),
        ("{below:.10f} {minus:.1e}: {minus:3}; {file}", "0.0000000000 0.0e+00: 0.000; r-0.0 -0.c"),
        ("{below:.1e} {below:.13f}0", "-1.0e-14 0.00000000000000"),
        ("{missing[key]}", None),
        ("{none[key]:.3f}", None),
        ("a {share}| b {none}| c {zero}", "a 0.25 c 0"),
        ("{none}| b {share}", None),
        ("{none:3} {share:3>7}", "-   0.250"),
        ("?share:yes|?zero: no|!none: unknown|!share: no|~ends: partly", "yes unknown partly"),
        ("?zero:not printed", None),
        ("{one:#loop}, {zero:#loop}", "1 loop, 0 loops"),
        ("{one:#grain moves/grains move}", "1 grain moves"),
        ("{none:#grain}", None),
        ("{events:counts}", "3 yield, 2 opening"),
        ("{events:counts of order}", "3 of order yield, 2 of order opening"),
        ("{events:counted}; {events:spaced}", "yield: 3, opening: 2; yield: 3  opening: 2"),
        ("{end:values}", "P11 = 1  P22 = -"),
        ("P{driven:axes}{nested[spread]:spread}", "P22 (spread 3.1 %)"),
        ("{nested[name with blanks]}|!nested[other name]: none", "4 none"),
    ],
)  # fmt: skip
def test_a_template_over_a_summary(template, text):
    assert Filling().filled(template, SUMMARY) == text


def test_words_stand_for_what_they_describe():
    assert Filling().filled("{by:word/by}", {"by": "increment"}) == "each in one solve"
    counts = {"unique": 2, "finished": 1}
    said = Filling().filled("{counts:counted/status}", {"counts": counts})
    assert said == "one solution (proved): 2, finished: 1"
    assert Filling().filled("{none:counts}", {"none": {}}) == "none"


def test_a_line_for_each_item_with_its_own_keys():
    """An item of a mapping has its name, an item of a list its own one."""
    row = {"order": 3, "loops": 7, "W2_share": 0.5, "negative_share": None}
    lines = printed("probe", {"orders": {"3": row, "4": {"loops": 0}}})
    assert lines[-1] == "    3    0.500        -" and lines[-2].startswith("softest direction")
    skipped = [{"snapshot": 2, "name": "b.csv", "reason": 400 * "x"}]
    (line,) = (one for one in printed("series", {"skipped": skipped}) if "skipped" in one)
    assert line == f"skipped: snapshot 2 (b.csv): {300 * 'x'}"


def test_every_template_can_be_read():
    """Braces are closed, conditions are conditions, and tables of words exist."""
    tables = words("lines")
    for lines in tables["lines"].values():
        for line in lines:
            for part in (line if isinstance(line, str) else line[1]).split("|"):
                assert CONDITION.match(part) or part[:1] not in tuple("?!~")
                for _, _, spec, _ in Filling().parse(part):
                    _, _, table = ("" if (spec or "")[:1] == "#" else spec or "").partition("/")
                    assert not table or table in tables["words"]


@pytest.mark.parametrize(
    ("programme", "axis", "words"),
    [
        ("drained", 2, "drained along axis 2, that of the major stress"),
        ("drained", 1, "drained along axis 1; the major stress is along axis 2"),
        ("isotropic-stress", 2, "isotropic-stress"),
    ],
)
def test_the_driven_axis_is_named_with_that_of_the_major_stress(programme, axis, words):
    summary = {"programme": programme, "axis": axis, "major_axis": 2}
    start = {"P11": 1.0, "P22": 2.0}
    assert driven_line(summary | {"start": start}) == f"{words} (P11 = 1, P22 = 2)"


@pytest.mark.parametrize(
    ("more", "words"),
    [
        (
            {"limits": {"opening": 7, "yield": 2}},
            "a contact that opens on 7, a contact at yield on 2",
        ),
        ({"unstable_share": 0.25}, "no limit; unstable share of strains 0.250"),
        (
            {"present_state": "stable", "ended_by": {"end": 4, "opening": 5}},
            "no limit; present state stable, programmes ended by the end of the range: 4, "
            "a contact that opens: 5",
        ),
        (
            {"present_state": "unstable", "negative_share": 0.25, "ended_by": {"start": 9}},
            "none followed; the present state is unstable, with negative second-order work along "
            "25 % of them",
        ),
    ],
)
def test_limits_of_a_domain_are_counted(more, words):
    loop = {"order": 4, "closure": "affine", "kappa": 0.5, "contacts": "sticking", "limits": {}}
    (line,) = _loop_domain_lines({"directions": 9, "loops": [loop | more]})
    head = "n = 4  affine  kappa = 0.5  sticking    of 9 programmes: "
    assert line == head + words
