"""Event functions of paths where strain shears, forces carry T, and units or origin differ."""

import numpy as np
import pytest

from loops import GrainGraph, LinearFrictional, Scene, macroscopic_tangent
from patterns import diamond, regular_polygon
from stability import Stage, follow, programmes, restrict, symmetric_spectrum

CLOSURES = ("affine", "traction")
ELASTIC = LinearFrictional(kn=1.0, kt=0.2)
SHEAR = programmes.combination(np.zeros((4, 4)), np.eye(4), [0.3, 1, 0.4, -0.2], "shear")


def isotropic(E):
    return Stage(programmes.isotropic_strain(), "H11", E)


def closest_to_zero(values):
    return float(values[np.abs(values).argmin()])


@pytest.mark.parametrize("closure", CLOSURES)
@pytest.mark.parametrize(
    ("alpha0", "subspace", "programme", "last"),
    [
        (45.0, "diagonal", programmes.oedometric(), 0.245),
        pytest.param(45.0, "symmetric", programmes.oedometric(), 0.245, marks=pytest.mark.slow),
        (50.0, "full", SHEAR, 0.105),
    ],
)
def test_symmetric_part_vanishes_where_contacts_carry_shear(
    closure, alpha0, subspace, programme, last
):
    graph = diamond(np.radians(alpha0))
    quantity = "H12" if programme is SHEAR else "H11"

    def through(*ends):
        stages = [isotropic(0.1), *(Stage(programme, quantity, end) for end in ends)]
        return follow(Scene(graph, ELASTIC), stages, closure=closure, subspace=subspace)

    def smallest(path, row):
        state = graph.replace(
            x=path.x[row], normal_force=path.normal_force[row], shear_force=path.shear_force[row]
        )
        A = macroscopic_tangent(state, ELASTIC, closure, regime=path.regime[row]).matrix
        return float(symmetric_spectrum(restrict(A, subspace))[0])

    path = through(last)
    (event,) = path.of_kind("det_Ks_zero")
    K = restrict(path.A[event.index], subspace)
    norm = np.linalg.norm(K)
    assert np.abs(path.shear_force[event.index]).max() > 0.01
    # T makes K nonsymmetric: neither its triangle nor its determinant tells.
    assert np.abs(K - K.T).max() > 1e-3 * norm
    assert abs(closest_to_zero(np.linalg.eigvalsh(0.5 * (K + K.T)))) < 1e-12 * norm
    # Stages that end just before and behind have one sign each.
    met = path.H[event.index, ("H11", "H12").index(quantity)]
    path = through(met - 1e-10, met + 1e-10)
    assert smallest(path, np.flatnonzero(path.stage == 1)[-1]) > 0 > smallest(path, -1)


def scaled(graph, length):
    return GrainGraph(x=length * graph.x, radii=length * graph.radii, contacts=graph.contacts)


def opening_and_closing():
    out = Stage(programmes.oedometric(rate=-1), "H11", -0.2)
    return [isotropic(0.1), out, Stage(programmes.oedometric(), "H11", 0.1)]


CASES = {
    "opening": (regular_polygon(4), opening_and_closing(), {}),
    "yield": (diamond(0.8), [isotropic(0.1), Stage(programmes.drained_biaxial(), "H11", 0.2)], {}),
    "added": (diamond(np.radians(35)), [isotropic(0.2)], {"contact_on_touch": "add"}),
    "added at once": (diamond(np.radians(60)), [isotropic(0.1)], {"contact_on_touch": "add"}),
    "free spins": (regular_polygon(5), [isotropic(0.1), Stage(SHEAR, "H12", 0.02)],
                   {"spins": "free"}),
}  # fmt: skip


SMALL, LARGE = ("affine", 1e-3, 1e6), ("traction", 1e3, 1e-3)


@pytest.mark.parametrize(
    ("case", "units"),
    [
        *((case, SMALL) for case in ("opening", "yield", "added", "added at once", "free spins")),
        ("yield", LARGE),
        # The loop that has opened has no stiffness: the sign of its determinant is rounding.
        ("opening", LARGE),
        *(
            pytest.param(case, LARGE, marks=pytest.mark.slow)
            for case in ("added", "added at once", "free spins")
        ),
    ],
)
def test_events_are_the_same_in_other_units(case, units):
    (closure, length, kn), (graph, stages, options) = units, CASES[case]
    mu = np.tan(np.radians(6.0 if case == "yield" else 30.0))
    plain = follow(
        Scene(graph, LinearFrictional(kn=1.0, kt=0.2, mu=mu)), stages, closure=closure, **options
    )
    law = LinearFrictional(kn=kn, kt=0.2 * kn, mu=mu)
    path = follow(Scene(scaled(graph, length), law), stages, closure=closure, **options)
    found = [(event.kind, event.contacts) for event in path.events]
    assert found == [(event.kind, event.contacts) for event in plain.events]
    assert case != "yield" or "yield" in [kind for kind, _ in found]
    assert np.abs(path.energy_error).max() < 1e-12
    for event, other in zip(path.events, plain.events, strict=True):
        np.testing.assert_allclose(path.H[event.index], plain.H[other.index], atol=1e-11)
    np.testing.assert_allclose(path.P[-1] / kn, plain.P[-1], atol=1e-11)
    np.testing.assert_allclose(
        path.shear_force[-1] / (kn * length), plain.shear_force[-1], atol=1e-11
    )
