"""The page on the paper: its residuals, and that the committed one is that of a fresh run."""

import re
from pathlib import Path

import pytest

from studies.paper import collect, equation_residuals, page
from studies.paper.page import figure_file
from studies.paper.tangent_equations import appendix_one
from studies.paper.text import EQUATIONS, FIGURES

DOCS = Path(__file__).parents[2] / "docs"
NUMBER = re.compile(r"-?\d+(?:\.\d+)?(?:e[+-]?\d+)?")
# A number at round-off, one digit: its size is the machine's.
ROUND_OFF = re.compile(r"\d+e[+-]\d+")


@pytest.fixture(scope="module")
def fresh():
    return collect()


def test_every_equation_holds():
    residuals = equation_residuals()
    assert set(residuals) == {key for *_, key in EQUATIONS}
    # (8b) is a derivative of an interpolant of degree 16.
    assert residuals.pop("8b") < 1e-11
    # The force method is let go up to a condition of 1e4: (25), (26) on a thousand diamonds.
    assert residuals.pop("25-26") < 3e-14
    assert max(residuals.values()) < 1e-14


def test_every_equation_of_the_paper_is_named():
    text = page_text()
    named = set()
    for first, last in re.findall(r"\((\d+)[a-z]?\)(?:–\((\d+)\))?", text):
        named |= set(range(int(first), int(last or first) + 1))
    assert set(range(1, 58)) <= named


def test_appendix_one_is_a_congruence_and_no_similarity():
    found = appendix_one()
    assert found["signs_differ"] == 0
    assert found["largest_relative_gap"] > 1.0
    assert found["gap_at_45_degrees"] < 1e-12


def test_the_committed_page_is_that_of_a_fresh_run(fresh):
    committed, made = page_text(), page(fresh)
    # Line breaks follow the lengths of numbers; compare words.
    old, new = committed.split(), made.split()
    assert len(old) == len(new)
    for a, b in zip(old, new, strict=True):
        assert NUMBER.sub("#", a) == NUMBER.sub("#", b)
        for x, y in zip(NUMBER.findall(a), NUMBER.findall(b), strict=True):
            if ROUND_OFF.fullmatch(x):
                assert max(float(x), float(y)) < 1e-11
            else:
                assert float(x) == pytest.approx(float(y), rel=1e-5 if len(x) < 10 else 1e-9)


def test_comparison_sees_a_changed_number():
    assert NUMBER.findall("0.409734349") != NUMBER.findall("0.409734350")
    assert NUMBER.sub("#", "|T|/(μN)") != NUMBER.sub("#", "|T|/(μT)")


def test_figures_of_the_page_exist_and_are_small():
    text, size = page_text(), 0
    for _, table, name, _ in FIGURES:
        file = DOCS / "figures" / figure_file(table, name)
        assert f"figures/{file.name}" in text
        size += file.stat().st_size
    assert size < 1_500_000


def test_numbers_that_the_page_states_as_facts(fresh):
    for found in fresh["tables"].values():
        assert found["point_B_difference"] < 1e-14
        assert found["verification"]["energy_balance_max_relative"] < 1e-13
        assert found["slopes"]["largest"] < 0.0
        assert found["slopes"]["after_B"] < found["slopes"]["before_B"]
        assert found["loading"]["least_isotropic"] > 0.0 > found["loading"]["largest_drained"]
        assert found["opening"]["beyond"] > found["opening"]["B"]
        assert found["added"]["least_eigenvalue_drained"] > 0.0
        assert found["added"]["s1_end"] > found["added"]["s1_at_A"]
    one, two = (fresh["tables"][k]["slopes"]["at_A"] for k in (1, 2))
    assert one < two < 0.0


def page_text():
    return (DOCS / "paper.md").read_text()
