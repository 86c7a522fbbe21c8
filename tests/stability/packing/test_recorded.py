"""Small packings answer as they did, number by number: `recorded.py` asks and stores.

Other tests hold the answers to closed forms, brute force and slow replays; these notice what moves.
"""

import json
import math

import pytest

from tests.stability.packing.recorded import CASES, STORED

RELATIVE = 1e-7
# Numbers of size one over a condition of some 1e4: below this they are rounding.
ABSOLUTE = 1e-11


def differences(found, stored, where="", size=0.0):
    """Places where two answers differ."""
    if isinstance(stored, dict) and isinstance(found, dict) and found.keys() == stored.keys():
        return [
            line for k in stored for line in differences(found[k], stored[k], f"{where}/{k}", size)
        ]
    if isinstance(stored, list) and isinstance(found, list) and len(found) == len(stored):
        size = max([size, *(abs(one) for one in stored if isinstance(one, float))])
        return [
            line
            for k, (a, b) in enumerate(zip(found, stored, strict=True))
            for line in differences(a, b, f"{where}[{k}]", size)
        ]
    if type(found) is type(stored) is float:
        same = found == stored or (math.isnan(found) and math.isnan(stored))
        if same or abs(found - stored) <= RELATIVE * max(size, abs(stored)) + ABSOLUTE:
            return []
    elif type(found) is type(stored) and found == stored:
        return []
    return [f"{where}: {found!r}, stored {stored!r}"]


def compare(name, stored):
    """Compare a case with what is stored, answer by answer."""
    for k, found in enumerate(CASES[name]()):
        assert differences(json.loads(json.dumps(found)), stored[k], f"{name}[{k}]") == []
    assert k + 1 == len(stored)


@pytest.mark.parametrize("name", CASES)
def test_answers_are_the_stored_ones(name):
    compare(name, json.loads(STORED.read_text())[name])
