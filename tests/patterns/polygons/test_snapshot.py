from dataclasses import replace

import numpy as np
import pytest

from loops import (
    InputError,
    LinearFrictional,
    Regime,
    contact_frame,
    find_faces,
    loop_batches,
    macroscopic_tangent,
)
from patterns import Snapshot, loop_of_snapshot, read_snapshot, sample_path, synthetic_network


def synthetic_snapshot():
    """A periodic network with a law and a flag of its own at every contact."""
    graph = synthetic_network(150, seed=4, periodic=True)
    rng = np.random.default_rng(4)
    law = LinearFrictional(
        kn=rng.uniform(1, 2, graph.contact_count), kt=0.5, mu=rng.uniform(0.3, 0.6)
    )
    regime = np.where(rng.random(graph.contact_count) < 0.2, Regime.SLIDING, Regime.ELASTIC)
    return Snapshot(graph, law, regime.astype(np.int8), rng.permutation(150) + 1000, 0, ())


def test_a_loop_has_its_rolling_moments_and_the_snapshots_regimes():
    snapshot = synthetic_snapshot()
    moment = np.random.default_rng(1).normal(size=snapshot.graph.contact_count)
    rolling = replace(snapshot, graph=snapshot.graph.replace(rolling_moment=moment))
    loop = loop_of_snapshot(rolling, 5)
    np.testing.assert_array_equal(np.abs(loop.graph.rolling_moment), np.abs(moment[loop.contacts]))
    np.testing.assert_array_equal(loop.graph.regime, snapshot.regime[loop.contacts])
    assert loop_of_snapshot(snapshot, 5).graph.rolling_moment is None


@pytest.mark.parametrize("source", ["sample", "periodic"])
def test_loops_are_those_of_the_batches(source):
    """Every loop by its id against the batches that the table of loops is made from."""
    snapshot = read_snapshot(sample_path()) if source == "sample" else synthetic_snapshot()
    faces = find_faces(snapshot.graph)
    number = {int(face): loop for loop, face in enumerate(faces.loops)}
    seen = 0
    for batch in loop_batches(snapshot.graph, faces):
        for k, face in enumerate(batch.face[:40].tolist()):
            loop = loop_of_snapshot(snapshot, number[face])
            for name in ("x", "radii", "normal_force", "shear_force"):
                np.testing.assert_array_equal(
                    getattr(loop.graph, name), getattr(batch.graph, name)[k]
                )
            np.testing.assert_array_equal(loop.graph.contacts, batch.graph.contacts)
            np.testing.assert_array_equal(loop.grains, batch.grains[k])
            np.testing.assert_array_equal(loop.contacts, batch.contacts[k])
            np.testing.assert_array_equal(loop.ids, snapshot.ids[batch.grains[k]])
            np.testing.assert_array_equal(loop.regime, snapshot.regime[batch.contacts[k]])
            np.testing.assert_array_equal(loop.law.kn, snapshot.law.kn[batch.contacts[k]])
            seen += 1
    assert seen > 50


def test_a_loop_across_the_border_keeps_its_branches():
    snapshot = synthetic_snapshot()
    faces = find_faces(snapshot.graph)
    length = contact_frame(snapshot.graph)[0]
    crossing = 0
    for loop in range(len(faces.loops)):
        cut = loop_of_snapshot(snapshot, loop)
        np.testing.assert_allclose(contact_frame(cut.graph)[0], length[cut.contacts], rtol=1e-12)
        crossing += bool(snapshot.graph.images[cut.contacts].any())
    assert crossing > 10


def test_real_forces_and_regimes_enter_the_tangent():
    """With its flags, a loop that slides has another tangent than the same loop that sticks."""
    snapshot = synthetic_snapshot()
    faces = find_faces(snapshot.graph)
    loops = [loop_of_snapshot(snapshot, k) for k in range(len(faces.loops))]
    sliding = next(loop for loop in loops if (loop.regime == Regime.SLIDING).sum() == 1)
    flagged, stuck = (
        macroscopic_tangent(sliding.graph, sliding.law, "affine", regime=regime).matrix
        for regime in (sliding.regime, np.full_like(sliding.regime, Regime.ELASTIC))
    )
    assert np.linalg.matrix_rank(flagged - stuck, tol=1e-9) == 1


@pytest.mark.parametrize("loop", [-1, 10**6, 0.5])
def test_bad_numbers(loop):
    snapshot = synthetic_snapshot()
    with pytest.raises(InputError, match="loop: got"):
        loop_of_snapshot(snapshot, loop)
