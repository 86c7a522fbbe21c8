"""`docs/published.md`: its numbers against the platform, and against the folder they are from."""

import os
import re
from pathlib import Path

import numpy as np
import pytest

from studies.examples.three_discs import CASES, answer, changing_angles, located
from tests.docs.pages import DOCS, page, says, section, tables

FOLDER = Path(os.environ.get("GRAINLOOPS_PUBLISHED") or "none")
THREE = section(page("published"), "## Three discs whose contacts are at the friction limit")
(OVERVIEW,) = tables(page("published").split("\n## ")[0])
KINDS, ANGLES = tables(THREE)


@pytest.mark.parametrize(("beta", "told"), list(zip(CASES, KINDS, strict=True)))
def test_cases_are_those_of_the_table(beta, told):
    found = answer(beta)
    assert told["status"] == f"`{found['status']}`"
    for name in ("q", "M"):
        assert says(told[f"`{name}`"], found[name]) or abs(found[name]) < 1e-3
        assert float(told[f"`{name}`"]) == pytest.approx(found[name], abs=5e-9)
    assert ("stick" in told["answer"]) == ("stick" in found["kind"])
    total = re.findall(r"sum (\d\.\d+)", told["answer"])
    assert [float(one) for one in total] == pytest.approx(
        [] if np.isnan(found["slip"]) else [found["slip"]], abs=5e-9
    )


def test_differences_of_the_overview():
    for beta, told in zip(CASES, OVERVIEW, strict=False):
        found = answer(beta)
        theirs, ours, differences = (
            [float(one) for one in told[name].split(",")]
            for name in ("theirs", "ours", "difference")
        )
        exact = [found["q"], found["M"]]
        assert ours == pytest.approx(exact, abs=5e-9)
        assert np.abs(np.subtract(theirs, exact)) == pytest.approx(differences, abs=6e-9)


def test_angles_of_the_page():
    for told, exact, found in zip(ANGLES, changing_angles(), located(), strict=True):
        assert float(told["closed form (degrees)"]) == pytest.approx(exact, abs=1e-10)
        assert float(told["located by the platform"]) == pytest.approx(found, abs=1e-10)


def test_the_figure_exists():
    assert (DOCS / "figures/published-three-discs.png").is_file()


@pytest.mark.published
def test_the_folder_quotes_what_the_page_says_it_quotes():
    """`beta 20 deg: q = .0638075 (both), all entries of M -.0221320: ...` and so on."""
    text = re.sub(r"\s+", " ", (FOLDER / "README.md").read_text().split("## Three discs")[1])
    pattern = r"beta ([\d.]+) deg: q = (-?[\d.e-]+)[ ,(].*?M (?:= )?(-?[\d.e-]+):"
    quoted = re.findall(pattern, text)
    assert [float(beta) for beta, *_ in quoted] == [20.0, 26.565, 40.0]
    for (_, q, m), told in zip(quoted, OVERVIEW, strict=False):
        assert told["theirs"].split(", ") == named(q, m)
    assert "add up to 2.883" in text


def named(*numbers):
    """Numbers as the page writes them: with a zero before the point."""
    return [re.sub(r"^(-?)\.", r"\g<1>0.", one) for one in numbers]
