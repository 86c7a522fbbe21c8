"""Small packings give what they gave: systems, solves, operators in place, wall contacts.

Each number was stored once (`whole_operators.py`); the other tests of packings have the oracles.
Numbers agree to 1e-9 of the largest of their kind, counts to the letter. Errors are rounding:
they may be larger or smaller by three tenths.
"""

import json

import numpy as np
import pytest

from tests.loops.packing.whole_operators import NUMBERS, WORDS, everything, short

ANSWERS = dict(everything())


@pytest.fixture(scope="module")
def stored():
    return json.loads(WORDS.read_text()), np.load(NUMBERS)


@pytest.mark.parametrize("name", ANSWERS)
def test_operators_are_what_they_were(name, stored):
    words, numbers = ANSWERS[name]()
    assert json.loads(json.dumps(words)) == stored[0][name]
    start, every = 0, stored[1][name]
    for key, values in numbers.items():
        found = short(values)
        expected = every[start : start + len(found)]
        start += len(found)
        rounding = key == "alone_error" or ("error" in key and "blocks" not in name)
        scale = 0.0 if rounding else np.abs(expected[np.isfinite(expected)]).max(initial=0.0)
        rtol = (1.0 if "loose" in name else 0.3) if rounding else 1e-9
        np.testing.assert_allclose(found, expected, rtol=rtol, atol=rtol * scale, err_msg=key)
    assert start == len(every)


def test_every_answer_is_asked_for(stored):
    assert set(stored[0]) == set(stored[1].files) == set(ANSWERS)
