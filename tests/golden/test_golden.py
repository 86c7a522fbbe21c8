"""The commands answer as they did: `answers.py` runs them, `freeze.py` stores what they said.

Texts, flags and counts are the same to the letter. Numbers agree to 1e-12 of the largest of their
column or list, some thousand roundings: sums over contacts and LAPACK round otherwise elsewhere.
"""

import json
import math
from pathlib import Path

import pytest

from tests.golden.answers import CASES, SLOW
from tests.oracles.diamond import TABLE_1, TABLE_2
from tests.oracles.drained import drained_path

FOLDER = Path(__file__).parent
RELATIVE = 1e-12
# Quantities of size one that vanish, such as det K at I, are known to their rounding.
ABSOLUTE = 1e-14
# A cone that has just opened grows as the square root of the smallest eigenvalue; an angle, a
# fraction or a mode divides by what may be small. Free spins of an even loop answer through a gear
# mode of stiffness 1e-8 (the overlap squared), blocked ones through a condition of 1e6 and less.
# A condition is the stated error, residual included, over the rounding.
SENSITIVE = {
    **dict.fromkeys(("opening_deg", "axis_deg", "edges_deg", "unstable_fraction"), 1e-6),
    **dict.fromkeys(("resultant", "direction", "anisotropy"), 1e-6),
    "traction_free": 1e-4,
    "condition": 0.1,
    # Steps of a replay, and what a path leaves to them; the difference of two states at rest.
    **dict.fromkeys(("replay", "residual"), 1e-6),
    **dict.fromkeys(("/grains/", "/w2/"), 1e-8),
    "/held/spread": 100.0,
}
# Where the smallest eigenvalue is double any direction of its plane holds: of the square beyond its
# yield, of a regular loop in (11, 22, 12, 21).
DOUBLE = "/beyond/verdict/full/witness"
REGULAR = "polygon-4-oedometric", "polygon-6-edge-free"
# Errors are rounding itself: they may shrink, and grow to ten times what they were.
NOISE = (
    "error",
    "imbalance",
    "difference",
    "max_relative",
    "margin",
    "tolerance",
    "bound",
    "orthog",
)
GROWTH = 10.0
FLOOR = 1e-14


def close(found, stored, scale, key, where):
    if not math.isfinite(stored) or not math.isfinite(found):
        return str(found) == str(stored)
    if any(word in key for word in NOISE):
        return abs(found) <= GROWTH * abs(stored) + FLOOR
    relative = next((value for name, value in SENSITIVE.items() if name in where), RELATIVE)
    return abs(found - stored) <= relative * max(scale, abs(stored)) + ABSOLUTE


def differences(found, stored, key="", scale=0.0, where=""):
    """Where two answers differ, as `place: found, stored`."""
    if where.endswith(DOUBLE):
        return []
    if isinstance(stored, dict) and isinstance(found, dict):
        lost = [f"{where}/{name}: lost" for name in sorted(stored.keys() - found.keys())]
        new = [f"{where}/{name}: new" for name in sorted(found.keys() - stored.keys())]
        own = stored.get("scale", 0.0)
        size = own if isinstance(own, float) else 0.0
        deeper = [
            line
            for name in sorted(stored.keys() & found.keys())
            for line in differences(
                found[name],
                stored[name],
                # Sums and values belong to their column.
                key if name in ("sum", "values", "scale", "type", "finite") else name,
                size * (stored["finite"] if name == "sum" and "finite" in stored else 1.0),
                f"{where}/{name}",
            )
        ]
        return lost + new + deeper
    if isinstance(stored, list) and isinstance(found, list) and len(stored) == len(found):
        size = max([scale, *(abs(one) for one in stored if isinstance(one, float))])
        return [
            line
            for k, (a, b) in enumerate(zip(found, stored, strict=True))
            for line in differences(a, b, key, size, f"{where}[{k}]")
        ]
    if isinstance(stored, float) and isinstance(found, int | float):
        same = close(float(found), stored, scale, key, where)
    else:
        # Of errors, rounding decides which are finite.
        noise = where.endswith("/finite") and any(word in key for word in NOISE)
        same = type(found) is type(stored) and (noise or found == stored)
    return [] if same else [f"{where}: {found!r}, stored {stored!r}"]


def stored(name):
    return json.loads((FOLDER / f"{name}.json").read_text())


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.slow] * (name in SLOW)) for name in CASES]
)
def test_answers_are_the_stored_ones(name, tmp_path):
    # Through JSON as the stored ones: tuples become lists.
    found = json.loads(json.dumps(CASES[name](tmp_path)))
    differ = differences(found, stored(name))
    if name in REGULAR:
        differ = [line for line in differ if "/verdict/full/witness[" not in line]
    assert differ == []


def test_every_stored_answer_is_compared():
    assert {path.stem for path in FOLDER.glob("*.json")} == set(CASES)


def test_a_changed_number_key_or_text_is_seen():
    answer = stored("diamond-table1")
    for change, place in (
        ({"E1": answer["summary"]["end"]["E1"] * (1 + 1e-11)}, "E1"),
        ({"new": 1}, "new"),
    ):
        changed = {**answer, "summary": {**answer["summary"]}}
        changed["summary"]["end"] = answer["summary"]["end"] | change
        (line,) = differences(changed, answer)
        assert line.startswith(f"/summary/end/{place}")
    assert differences({"kind": "yield"}, {"kind": "opening"})
    assert differences({"energy_error": 2e-13}, {"energy_error": 1e-15})
    assert not differences({"energy_error": 1e-17}, {"energy_error": 1e-15})
    assert differences([1.0], [1.0, 2.0])
    assert differences({"count": 2}, {"count": 3})


# I by (41), A by the tables, B by mpmath with 20 digits (tests/patterns/diamond); 2e-15 is nine
# roundings of 0.4.
POINTS = {
    "diamond-table1": {
        "I": {"E1": 1 / 6, "E2": 1 / 6, "s1": 1 / 6, "s2": 1 / 6},
        "A": {"E1": 0.3, "E2": 0.3, "s1": 0.3, "s2": 0.3},
        "B": {
            "E1": 0.40973434897033423289,
            "E2": 0.164934999828385506,
            "s1": 0.25400990008305293503,
        },
    },
    "diamond-table2": {
        "I": {"E1": 0.24 / 1.24, "E2": 0.24 / 1.24},
        "A": {"s1": 0.35},
        "B": {
            "E1": 0.41619122318013548716,
            "E2": -0.072382919123994869769,
            "s1": 0.31215593602737202138,
        },
    },
}


@pytest.mark.parametrize("name", POINTS)
def test_points_of_the_paper_to_the_last_digits(name):
    states = stored(name)["summary"]["states"]
    for point, values in POINTS[name].items():
        for quantity, value in values.items():
            assert abs(states[point][quantity] - value) < 2e-15, (point, quantity)
    end = drained_path(TABLE_1 if name == "diamond-table1" else TABLE_2).end
    for quantity, value in POINTS[name]["B"].items():
        assert abs(getattr(end, quantity) - value) < 2e-15
