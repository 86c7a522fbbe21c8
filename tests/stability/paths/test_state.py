"""State, model and record of a path by themselves: closed forms by contact, in any unit."""

from types import SimpleNamespace

import numpy as np
import pytest

from loops import (
    GrainGraph,
    HertzMindlin,
    InputError,
    LinearFrictional,
    Regime,
    contact_state,
    polygon_area,
)
from patterns import random_loop, regular_polygon
from stability import Event, programmes
from stability.path import describe
from stability.paths.model import pair_keys, path_model, with_contact
from stability.paths.record import (
    Record,
    Searches,
    expected_regimes,
    record_changes,
    record_fired,
    record_jumps,
    record_start,
)
from stability.paths.regimes import law_marks, rate_vector
from stability.paths.state import (
    FIRST_STRAIN,
    Mode,
    Rates,
    centres,
    first_state,
    initial_state,
    shear_stiffness,
    start_mode,
)
from stability.paths.state_rates import UNIT_PARAMETER, StateRates
from stability.regimes import LEFT, OPEN, RIGHT, STICKS
from tests.oracles.path_rates import displacement_gradient, power, stress_of, velocities

UNITS = [(1.0, 1.0), (2.0**-9, 2.0**30), (2.0**9, 2.0**-30)]
CLOSURES = ("affine", "traction")


def scene(length=1.0, kn=1.0, closure="traction", spins="free", factor=1.5):
    """An irregular loop of unequal grains and unequal friction; `V0` is not the polygon's area."""
    loop = random_loop(5, 3, polydispersity=0.3)
    law = LinearFrictional(
        kn * np.array([1.0, 2.0, 1.5, 0.7, 1.2]), kn * np.array([0.3, 0.2, 0.4, 0.5, 0.6]),
        np.array([0.1, 0.3, 0.2, 0.0, 0.4]),
    )  # fmt: skip
    graph = GrainGraph(
        x=length * loop.x + length, radii=1.02 * length * loop.radii, contacts=loop.contacts
    )
    graph = graph.replace(normal_force=law.normal_force(contact_state(graph)))
    volume = factor * abs(float(polygon_area(graph.x0)))
    return graph, law, path_model(graph, contact_state(graph), law, closure, spins, volume)


def mode_of(*regimes, side=1.0):
    return Mode(np.array(regimes, dtype=np.int8), np.full(len(regimes), side))


def state_of(model, mode, place, T, parameter=0.0, work=(0.0,) * 4):
    """A state with these places, shear forces, parameter and work."""
    y = np.concatenate([np.ravel(place), T, [parameter], work])
    return StateRates(model, y, mode, programmes.isotropic_strain(), UNIT_PARAMETER)


STICK, SLIDE, APART = (int(r) for r in (Regime.ELASTIC, Regime.SLIDING, Regime.OPEN))


@pytest.mark.parametrize("closure", CLOSURES)
@pytest.mark.parametrize(("length", "kn"), UNITS)
def test_places_and_overlaps_of_large_motions(length, kn, closure):
    graph, _, model = scene(length, kn, closure)
    H = np.array([[0.2, 0.1], [-0.05, 0.1]])
    place = H.ravel() if closure == "affine" else -graph.x0 @ H.T
    x = graph.x0 @ (np.eye(2) - H).T
    here = state_of(model, mode_of(*[STICK] * 5), place, np.arange(5.0), 0.7, np.arange(4.0))
    np.testing.assert_allclose(here.x, x, rtol=1e-14)
    np.testing.assert_allclose(displacement_gradient(model, here.y), H.ravel(), atol=1e-14)
    i, j = graph.contacts.T
    d = x[j] - x[i]
    wanted = graph.radii[i] + graph.radii[j] - np.hypot(*d.T)
    np.testing.assert_allclose(here.contacts.overlap, wanted, atol=1e-13 * length)
    np.testing.assert_allclose(here.contacts.length, np.hypot(*d.T), rtol=1e-14)
    np.testing.assert_allclose(here.contacts.length[:, None] * here.contacts.n, d, rtol=1e-13)
    assert here.contacts.shear_force.tolist() == [0, 1, 2, 3, 4] and here.parameter == 0.7
    # Rates leave the contacts as they are.
    overlap = here.contacts.overlap.copy()
    assert here.A.shape == (4, 4)
    np.testing.assert_array_equal(here.answers.contacts.overlap, overlap)


@pytest.mark.parametrize(("length", "kn"), UNITS)
def test_forces_of_contacts_by_their_regime(length, kn):
    """`kn` times the overlap; `T` as integrated, at its strength where it slides, none apart."""
    graph, law, model = scene(length, kn)
    T = 0.01 * kn * length * np.arange(1.0, 6.0)
    mode = mode_of(STICK, SLIDE, APART, SLIDE, STICK, side=-1.0)
    found = state_of(model, mode, np.zeros((5, 2)), T).contacts
    overlap = graph.radii[graph.contacts].sum(axis=1) - model.length0
    N = np.where(np.arange(5) == 2, 0.0, law.kn * overlap)
    np.testing.assert_allclose(found.normal_force, N, rtol=1e-12, atol=1e-14 * kn * length)
    slides = np.isin(np.arange(5), (1, 3))
    wanted = np.where(slides, -law.mu * N, np.where(np.arange(5) == 2, 0.0, T))
    np.testing.assert_allclose(found.shear_force, wanted, rtol=1e-12, atol=1e-14 * kn * length)
    f = N[:, None] * found.n + wanted[:, None] * np.column_stack([-found.n[:, 1], found.n[:, 0]])
    P = sum(np.outer(one, d) for one, d in zip(f, model.d0, strict=True)) / model.volume
    np.testing.assert_allclose(stress_of(model, found), P.ravel(), atol=1e-13 * kn)


def random_rates(model, rng, length, kn):
    return Rates(
        H=rng.normal(size=4), P=kn * rng.normal(size=4), parameter=1.0,
        un=length * rng.normal(size=5), ut=length * rng.normal(size=5),
        normal_force=kn * length * rng.normal(size=5),
        shear_force=kn * length * rng.normal(size=5),
        motion=np.column_stack([length * rng.normal(size=(5, 2)), rng.normal(size=(5, 2))]),
        condition=7.0, trusted=True,
    )  # fmt: skip


@pytest.mark.parametrize(("length", "kn"), UNITS)
def test_powers_contact_by_contact(length, kn):
    graph, law, model = scene(length, kn)
    rates = random_rates(model, np.random.default_rng(1), length, kn)
    T = 0.01 * kn * length * np.arange(1.0, 6.0)
    for regimes in ((STICK, SLIDE, APART, SLIDE, STICK), (STICK,) * 5):
        mode = mode_of(*regimes)
        contacts = state_of(model, mode, np.zeros((5, 2)), T).contacts
        turned = sheared = slipped = 0.0
        for c, (i, j) in enumerate(graph.contacts):
            force = contacts.shear_force[c]
            share = 0.5 * (graph.radii[i] - graph.radii[j])
            arms = 0.5 * contacts.length[c] + np.array([share, -share])
            spins = arms @ rates.motion[c, 2:]
            turned += force * spins
            sheared -= force * (contacts.t[c] @ rates.motion[c, :2] - spins)
            if regimes[c] == SLIDE:
                slipped -= force * (rates.ut[c] + rates.shear_force[c] / law.kt[c])
        work = model.volume * stress_of(model, contacts) @ rates.H
        unit = kn * length**2
        wanted = np.array([work, turned, sheared, slipped]) / unit
        found = power(model, mode, contacts, rates) / unit
        np.testing.assert_allclose(found, wanted, rtol=1e-11, atol=1e-13)
    np.testing.assert_array_equal(shear_stiffness(model, contacts), law.kt)
    smooth = GrainGraph(x=graph.x, radii=graph.radii, contacts=graph.contacts)
    none = path_model(
        smooth, contact_state(graph), LinearFrictional(law.kn, 0.0), "affine", "blocked", None
    )
    assert np.isinf(shear_stiffness(none, contacts)).all()


@pytest.mark.parametrize("closure", CLOSURES)
def test_velocities_and_units_of_rates(closure):
    _, _, model = scene(1.0, 1.0, closure)
    rates = random_rates(model, np.random.default_rng(1), 1.0, 1.0)
    u = np.random.default_rng(2).normal(size=(5, 2))
    i, j = model.contacts.T
    rates.motion[:, :2] = u[j] - u[i]
    wanted = u - u.mean(axis=0)
    if closure == "affine":
        wanted = -model.x0 @ rates.H.reshape(2, 2).T
    np.testing.assert_allclose(velocities(model, rates), wanted, atol=1e-14)
    assert rates.gauge[:4] @ rates.H == pytest.approx(1.0) and rates.gauge[4] == 0.0
    third = rates.scaled(3.0)
    for name in ("H", "P", "parameter", "un", "ut", "normal_force", "shear_force", "motion"):
        np.testing.assert_array_equal(getattr(third, name), 3.0 * np.array(getattr(rates, name)))
    assert third.condition == 7.0 and third.trusted


@pytest.mark.parametrize(("length", "kn"), UNITS)
def test_rates_are_compared_in_units_of_their_own(length, kn):
    _, _, model = scene(length, kn)
    rates = random_rates(model, np.random.default_rng(1), length, kn)
    other = scene()[2]
    same = random_rates(other, np.random.default_rng(1), 1.0, 1.0)
    np.testing.assert_allclose(rate_vector(model, rates), rate_vector(other, same), rtol=1e-13)
    size, stiff = np.sqrt(other.volume), np.mean([1.0, 2.0, 1.5, 0.7, 1.2])
    forces = np.append(same.normal_force, same.shear_force) / (stiff * size)
    wanted = np.concatenate([same.H, same.P / stiff, forces])
    np.testing.assert_allclose(rate_vector(other, same), wanted, rtol=1e-13)


@pytest.mark.parametrize(("length", "kn"), UNITS)
def test_marks_of_laws_are_in_units_of_their_own(length, kn):
    graph, _, model = scene(length, kn)
    plain, plain_law, other = scene()
    found = np.array(law_marks(model, contact_state(graph)))
    wanted = np.array(law_marks(other, contact_state(plain)))
    np.testing.assert_allclose(found, wanted, rtol=1e-13)
    # Stiffnesses and strength at nine tenths of the touching length, by hand.
    unit = plain_law.kn.mean()
    overlap = 0.1 * plain.radii[plain.contacts].sum(axis=1) / other.length
    N = plain_law.kn * overlap / unit
    by_hand = [plain_law.kn / unit, plain_law.kt / unit, plain_law.mu * N, N, -overlap]
    np.testing.assert_allclose(wanted[:5], by_hand, rtol=1e-12)


@pytest.mark.parametrize(("length", "kn"), UNITS)
def test_initial_forces_are_held_to_the_law_in_any_units(length, kn):
    """A billionth of kn times a length is rounding: of shear beyond the strength, of pressure."""
    graph, law, _ = scene(length, kn)
    scale = law.kn.mean() * length
    for share, refused in ((0.2, False), (5.0, True)):
        N = graph.normal_force.copy()
        N[1] += share * 1e-9 * scale * 1.0
        pressed = graph.replace(normal_force=N)
        T = np.zeros(5)
        T[1] = -law.mu[1] * graph.normal_force[1] - share * 1e-9 * scale
        loaded = graph.replace(shear_force=T)
        model = path_model(loaded, contact_state(loaded), law, "affine", "blocked", None)
        if refused:
            with pytest.raises(InputError, match="normal force of contact 1"):
                path_model(pressed, contact_state(pressed), law, "affine", "blocked", None)
            with pytest.raises(InputError, match="shear force of contact 1"):
                start_mode(model, contact_state(loaded))
        else:
            path_model(pressed, contact_state(pressed), law, "affine", "blocked", None)
            mode = start_mode(model, contact_state(loaded))
            assert mode.regime.tolist() == [STICK, SLIDE, STICK, SLIDE, STICK]
            assert mode.side.tolist() == [0.0, -1.0, 0.0, 1.0, 0.0]


@pytest.mark.parametrize("length", [1.0, 2.0**20, 2.0**-20])
def test_branch_vectors_are_held_to_an_affine_image_in_any_units(length):
    graph, law, _ = scene(length)
    image = graph.x0 @ np.array([[0.97, 0.02], [-0.01, 0.98]])
    for off, refused in ((0.0, False), (1e-10, False), (1e-7, True)):
        x = image.copy()
        x[2, 0] += off * length
        moved = graph.replace(x=x)
        moved = moved.replace(normal_force=law.normal_force(contact_state(moved)))
        if refused:
            with pytest.raises(InputError, match="affine image"):
                path_model(moved, contact_state(moved), law, "affine", "blocked", None)
        else:
            model = path_model(moved, contact_state(moved), law, "affine", "blocked", None)
            d = x[graph.contacts[:, 1]] - x[graph.contacts[:, 0]]
            found = model.d0 - model.d0 @ model.first_place.reshape(2, 2).T
            np.testing.assert_allclose(found, d, atol=1e-9 * length)


@pytest.mark.parametrize("closure", CLOSURES)
@pytest.mark.parametrize(("length", "young"), UNITS)
def test_grains_without_stiffness_are_lifted_to_a_first_overlap(length, young, closure):
    """All centres come together by 1e-8; `kn` follows the root of the overlap."""
    loop = regular_polygon(4)
    x0 = length * (loop.x + np.array([1.0, 2.0]))
    law = HertzMindlin(young, 0.3, 0.4)
    turn = np.array([[0.8, -0.6], [0.6, 0.8]])
    graph = GrainGraph(x=x0 @ turn.T, radii=length * loop.radii, contacts=loop.contacts, x0=x0)
    contacts = contact_state(graph)
    model = path_model(graph, contacts, law, closure, "blocked", None)
    lifted, y, atol = first_state(model, contacts)
    x = centres(lifted, y)
    wanted = (1.0 - FIRST_STRAIN) * graph.x
    if closure == "affine":
        wanted = wanted - wanted.mean(axis=0) + x.mean(axis=0)
    np.testing.assert_allclose(x, wanted, rtol=0, atol=1e-14 * length)
    programme = programmes.isotropic_strain()
    here = StateRates(lifted, y, mode_of(*[STICK] * 4), programme, UNIT_PARAMETER)
    overlap = here.contacts.overlap
    np.testing.assert_allclose(overlap / (length * FIRST_STRAIN), 1.0, rtol=1e-6)
    # kn grows as the root of the overlap; between that of a tenth of overlap and of the first.
    ratio = (lifted.stiffness / model.stiffness) ** 2
    assert ratio == pytest.approx(np.sqrt(FIRST_STRAIN / 0.1), rel=1e-6)
    assert atol == pytest.approx(1e-12)
    pressed = graph.replace(radii=1.01 * graph.radii)
    pressed = pressed.replace(normal_force=law.normal_force(contact_state(pressed)))
    contacts = contact_state(pressed)
    model = path_model(pressed, contacts, law, closure, "blocked", None)
    same, y, atol = first_state(model, contacts)
    assert same is model and atol == 0.0
    np.testing.assert_array_equal(y, initial_state(model, contacts))


@pytest.mark.parametrize("factor", [1.0, 1.5])
def test_boundary_vectors_refer_to_the_area_of_the_stress(factor):
    """`sum u (x) b = -V0 H` for `u = -H x`; of a turn by w the work on the normals is V0 w each."""
    graph, _, model = scene(factor=factor)
    centred = graph.x0 - graph.x0.mean(axis=0)
    H = np.array([[0.2, 0.1], [-0.05, 0.1]])
    np.testing.assert_allclose((-centred @ H.T).T @ model.b, -model.volume * H, rtol=0, atol=1e-13)
    nxt, now = np.roll(graph.x0, -1, axis=0), graph.x0
    # Twice the mean of the centroid's places over the polygon's area, by its triangles.
    cross = now[:, 0] * nxt[:, 1] - nxt[:, 0] * now[:, 1]
    centroid = (cross[:, None] * (now + nxt)).sum(axis=0) / (3.0 * cross.sum())
    middle = 0.5 * (now + nxt) - centroid
    outward = np.column_stack([middle[:, 1], -middle[:, 0]])
    ratio = model.volume / abs(0.5 * cross.sum())
    off = min(np.abs(model.m - sign * ratio * outward).max() for sign in (1.0, -1.0))
    assert off < 1e-13


def test_each_pair_of_grains_has_its_own_number():
    _, _, model = scene()
    pairs = np.array([(i, j) for i in range(5) for j in range(5) if i < j])
    keys = pair_keys(model, pairs)
    assert len(np.unique(keys)) == len(pairs)
    np.testing.assert_array_equal(pair_keys(model, pairs[:, ::-1]), keys)


def test_a_new_contact_has_the_branch_of_its_grains():
    graph, _, model = scene()
    more = with_contact(model, np.array([[0, 2], [3, 1]]))
    x = graph.x0
    np.testing.assert_array_equal(more.d0[-2:], [x[2] - x[0], x[1] - x[3]])
    np.testing.assert_array_equal(more.law.kn[-2:], [1.0, 1.0])


# ---- record


class EventList(Record):
    """Record of events alone."""

    def event(self, kind, parameter, contacts=(), **facts):
        event = Event(kind, parameter, contacts=contacts, **facts)
        self.events.append((kind, contacts, describe(event), event.subspace))


def end_of(*fired, pairs=(), shear=(), A=None):
    contacts = SimpleNamespace(shear_force=np.array(shear, dtype=float))
    here = SimpleNamespace(parameter=0.5, contacts=contacts, A=np.eye(4) if A is None else A)
    return SimpleNamespace(fired=list(fired), here=here, pairs=np.array(pairs).reshape(-1, 2))


def test_events_of_eigenvalues_are_told_by_subspace():
    """Four a subspace: two of the first one, one of the second."""
    record = EventList()
    fired = [("det_Ks_zero", 0), ("det_Ks_zero", 3), ("det_Ks_zero", 5), ("det_K_zero", 6)]
    record_fired(record, end_of(*fired), ("full", "symmetric"))
    assert record.events == [
        ("det_Ks_zero", (), "2 eigenvalues at once", "full"),
        ("det_Ks_zero", (), "", "symmetric"),
        ("det_K_zero", (), "", "symmetric"),
    ]
    turning = np.diag([0.0, 1.0, 1.0, 0.0])
    turning[0, 3], turning[3, 0] = -1.0, 1.0
    flutter = EventList()
    record_fired(flutter, end_of(("det_K_zero", 0), A=turning), ("full",))
    assert flutter.events == [("flutter", (), "", "full")]


def test_events_at_the_end_of_a_segment():
    record = EventList()
    fired = [("opposite_contact", 1), ("opposite_contact", 0), ("yield", 3), ("yield", 4)]
    record_fired(record, end_of(*fired, pairs=[[0, 2], [1, 3]]), ())
    assert [(kind, who) for kind, who, *_ in record.events] == [
        ("opposite_contact", (1, 3)), ("opposite_contact", (0, 2))
    ]  # fmt: skip
    record.events.clear()
    record_fired(record, end_of(("stage_end", -1), *fired[2:], ("opening", 1)), ())
    assert [(kind, who) for kind, who, *_ in record.events] == [
        ("yield", (3, 4)), ("opening", (1,))
    ]  # fmt: skip
    for name, detail in (("control_limit", "extremum"), ("singular", "singular")):
        record.events.clear()
        record_fired(record, end_of((name, -1)), ())
        ((kind, _, found, _),) = record.events
        assert kind == "control_limit" and detail in found


def test_regimes_that_events_let_expect():
    fired = [("yield", 0), ("yield", 1), ("unloading", 2), ("opening", 3), ("closing", 4)]
    end = end_of(*fired, ("stage_end", -1), shear=[0.2, -0.2, 0.1, 0.0, 0.0])
    assert expected_regimes(end) == {0: LEFT, 1: RIGHT, 2: STICKS, 3: OPEN, 4: STICKS}


def test_changes_of_regime_are_told_by_their_kind():
    before = [STICK, SLIDE, STICK, SLIDE, APART, APART, STICK, SLIDE, APART]
    after = [SLIDE, STICK, APART, APART, STICK, SLIDE, STICK, SLIDE, APART]
    record = EventList()
    record_changes(record, mode_of(*before), mode_of(*after), 0.0, SimpleNamespace(status="unique"))
    assert [(kind, who) for kind, who, *_ in record.events] == [
        ("yield", (0,)), ("unloading", (1,)), ("opening", (2, 3)), ("closing", (4, 5))
    ]  # fmt: skip


def test_contacts_that_slide_from_the_start():
    """Without friction they always do: that is no event."""
    _, _, model = scene()
    record = EventList()
    record_start(record, model, mode_of(SLIDE, STICK, SLIDE, SLIDE, APART))
    assert record.events == [("yield", (0, 2), "from the start", "")]
    record_start(empty := EventList(), model, mode_of(STICK, STICK, STICK, SLIDE, APART))
    assert empty.events == []


def test_jumps_of_one_sign_are_none():
    """Two eigenvalues change at once: the determinant keeps its sign, their count does not."""
    record = EventList()
    record_jumps(record, np.eye(4), np.diag([-1.0, -2.0, 1.0, 1.0]), 0.0, ("full",))
    assert [kind for kind, *_ in record.events] == ["det_Ks_zero"]
    record_jumps(quiet := EventList(), np.eye(4), np.full((4, 4), np.nan), 0.0, ("full",))
    assert quiet.events == []


def test_rows_and_events_of_a_record():
    _, law, model = scene(1.0, 1.0, "affine", "blocked")
    T = 0.01 * np.array([1.0, -2.0, 3.0, -1.0, 2.0])
    place = np.array([0.02, 0.0, 0.0, 0.03])
    mode = mode_of(STICK, STICK, APART, STICK, STICK)
    here = state_of(model, mode, place, T, 0.3, np.arange(4.0))
    record = Record(stage=2)
    record.row(model, here)
    (row,) = record.rows
    N, T = here.contacts.normal_force, here.contacts.shear_force
    assert N[2] == T[2] == 0.0 and row["parameter"] == 0.3 and row["stage"] == 2
    kept = np.arange(5) != 2
    assert row["normal_energy"] == pytest.approx((N[kept] ** 2 / (2 * law.kn[kept])).sum())
    assert row["tangential_energy"] == pytest.approx((T[kept] ** 2 / (2 * law.kt[kept])).sum())
    record.row(model, here)
    record.row(model, here)
    for k in (0, 1):
        record.rows[k] = {**row, "H": np.ones(4)}
    record.event("yield", 0.3, (1,))
    record.branching(here)
    for event in record.events:
        assert event.index == 2 and event.H == tuple(place) and event.stage == 2
    # Contacts that are added later are open before.
    more = with_contact(model, np.array([[0, 2]]))
    path = record.path(more, "finished", "", "full", None)
    assert path.regime.tolist() == [[STICK, STICK, APART, STICK, STICK, APART]] * 3
    np.testing.assert_array_equal(path.normal_force[:, :5], [N, N, N])
    assert (path.normal_force[:, 5] == 0).all() and (path.shear_force[:, 5] == 0).all()


def test_counts_of_rate_problems():
    searches = Searches()
    for tried, combinations in ((1, 1), (1, 1), (3, 4), (5, 9.0)):
        searches.add(SimpleNamespace(tried=tried, combinations=combinations))
    assert str(searches) == (
        "skipped in 2 of 4 rate problems; 8 of 13 combinations tried in the other 2"
    )
