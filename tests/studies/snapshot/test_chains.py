"""Loops beside force chains: the column, the small table, the segments."""

import numpy as np
import pandas as pd
import pytest

from loops import GrainGraph, find_faces, force_chains
from patterns import read_snapshot, sample_cell, sample_path
from studies.snapshot.figures import chain_segments
from studies.snapshot.summary import chains_summary, chains_table
from studies.snapshot.table import loop_columns


@pytest.fixture(scope="module")
def analysed():
    snapshot = read_snapshot(sample_path())
    table = loop_columns(snapshot)
    chains = force_chains(snapshot.graph)
    table["chain_contacts"] = chains.on_loops(snapshot.faces)
    return snapshot, table, chains


def test_links_on_loops_counted_one_by_one(analysed):
    snapshot, table, chains = analysed
    faces, links = snapshot.faces, set(chains.links.tolist())
    for row, loop in enumerate(faces.loops.tolist()):
        sides = faces.contacts[faces.offsets[loop] : faces.offsets[loop + 1]].tolist()
        assert table["chain_contacts"][row] == sum(side in links for side in sides)


def test_the_table_against_pandas(analysed):
    _, table, chains = analysed
    names = ("order", "chain_contacts", "traction_lambda_min", "traction_free_lambda_min")
    frame = pd.DataFrame({name: table[name] for name in names})
    found = pd.DataFrame(chains_table(table)).set_index(["place", "orders"])
    assert found["loops"].loc[:, "all"].sum() == len(frame)
    for place, rows in frame.groupby(np.where(frame.chain_contacts > 0, "beside", "elsewhere")):
        for orders, some in (("all", rows), ("4", rows[rows.order == 4])):
            row = found.loc[place, orders]
            assert row["loops"] == len(some)
            assert row["mean_order"] == pytest.approx(some.order.mean(), rel=1e-15)
            for judge in ("traction", "traction_free"):
                known = some[f"{judge}_lambda_min"].dropna()
                p, n = (known < 0).mean(), len(known)
                assert row[f"{judge}_lambda_min"] == known.median()
                assert row[f"{judge}_unstable"] == pytest.approx(p, rel=1e-15)
                error = np.sqrt(p * (1 - p) / n)
                assert row[f"{judge}_unstable_error"] == pytest.approx(error, rel=1e-12)
    summary = chains_summary(chains, table)
    assert summary["loops_beside"]["mean"] == pytest.approx((frame.chain_contacts > 0).mean())
    assert summary["longest"] >= summary["mean_length"] >= 3


def test_segments_cross_the_border_by_the_branch():
    """As long as their branches, in a periodic cell too."""
    snapshot = read_snapshot(sample_path("grains_periodic.parquet"), cell=sample_cell())
    ends = chain_segments(snapshot, chains := force_chains(snapshot.graph))
    assert len(ends) == len(chains.links) > 100
    length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    assert length.max() < 2.01 * snapshot.graph.radii.max()


def test_without_chains_there_is_a_row_for_every_group():
    x, ring = [[0, 0], [1, 0], [1, 1], [0, 1]], [[0, 1], [1, 2], [2, 3], [3, 0]]
    square = GrainGraph(x=x, radii=[0.5] * 4, contacts=ring)
    assert len(find_faces(square).loops) == 1
    table = {"order": np.array([4]), "chain_contacts": np.array([0])}
    found = chains_table(table)
    assert sum(found["loops"]) == 2 and found["place"].count("beside") == len(found["place"]) / 2
    assert chains_summary(force_chains(square), table)["longest"] == 0
