"""Whole paths of tiny loops hold what they held: every column, event and message.

Each number was stored once (`whole_paths.py`); the other tests of paths have the oracles. Numbers
agree to 1e-9 of the largest of their column, words and counts to the letter.
"""

import json

import numpy as np
import pytest

from tests.stability.paths.whole_paths import NUMBERS, WORDS, everything

ANSWERS = dict(everything())
# A balance of work, forces left on grains: rounding. The eigenvalues of K, where several are equal,
# amplify it. A row at the end of a step has the gauge of either step: so does its condition.
NOISE = {"energy_error": 1e-9, "imbalance": 1e-12}
SENSITIVE = {"condition": 3e-3, "eig_K_": 1e-5}


@pytest.fixture(scope="module")
def stored():
    return json.loads(WORDS.read_text()), np.load(NUMBERS)


@pytest.mark.parametrize("name", ANSWERS)
def test_paths_hold_what_they_held(name, stored):
    words, numbers = ANSWERS[name]()
    assert words == stored[0][name]
    start, every = 0, stored[1][name]
    for key, values in numbers.items():
        found = np.ravel(values)
        expected = every[start : start + len(found)]
        start += len(found)
        sensitive = [rtol for some, rtol in SENSITIVE.items() if key.startswith(some)]
        scale = np.abs(expected[np.isfinite(expected)]).max(initial=0.0)
        atol = NOISE.get(key, 1e-14 + 1e-9 * scale)
        if sensitive:
            atol = sensitive[0] * scale
        np.testing.assert_allclose(found, expected, rtol=1e-9, atol=atol, err_msg=key)
    assert start == len(every)


def test_every_answer_is_asked_for(stored):
    assert set(stored[0]) == set(stored[1].files) == set(ANSWERS)
