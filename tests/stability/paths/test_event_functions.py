"""Event functions of paths where strain shears, forces carry T, and units or origin differ."""

from types import SimpleNamespace

import numpy as np
import pytest

from loops import GrainGraph, LinearFrictional, Regime, Scene, contact_state, macroscopic_tangent
from patterns import diamond, regular_polygon
from stability import Event, Stage, follow, programmes, restrict, symmetric_spectrum
from stability.path import describe
from stability.paths import ring_rates
from stability.paths.model import path_model
from stability.paths.record import record_changes, record_jumps
from stability.paths.regimes import path_symmetry
from stability.paths.state import Mode, initial_state, pair_overlaps
from stability.programmes import area_ratio
from stability.spectra import subspace_basis
from tests.oracles.path_rates import spectra

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


def test_area_ratio_is_the_determinant_of_a_sheared_loop():
    for H in np.random.default_rng(3).uniform(-0.9, 0.9, (5, 4)):
        expected = np.linalg.det(np.eye(2) - H.reshape(2, 2))
        assert area_ratio(H) == pytest.approx(expected, abs=1e-15)
    # F = ((1, -1), (-1, 1)) is a line.
    assert area_ratio(np.array([0.0, 1.0, 1.0, 0.0])) == 0.0


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


class EventList:
    """Record of events alone."""

    def __init__(self):
        self.events = []

    def event(self, kind, parameter, contacts=(), **facts):
        event = Event(kind, parameter, contacts=contacts, **facts)
        self.events.append((kind, contacts, describe(event)))


@pytest.mark.parametrize("size", [1e-9, 1.0, 1e9])
def test_a_jump_counts_negative_eigenvalues(size):
    before, after = size * np.diag([1.0, 2, 3, 4]), size * np.diag([-1.0, 2, 3, 4])
    record = EventList()
    record_jumps(record, before, after, 0.0, ("full",))
    assert [kind for kind, _, _ in record.events] == ["det_Ks_zero", "det_K_zero"]
    assert record.events[0][2] == "jump: 0 to 1 negative eigenvalues"
    record_jumps(quiet := EventList(), before, 2 * before, 0.0, ("full",))
    record_jumps(quiet, before, size * np.diag([0.0, 2, 3, 4]), 0.0, ("full",))
    assert quiet.events == []


@pytest.mark.parametrize(
    ("status", "detail"), [("unique", ""), ("several", "the rate problem has 2 solutions")]
)
def test_several_solutions_are_stated_in_the_event(status, detail):
    old = Mode(np.array([Regime.ELASTIC] * 2, dtype=np.int8), np.zeros(2))
    new = Mode(np.array([Regime.ELASTIC, Regime.SLIDING], dtype=np.int8), np.array([0.0, 1.0]))
    problem = SimpleNamespace(status=status, solutions=[None, None])
    record_changes(record := EventList(), old, new, 0.0, problem)
    assert record.events == [("yield", (1,), detail)]


@pytest.mark.parametrize("size", [1e-9, 1.0, 1e9])
def test_watched_eigenvalues_are_over_the_size_of_the_operator(size):
    """Those of Ks ascend, then real parts of those of K; none of an operator that vanishes."""
    A = np.diag([1.0, -2.0, 3.0, 4.0]) + np.triu(np.full((4, 4), 0.5), 1)
    subspaces = ("diagonal", "symmetric", "full")
    spaces = [subspace_basis(one) for one in subspaces]
    bases = np.array([np.pad(one, ((0, 4 - len(one)), (0, 0))) for one in spaces])
    count = 2 * sum(map(len, spaces))
    for operator in (size * A, 0.0 * A):
        small = np.zeros((ring_rates.ROWS, 9))
        small[ring_rates.TANGENT : ring_rates.TANGENT + 4, :4] = operator
        watch = np.full((count, 2), ring_rates.SYMMETRIC_SPECTRUM)
        problem = SimpleNamespace(
            watch=watch, spaces=np.array([len(one) for one in spaces]), bases=bases, small=small
        )
        ring_rates.write_spectra(problem, found := np.zeros(count))
        wanted = (
            [spectra(A, one) for one in subspaces] if operator.any() else [np.full(count, np.nan)]
        )
        np.testing.assert_allclose(found, np.concatenate(wanted), rtol=0, atol=1e-15)


def group_of(graph, law, shear=0.0, side=None):
    model = path_model(graph, contact_state(graph), law, "affine", "blocked", None)
    y = initial_state(
        model, contact_state(graph.replace(shear_force=np.array([shear, 0.0, 0.0, 0.0])))
    )
    kind = Regime.ELASTIC if side is None else Regime.SLIDING
    mode = Mode(np.full(4, kind, dtype=np.int8), np.zeros(4) if side is None else np.array(side))
    return path_symmetry(model, y, mode, [programmes.isotropic_strain()])


def test_sides_count_only_where_there_is_friction():
    square = regular_polygon(4)
    smooth, rough = (LinearFrictional(kn=1.0, kt=0.2, mu=mu) for mu in (0.0, 0.3))
    assert group_of(square, smooth, side=[1.0, 1.0, 1.0, 1.0]).name == "D4"
    assert group_of(square, rough, side=[1.0, 1.0, 1.0, 1.0]).name == "C4"


@pytest.mark.parametrize(("length", "kn"), [(1e-3, 1e-3), (1.0, 1.0), (1e3, 1e3)])
def test_shear_that_breaks_the_symmetry_does_so_in_any_units(length, kn):
    law = LinearFrictional(kn=kn, kt=0.2 * kn)
    square = scaled(regular_polygon(4), length)
    assert group_of(square, law).name == "D4"
    assert group_of(square, law, shear=1e-18 * kn * length).name == "D4"
    assert group_of(square, law, shear=1e-10 * kn * length) is None


@pytest.mark.parametrize("length", [1e-3, 1.0, 1e3])
def test_overlaps_are_in_the_unit_of_the_touching_distance(length):
    """Grains of .3 and .2 at distances .4 and .6: a fifth of overlap, a fifth of gap."""
    model = SimpleNamespace(radii=length * np.array([0.3, 0.2, 0.3]))
    x = length * np.array([[0.0, 0.0], [0.24, 0.32], [0.24, 0.92]])
    found = pair_overlaps(model, np.array([[0, 1], [1, 2]]), x)
    np.testing.assert_allclose(found, [0.2, -0.2], rtol=0, atol=1e-14)
