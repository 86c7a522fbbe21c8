"""The study of loops in place: its packings, and what it draws."""

import numpy as np

from loops import Scene, branch_vectors, find_faces
from loops.in_place import loops_in_place
from tests.tools.scaling.in_place import METHODS, PEERS, in_place_figure, peer, replicated


def test_a_repeated_cell_is_the_same_packing():
    (one, law), (four, laws) = (replicated(times, sliding=True) for times in (1, 2))
    assert (four.grain_count, four.contact_count) == (4 * one.grain_count, 4 * one.contact_count)
    np.testing.assert_allclose(
        branch_vectors(four), np.tile(branch_vectors(one), (4, 1)), atol=1e-12
    )
    assert np.array_equal(four.regime, np.tile(one.regime, 4)) and len(laws.kn) == 4 * len(law.kn)
    loops = [len(find_faces(graph).loops) for graph in (one, four)]
    assert loops[1] == 4 * loops[0]
    # Copies of a loop answer alike within their errors, whatever the order of the fronts.
    place = loops_in_place(Scene(four, laws), find_faces(four))
    trace = np.sort(np.trace(place.matrix, axis1=1, axis2=2)).reshape(-1, 4)
    assert np.nanmax(place.error) < 1e-6
    np.testing.assert_allclose(trace, np.repeat(trace[:, :1], 4, axis=1), rtol=1e-6)


def test_a_peer_is_timed_for_all_loops():
    row = peer("spsolve", 1, False)
    assert row["grains"] == 2000 and row["loops"] == 1254 and row["cpu_seconds"] > 1


def test_figure_of_times_and_errors():
    rows = [
        {"grains": n, "sliding": False, "method": name, "loops": n // 2, "cpu_seconds": 1e-3 * n}
        | {"median": 0.0 if name == "whole" else np.nan if name in PEERS else 0.01}
        for n in (2000, 8000)
        for name in (*METHODS, *PEERS)
    ]
    left, right = in_place_figure(rows).axes
    assert left.get_xscale() == left.get_yscale() == right.get_xscale() == "log"
    assert [line.get_label() for line in right.lines] == [
        *("whole", "blocks 100, buffer 8", "blocks 50, buffer 8", "blocks 25, buffer 4"),
        *("dense inverse", "spsolve"),
    ]
    assert "ms a loop" in left.get_xlabel()
