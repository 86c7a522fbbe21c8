"""The table of sentences of the checks: each case is one that a check gives, with a remedy."""

import re
from pathlib import Path

import pytest

import patterns.snapshots
from patterns.snapshots.findings import finding, sentences

CODE = "".join(path.read_text() for path in Path(patterns.snapshots.__file__).parent.glob("*.py"))
CASES = [
    (check, case)
    for check, parts in sentences().items()
    for case, words in parts.items()
    if isinstance(words, dict)
]


def test_every_check_of_the_table_is_one_of_the_code():
    assert set(re.findall(r'finding\(\s*"(\w+)"', CODE)) == set(sentences())


@pytest.mark.parametrize(("check", "case"), CASES, ids=" ".join)
def test_a_case_is_named_in_the_code_and_has_a_remedy(check, case):
    words = sentences()[check][case]
    assert f'"{case}"' in CODE
    assert set(words) <= {"says", "doubt", "error", "remedy"}
    doubtful = {"doubt", "error"} & set(words)
    assert len(doubtful) == ("remedy" in words) <= 1
    assert words.get("remedy", ".").endswith(".")
    assert not words.get("says", "").endswith(".")


def test_severity_is_that_of_the_case():
    assert finding("jammed", 1.0).severity == "ok" and finding("jammed", 1.0).remedy == ""
    assert finding("jammed", 0.5, "flow").severity == "doubt"
    error = finding("directions", 0.125, "exchanged", other=0.75)
    assert (error.check, error.number, error.severity) == ("directions", 0.125, "error")
    assert str(error) == (
        "the component along the branch is 0.125 of the force, positive if it pushes: x and y "
        "exchanged give 0.75. Exchange fx and fy."
    )
    with pytest.raises(KeyError):
        finding("jammed", 1.0, "no such case")
