"""The table of loops: both ways to it, its columns, and what stays away without forces."""

from dataclasses import replace

import numpy as np
import pytest

from loops import LinearFrictional, Regime, affine_tangent, contact_forces, find_faces, loop_batches
from patterns import Snapshot, diamond, read_snapshot, sample_cell, sample_path, synthetic_network
from stability import plane_cone, restrict, symmetric_modes
from studies.snapshot.table import MECHANICS, SHAPE, loop_columns


def synthetic_snapshot(grains=1500, *, periodic=False):
    graph = synthetic_network(grains, seed=4, periodic=periodic)
    slides = np.abs(graph.shear_force) >= 0.4999 * graph.normal_force
    return Snapshot(
        graph=graph,
        law=LinearFrictional(np.full(graph.contact_count, 2.0), 1.0, 0.5),
        regime=np.where(slides, Regime.SLIDING, Regime.ELASTIC).astype(np.int8),
        ids=1000 + np.arange(grains),
        wall_contacts=0,
        notes=(),
    )


def snapshots():
    yield synthetic_snapshot()
    yield synthetic_snapshot(periodic=True)
    yield read_snapshot(sample_path("grains_periodic.parquet"), cell=sample_cell())


@pytest.mark.parametrize("snapshot", list(snapshots()), ids=["plane", "torus", "yade"])
def test_both_ways_give_the_same_table(snapshot):
    plain = loop_columns(snapshot, compiled=False)
    fast = loop_columns(snapshot, compiled=True, threads=2)
    assert list(plain) == list(fast) == ["loop", "order", *SHAPE, *MECHANICS, "grains"]
    assert plain.pop("grains").equals(fast.pop("grains"))
    for name, values in plain.items():
        assert values.dtype == fast[name].dtype, name
        if name.endswith(("soft_angle", "orientation")):
            turn = np.abs(values - fast[name])
            # Round loops and nearly equal eigenvalues have no direction to speak of.
            assert np.median(turn) < 1e-10
            continue
        if name.endswith(("condition", "_error")):
            continue  # bounds: either way has its own
        if name.startswith("traction_free"):
            known = np.isfinite(values) & np.isfinite(fast[name])
            assert np.mean(np.isnan(values) != np.isnan(fast[name])) < 0.01
            off, error = np.abs(fast[name] - values)[known], "traction_free_error"
            assert (off <= (fast[error] + plain[error])[known]).all()
            assert np.median(off) < 1e-14
            continue
        size = np.abs(values).max() if "lambda" not in name else 1.0
        tolerance = 1e-7 if name.endswith(("fraction", "opening")) else 1e-12
        np.testing.assert_allclose(fast[name], values, rtol=1e-10, atol=tolerance * size)


@pytest.mark.parametrize("compiled", [False, True])
def test_without_forces_the_mechanical_columns_are_absent(compiled):
    snapshot = replace(synthetic_snapshot(), law=None, regime=None)
    faces = find_faces(snapshot.graph)
    table = loop_columns(snapshot, compiled=compiled)
    assert list(table) == ["loop", "order", *SHAPE, "grains"]
    np.testing.assert_allclose(table["area"], faces.area[faces.loops], rtol=1e-12)


@pytest.mark.parametrize("compiled", [False, True])
def test_columns_of_one_loop(compiled):
    snapshot = synthetic_snapshot(300)
    graph, faces = snapshot.graph, find_faces(snapshot.graph)
    table = loop_columns(snapshot, compiled=compiled)
    batch = next(loop_batches(graph, faces))
    row = np.flatnonzero(faces.loops == batch.face[0])[0]
    force, x = contact_forces(batch.graph)[0], batch.graph.x[0]
    d = np.roll(x, -1, axis=0) - x
    stress = 0.5 * force.T @ d / table["area"][row]
    names = ("stress_11", "stress_12", "stress_21", "stress_22")
    assert [table[name][row] for name in names] == pytest.approx(stress.ravel(), abs=1e-15)
    principal = np.linalg.eigvalsh(0.5 * (stress + stress.T))
    assert table["pressure"][row] == pytest.approx(principal.mean(), abs=1e-15)
    assert table["deviator"][row] == pytest.approx(0.5 * np.ptp(principal), abs=1e-15)
    assert table["sliding_contacts"][row] == np.sum(
        snapshot.regime[batch.contacts[0]] == Regime.SLIDING
    )
    assert table["grains"][int(row)].as_py() == (1000 + batch.grains[0]).tolist()

    law = snapshot.law.take(batch.contacts)
    a = affine_tangent(batch.graph, law, regime=snapshot.regime[batch.contacts]).matrix[0]
    values, vectors = symmetric_modes(restrict(a, "symmetric"))
    found = [table[f"affine_lambda_{name}"][row] for name in ("min", "mid", "max")]
    assert found == pytest.approx(values / 2.0, abs=1e-14)
    opening = np.degrees(plane_cone(restrict(a, "diagonal")).opening)
    assert table["affine_cone_opening"][row] == pytest.approx(opening, abs=1e-12)
    soft = vectors[:, 0]
    strain = np.array([[soft[0], soft[2] / 2**0.5], [soft[2] / 2**0.5, soft[1]]])
    principal, axes = np.linalg.eigh(strain)
    axis = axes[:, np.argmax(np.abs(principal))]
    angle = np.degrees(np.arctan2(axis[1], axis[0]))
    assert (table["affine_soft_angle"][row] - angle + 90) % 180 - 90 == pytest.approx(0, abs=1e-9)


@pytest.mark.parametrize("compiled", [False, True])
def test_no_sign_within_the_error_bound(compiled):
    """A diamond at its threshold E = kappa/(1 + kappa), half-way, and beyond."""
    kappa = 0.25
    for strain, expected in ((0.5, 1.0), (1.0, np.nan), (1.5, -1.0)):
        E = strain * kappa / (1 + kappa)
        loop = diamond(np.pi / 4, E1=E, E2=E)
        law = LinearFrictional(kn=np.ones(4), kt=np.full(4, kappa), mu=np.full(4, np.inf))
        elastic = np.full(4, Regime.ELASTIC, dtype=np.int8)
        snapshot = Snapshot(loop, law, elastic, np.arange(4), 0, ())
        table = loop_columns(snapshot, compiled=compiled)
        for closure in ("affine", "traction"):
            assert np.array_equal(
                np.sign(table[f"{closure}_lambda_min"]), [expected], equal_nan=True
            )
            assert np.isnan(table[f"{closure}_unstable_fraction"][0]) == np.isnan(expected)


@pytest.mark.parametrize("shift", [2.0**10, 2.0**20, 2.0**30])
@pytest.mark.parametrize("compiled", [False, True])
@pytest.mark.parametrize("periodic", [False, True])
def test_where_a_snapshot_lies_changes_nothing(periodic, compiled, shift):
    here = synthetic_snapshot(300, periodic=periodic)
    # Multiples of 2^-20: the shifts are exact, and so are all differences.
    x = np.round(here.graph.x * 2.0**20) * 2.0**-20
    cell = None if here.graph.cell is None else np.round(here.graph.cell * 2.0**20) * 2.0**-20
    tables = []
    for by in (np.zeros(2), np.array([shift, -0.5 * shift])):
        graph = here.graph.replace(x=x + by, x0=x + by, cell=cell, cell0=cell)
        tables.append(loop_columns(replace(here, graph=graph), compiled=compiled))
    assert tables[0]["grains"].equals(tables[1]["grains"])
    for name in tables[0].keys() - {"grains"}:
        values = [np.asarray(table[name]) for table in tables]
        assert len(values[0]) > 80
        if name not in ("x", "y"):
            np.testing.assert_array_equal(*values, err_msg=name)
    moved = np.array([[table["x"], table["y"]] for table in tables])
    apart = moved[1] - moved[0] - np.array([[shift], [-0.5 * shift]])
    if cell is not None:
        # Each lies in the cell, wherever the grains are.
        apart -= cell @ np.round(np.linalg.solve(cell, apart))
        assert (np.abs(np.linalg.solve(cell, moved[1]) - 0.5) <= 0.5 + 1e-9).all()
    np.testing.assert_allclose(apart, 0.0, atol=4e-16 * shift)


@pytest.mark.parametrize("compiled", [False, True])
def test_numbering_moves_no_eigenvalue_by_more_than_its_error(compiled):
    """Grains and contacts in another order, and half of the contacts turned."""
    here, rng = synthetic_snapshot(600), np.random.default_rng(5)
    graph, law = here.graph, here.law
    grains, rows = rng.permutation(graph.grain_count), rng.permutation(graph.contact_count)
    contacts = np.argsort(grains)[graph.contacts[rows]]
    turned = rng.random(len(rows)) < 0.5
    contacts[turned] = contacts[turned, ::-1]
    mixed = graph.replace(
        x=graph.x[grains], radii=graph.radii[grains], contacts=contacts,
        **{**graph.at_contacts(rows), "regime": None},
    )  # fmt: skip
    there = replace(
        here, graph=mixed, law=law.take(rows), regime=here.regime[rows], ids=here.ids[grains]
    )
    tables = [loop_columns(snapshot, compiled=compiled) for snapshot in (here, there)]
    keys = [[tuple(sorted(ids)) for ids in table["grains"].to_pylist()] for table in tables]
    first, second = (sorted(range(len(key)), key=key.__getitem__) for key in keys)
    assert [keys[0][k] for k in first] == [keys[1][k] for k in second]
    for judge in ("affine", "traction", "traction_free"):
        errors = tables[0][f"{judge}_error"][first], tables[1][f"{judge}_error"][second]
        for name in (f"{judge}_lambda_{which}" for which in ("min", "mid", "max")):
            one, other = tables[0][name][first], tables[1][name][second]
            # A verdict is lost only where the eigenvalue is as small as its error.
            lost = np.isnan(one) != np.isnan(other)
            assert np.mean(lost) < 0.01
            known = ~(np.isnan(one) | np.isnan(other))
            assert (np.abs(one - other) <= errors[0] + errors[1])[known].all()
            assert np.median(np.abs(one - other)[known]) < 1e-14
    ratio = tables[0]["traction_condition"][first] / tables[1]["traction_condition"][second]
    assert 0.5 < ratio.min() and ratio.max() < 2.0
