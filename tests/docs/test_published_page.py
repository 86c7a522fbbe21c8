"""`docs/published.md`: its numbers against the platform, and against the folder they are from."""

import os
import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from loops.kinetics import over_packings
from studies.examples import YADE_SAMPLES, cells, kuhn_discs, quadrons
from studies.examples.three_discs import CASES, changing_angles, located, response_at
from tests.docs.pages import DOCS, page, says, section, tables

FOLDER = Path(os.environ.get("GRAINLOOPS_PUBLISHED") or "none")
THREE = section(page("published"), "## Three discs whose contacts are at the friction limit")
(OVERVIEW,) = tables(page("published").split("\n## ")[0])
KINDS, ANGLES = tables(THREE)
OVAL, ANSWERS = tables(section(page("published"), "## Kuhn's 49 discs"))
CELLS = section(page("published"), "## Cells that split and merge, and their quadrons")
(QUADRONS,) = tables(CELLS)
COLLECTION = Path(os.environ.get("GRAINLOOPS_DEM") or "none")


@pytest.mark.parametrize(("beta", "told"), list(zip(CASES, KINDS, strict=True)))
def test_cases_are_those_of_the_table(beta, told):
    found = response_at(beta)
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
        found = response_at(beta)
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


@pytest.mark.parametrize("name", ["three-discs", "kuhn-discs", "cells-kinetics", "cells-quadrons"])
def test_the_figures_exist(name):
    assert (DOCS / f"figures/published-{name}.png").is_file()


@pytest.fixture(scope="module")
def kuhn(tmp_path_factory):
    """Numbers and tables of the example, whole."""
    out = tmp_path_factory.mktemp("kuhn")
    numbers = kuhn_discs.main(out, FOLDER / "kuhn49")
    names = ("kuhn_discs", "kuhn_discs_oval", "kuhn_discs_events")
    return numbers, *(pd.read_parquet(out / f"{name}.parquet") for name in names)


@pytest.mark.published
def test_kuhns_discs_are_within_the_bounds_of_oval(kuhn):
    """1e-5 and 1e-4 up to 1.9e-3, 3e-4 and 5e-4 up to 1.375e-2; the other law is outside."""
    numbers, rows, oval, _ = kuhn
    for last, bounds in {1.9e-3: (1e-5, 1e-4), 1.375e-2: (3e-4, 5e-4)}.items():
        off = oval[oval.strain_11 <= last][["off_sigma", "off_extension"]].abs().max()
        assert (off.to_numpy() < bounds).all()
    assert numbers["within"] and not numbers["within_radii"]
    assert numbers["off_radii"] == pytest.approx([5e-4, 4e-3], rel=0.2)
    first, second = numbers["sliders"]
    assert 1.5e-4 < first < 1.6e-4 and 2.0e-4 < second < 2.1e-4
    # Digits that OVAL prints; those of sigma12 differ by 1e-5 of it.
    assert numbers["stress_before"][::3] == pytest.approx([2.496325e-3, 2.542448e-3], abs=5e-10)
    assert numbers["stress_held"][::3] == pytest.approx([2.497627e-3, 2.542604e-3], abs=1e-9)
    assert -numbers["stress_held"][1] == pytest.approx(3.445973e-5, rel=2e-5)
    assert {k: numbers["start"][k] for k in ("contacts", "loops")} == {"contacts": 92, "loops": 47}
    assert np.abs(rows.sigma_22 / rows.sigma_22[0] - 1).max() < 1e-7
    # OVAL's 85 contacts are those that touch, with and without a force.
    at = numbers["at_0.009"]
    assert (at["loops"], at["contacts"], at["touching"]) == (38, 83, 85)
    assert at["fabric_11_touching"] == pytest.approx(0.5395, abs=1e-4)
    assert at["fabric_11"] == pytest.approx(0.5411, abs=1e-4)


@pytest.mark.published
def test_half_the_interval_has_the_same_events_of_kuhns_discs(kuhn):
    _, _, _, events = kuhn
    held, interval = (
        kuhn_discs.hold(kuhn_discs.discs_in_cell(FOLDER / "kuhn49")),
        kuhn_discs.INTERVAL,
    )
    path = kuhn_discs.compressed(held, interval=0.5 * interval, pathologies=False)
    table = pd.read_csv(FOLDER / "kuhn49" / "oval.csv")
    assert kuhn_discs.within(kuhn_discs.compared(kuhn_discs.compression_table(path), table))
    pairs = [path.states[-1].contacts[event.contacts[0]].tolist() for event in path.events]
    assert [event.kind for event in path.events] == events.kind.tolist()
    assert pairs == events[["grain_1", "grain_2"]].to_numpy().tolist()
    strains = np.array([event.parameter for event in path.events])
    assert np.abs(strains - events.strain_11).max() < 1e-7


@pytest.mark.published
def test_numbers_of_the_page_on_kuhns_discs(kuhn):
    _, rows, oval, events = kuhn
    for told, (_, found) in zip(OVAL, oval.iterrows(), strict=True):
        assert float(told["strain"]) == found.strain_11
        columns = list(told.values())
        assert [float(one) for one in columns[1:3]] == pytest.approx(
            [found.sigma_11, found.sigma_11_ours], rel=2e-6
        )
        assert [float(columns[k]) for k in (3, 6)] == pytest.approx(
            [found.off_sigma, found.off_extension], rel=0.05
        )
    assert len(events) == 131 and (events.kind == "instability").sum() == 0
    told = ANSWERS[1:7]
    for one, (_, found) in zip(told, events.iterrows(), strict=False):
        assert one["event"] == found.kind
        assert float(one["strain"]) == pytest.approx(found.strain_11, rel=1e-3)
        assert int(one["contacts at yield"]) == found.candidates
        assert (one["symmetric"] == "yes") == bool(found.symmetric)
    few, many = rows[rows.candidates < 2], rows[rows.candidates >= 2]
    assert few.symmetric.all() and not many.symmetric.any()
    assert (rows.p_matrix == 1).all() and (rows.solutions == 1).all() and rows.proved.all()
    assert rows.strain_11[rows.definite == 0].between(0.0124, 0.0126).all()
    assert (rows.definite == 0).sum() == 4 and (events.definite == 0).sum() == 2


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


@pytest.fixture(scope="module")
def samples():
    """Series of the four packings of the collection."""
    return [cells.intervals_of(COLLECTION / name) for name in YADE_SAMPLES]


@pytest.mark.collection
def test_balance_of_the_page(samples):
    found = {}
    for name in cells.STRETCHES:
        given = [(one.events[name], one.strains[name]) for one in samples]
        if name == "start":
            given = cells.short(given)
            assert [len(events) for events, _ in given] == [2, 1, 1, 1]
        else:
            assert sum(len(events) for events, _ in given) == 51
            assert [len(events) for events, _ in cells.short(given)] == [2, 28]
        found[name] = cells.transitions(given)
    (first, start), (table, whole) = found.values()
    row = first[(first.order_1 == 3) & (first.order_2 == 5)].iloc[0]
    assert says("0.63", row.balance_excess) and says("0.09", row.error_by_packing)
    assert (int(whole.opened.sum()), int(whole.closed.sum())) == (940, 796)
    assert (whole.once, whole.several) == (2676, 8630)
    ratio = (table.balance_excess / table.error_by_packing).abs()
    row = table.loc[ratio.idxmax()]
    assert says("2.5", ratio.max()) and (row.order_1, row.order_2) == (4, 6)
    assert says("0.31", row.balance_excess) and says("0.12", row.error_by_packing)
    frequent = table.sort_values("openings").tail(5)
    frequent = frequent[frequent.order_1 == 3]
    assert len(frequent) == 3 and frequent.balance_excess.between(0.02, 0.045).all()
    for one, told in ((whole, ("19.9", 11, "0.05")), (start, ("122.8", 7, "0.00"))):
        balance = one.balance()
        assert says(told[0], balance.chi2) and balance.pairs == told[1]
        assert says(told[2], balance.p_all)


@pytest.mark.collection
def test_steady_state_and_neighbours_of_the_page(samples):
    given = [(one.events["beyond"], one.strains["beyond"]) for one in samples]
    (_, apart), (_, error) = over_packings(given, cells.steady)
    for order, less, by in ((4, "-0.025", "0.009"), (5, "-0.019", "0.006"), (8, "0.017", "0.016")):
        assert says(less, apart[order - 3]) and says(by, error[order - 3])
    ratio, _ = cells.likeness(samples)
    assert says("0.14", np.abs(ratio[:5, :5] - 1.0).max())
    # Loops of order 4 beside 6 and 7, and of order 6 beside 6 and 7.
    assert (ratio[1, 3:5] < 0.95).all() and (ratio[3, 3:5] > 1.05).all()


@pytest.mark.collection
def test_quadrons_of_the_page():
    found = {name: quadrons.quadrons_of(COLLECTION / name) for name in YADE_SAMPLES}
    assert sum(len(one["area"]) for one in found.values()) == 369_092
    _, by_order = quadrons.means(found)
    mean, error = ([value for name, value in row.items() if name != "order"] for row in QUADRONS)
    assert all(map(says, mean, by_order.mean_area)) and all(map(says, error, by_order.error))
