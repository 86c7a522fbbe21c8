"""Decisions of a loop's path between its segments, with segments and rate problems made by hand."""

from types import SimpleNamespace

import numpy as np
import pytest

from loops import LinearFrictional, Regime
from patterns import diamond, regular_polygon
from stability import Event, Stage, programmes
from stability.paths import loop_path
from stability.paths.loop_path import CHATTER, REACHED, RETRIES, UNMOVED
from stability.paths.state import Mode, scales
from stability.paths.state_rates import UNIT_PARAMETER
from stability.regimes import LEFT, OPEN, STICKS
from tests.stability.paths.test_loop_path import STAGE, UNITS, solver_of, square

UNIQUE = SimpleNamespace(status="unique")
BASE = np.array([0.3, 0.1, -0.2, 0.5])


def state_at(H, rate=0.5):
    rates = SimpleNamespace(H=np.array([rate, 0, 0, 0]), P=np.zeros(4), parameter=1.0)
    return SimpleNamespace(H=H, P=np.zeros(4), rates=rates, gauge=UNIT_PARAMETER)


def with_segments(monkeypatch, solver, moves, fired=("yield", 0), here=None):
    """The solver meets an event after each of these moves of `H`; what each segment was given."""
    here, given, left = here or state_at(BASE), [], iter(moves)

    def segment(stage, start, sense, reach, here):
        given.append((start, sense, reach))
        moved = here.H + next(left) * np.array([0.0, 0.0, -1.0, 0.0])
        end = SimpleNamespace(H=moved, y=solver.y)
        return SimpleNamespace(here=end, steps=1, fired=[fired], message="", pairs=())

    solver.record.row = lambda *row: None
    monkeypatch.setattr(solver, "_rate_problem", lambda *problem: UNIQUE)
    monkeypatch.setattr(solver, "_take_regimes", lambda *problem: here)
    monkeypatch.setattr(solver, "_run_segment", segment)
    monkeypatch.setattr(solver, "_take_on_contacts", lambda end: None)

    def told(kind, parameter, contacts=(), **facts):
        solver.record.events.append(Event(kind, parameter, contacts=contacts, **facts))

    monkeypatch.setattr(solver.record, "event", told)
    monkeypatch.setattr(loop_path, "record_fired", lambda *event: None)
    monkeypatch.setattr(loop_path, "expected_regimes", lambda end: {2: LEFT, 0: OPEN})
    return given


@pytest.mark.parametrize(("move", "counts"), [(0.5 * UNMOVED, False), (2.0 * UNMOVED, True)])
def test_rate_problems_without_progress_end_the_stage(monkeypatch, move, counts):
    """The strain grows again after twelve of them; after thirteen in a row it is given up."""
    solver = solver_of(*square(1.0, 1.0, 0.02), "affine")
    moves = [0.0] * CHATTER + [move] + [0.0] * (CHATTER + 1)
    given = with_segments(monkeypatch, solver, moves)
    status, message = solver.follow_stage(0, STAGE)
    assert status == "no_solution" and "contacts [0, 2] have no regime" in message
    assert len(given) == (len(moves) if counts else CHATTER + 1)


@pytest.mark.parametrize("rate", [0.5, -0.5, 0.0])
def test_the_length_of_a_stage_is_judged_from_its_start(monkeypatch, rate):
    """From H11 = 0.3 to 0.1, at half a unit of H11 per unit of the length of H."""
    solver = solver_of(*square(1.0, 1.0, 0.02))
    stage = Stage(programmes.isotropic_strain(-1.0), "H11", -0.7)
    given = with_segments(monkeypatch, solver, [1.0], ("stage_end", -1), state_at(BASE, rate))
    assert solver.follow_stage(0, stage)[0] == "finished"
    assert given == [(0.0, -1.0, 2.0 if rate else np.inf)]


@pytest.mark.parametrize(("length", "kn"), UNITS)
def test_a_target_that_is_reached_ends_the_stage_in_any_units(monkeypatch, length, kn):
    """To 1e-15, in strain or in stress over kn; the first stage has a row to begin with."""

    def asked(*problem):
        raise LookupError

    graph, law = square(length, kn, 0.02)
    for programme, quantity, unit in (
        (programmes.isotropic_stress(), "P22", kn), (programmes.isotropic_strain(), "H22", 1.0),
    ):  # fmt: skip
        for share in (0.4, 4.0, -0.4, -4.0):
            solver = solver_of(graph, law)
            monkeypatch.setattr(solver, "_rate_problem", asked)
            here = solver.at(programme)
            value = here.P[3] if quantity == "P22" else here.H[3]
            stage = Stage(programme, quantity, value + share * REACHED * unit)
            with pytest.raises(LookupError):
                solver.follow_stage(0, stage)
            solver.record.row(solver.model, here)
            if abs(share) < 1.0:
                assert solver.follow_stage(1, stage) == loop_path.FINISHED
            else:
                with pytest.raises(LookupError):
                    solver.follow_stage(1, stage)


def segments_of(monkeypatch, solver, stage, reach, fired):
    """Segments that are tried from a state of `H` up to 0.02, each of which ends by `fired`."""
    tried = []

    def follow(start, functions, how, row, branching):
        tried.append(how)
        solver.record.rows.append({})
        solver.record.events.append(len(tried))
        return SimpleNamespace(fired=fired, steps=1)

    monkeypatch.setattr(loop_path, "follow_segment", follow)
    here = SimpleNamespace(H=np.array([0.01, 0.0, 0.0, -0.02]), gauge=UNIT_PARAMETER)
    solver._run_segment(stage, 0.0, 1.0, reach, here)
    return tried


@pytest.mark.parametrize(
    ("reach", "size", "max_step", "row_step"),
    [
        (0.16, 0.16, 0.02, 0.04),
        (0.008, 0.02, 0.001, 0.002),
        (3.0, 1.0, 0.05, 0.25),
        (np.inf, 1.0, 0.05, 0.25),
    ],
)
@pytest.mark.parametrize(("length", "kn"), UNITS)
def test_steps_and_tolerances_of_a_segment(
    monkeypatch, length, kn, reach, size, max_step, row_step
):
    """Of the size of the strains of the stage; an eighth and, by the rows, a fourth of it."""
    solver = solver_of(*square(length, kn, 0.02))
    solver.rows = 4
    (how,) = segments_of(monkeypatch, solver, STAGE, reach, [("yield", 0)])
    assert how.size == size
    assert how.max_step == pytest.approx(max_step)
    assert how.row_step == pytest.approx(row_step)
    np.testing.assert_allclose(how.atol, 1e-14 * size * scales(solver.model), rtol=1e-14)
    force = kn * solver.model.length
    wanted = [length] * 8 + [force] * 4 + [1.0] + [force * length] * 4
    natural = scales(solver.model) / np.array(wanted)
    np.testing.assert_allclose(natural, [solver.model.length / length] * 8 + [1.0] * 5
                               + [solver.model.length / length] * 4, rtol=1e-14)  # fmt: skip


@pytest.mark.parametrize(
    ("programme", "fired", "tries"),
    [
        (programmes.isotropic_strain(), [("singular", -1)], 4),
        (programmes.isotropic_strain(), [], 4),
        (programmes.isotropic_strain(), [("yield", 1)], 1),
        (programmes.isotropic_stress(), [("singular", -1)], 1),
        (programmes.isotropic_stress(), [], 1),
    ],
)
def test_steps_of_other_lengths_pass_a_singular_state(monkeypatch, programme, fired, tries):
    """Where strain alone drives; of the tries before the last one nothing is recorded."""
    solver = solver_of(*square(1.0, 1.0, 0.02))
    solver.record.rows[:], solver.record.events[:] = [{}, {}], [-1]
    stage = Stage(programme, "parameter", 1.0)
    segments = segments_of(monkeypatch, solver, stage, 0.16, fired)
    steps = [how.max_step for how in segments]
    assert steps == pytest.approx([0.02 * shorter for shorter in RETRIES[:tries]])
    assert len(solver.record.rows) == 3 and solver.record.events == [-1, tries]


@pytest.mark.parametrize(("length", "kn"), UNITS)
def test_what_a_parting_contact_stores_is_dissipated(length, kn):
    """N^2 over 2 kn along it, and T^2 over 2 kt of its shear; those that stay keep theirs."""
    graph, law = square(length, kn, 0.02)
    solver = solver_of(graph, law, "affine")
    shear = 1e-3 * kn * length * np.array([1.0, 2.0, -3.0, 4.0])
    before = kn * length**2 * np.array([5.0, 6.0, 7.0, 8.0])
    solver.y = np.concatenate([solver.y[:4], shear, [0.25], before])
    solver.mode = Mode(
        np.array([Regime.ELASTIC, Regime.ELASTIC, Regime.ELASTIC, Regime.OPEN], dtype=np.int8),
        np.zeros(4),
    )
    N = solver.at(STAGE.programme).contacts.normal_force
    new = Mode(
        np.array([Regime.ELASTIC, Regime.OPEN, Regime.OPEN, Regime.OPEN], dtype=np.int8),
        np.zeros(4),
    )
    trial = SimpleNamespace(mode=new, rates=SimpleNamespace(gauge=UNIT_PARAMETER))
    problem = SimpleNamespace(taken=SimpleNamespace(rates=trial), status="unique")
    solver._take_regimes(STAGE, problem, None)
    stored = (N[1:3] ** 2).sum() / (2 * kn)
    sheared = (shear[1:3] ** 2).sum() / (2 * 0.3 * kn)
    wanted = [0.0, 0.0, stored, stored + sheared]
    np.testing.assert_allclose((solver.y[-4:] - before) / (kn * length**2),
                               np.array(wanted) / (kn * length**2), rtol=0, atol=1e-14)  # fmt: skip
    assert stored > 1e-4 * kn * length**2 and sheared > 1e-6 * kn * length**2
    np.testing.assert_array_equal(solver.y[4:8], [shear[0], 0.0, 0.0, 0.0])
    assert solver.parameter == 0.25 and len(solver.record.rows) == 1
    # Regimes that stay give no second row.
    here = solver.at(STAGE.programme)
    solver._take_regimes(STAGE, problem, here)
    assert len(solver.record.rows) == 1
    some = Mode(np.where(np.arange(4) == 0, Regime.OPEN, new.regime).astype(np.int8), np.zeros(4))
    trial.mode = some
    solver._take_regimes(STAGE, problem, here)
    assert len(solver.record.rows) == 2


@pytest.mark.parametrize("agrees", [True, False])
def test_a_control_that_turns_back_has_an_extremum(monkeypatch, agrees):
    """Where the regimes of the events agree with a falling parameter, all of them."""
    solver, gauges = solver_of(*square(1.0, 1.0, 0.02), "affine"), []
    regime = np.array([Regime.OPEN, Regime.ELASTIC, Regime.SLIDING, Regime.ELASTIC], dtype=np.int8)
    one = SimpleNamespace(rates=SimpleNamespace(mode=Mode(regime, np.zeros(4))))

    def backwards(here, **kwargs):
        gauges.append(here.gauge)
        return SimpleNamespace(solutions=[one])

    monkeypatch.setattr(loop_path, "edge_problem", backwards)
    none = SimpleNamespace(singular=0, exhaustive=True, combinations=2.0)
    expected = {0: OPEN, 1: STICKS} if agrees else {0: OPEN, 1: LEFT}
    status, message = solver._no_continuation(STAGE, none, expected)
    assert (status, "extremum" in message) == (
        ("control_limit", True) if agrees else ("no_solution", False)
    )
    (gauge,) = gauges
    assert gauge @ np.append(np.zeros(4), 1.0) == -1.0 and (gauge[:4] == 0).all()


def test_a_direction_is_kept_while_the_contacts_stay_the_same(monkeypatch):
    solver, directions = solver_of(*square(1.0, 1.0, 0.02), "affine"), []
    monkeypatch.setattr(
        solver, "_solve", lambda model, stage, expected, way: directions.append(way) or UNIQUE
    )
    here = solver.at(STAGE.programme)
    assert solver._rate_problem(STAGE, {}, None) is UNIQUE
    solver._rate_problem(STAGE, {}, here)
    fewer = SimpleNamespace(mode=SimpleNamespace(regime=np.zeros(3)), rates=here.rates)
    solver._rate_problem(STAGE, {}, fewer)
    first, same, other = directions
    assert first is None and other is None
    np.testing.assert_array_equal(same[:4], here.rates.H)


@pytest.mark.parametrize("goes_on", [True, False])
def test_a_symmetry_is_given_up_where_only_the_full_model_goes_on(monkeypatch, goes_on):
    solver = solver_of(regular_polygon(4), LinearFrictional(1.0, 0.2, 0.3))
    solver.find_symmetry()
    none, tried = SimpleNamespace(status="none"), []

    def solve(model, *problem):
        tried.append(model.symmetry)
        return none if model.symmetry is not None or not goes_on else UNIQUE

    monkeypatch.setattr(solver, "_solve", solve)
    group = solver.model.symmetry
    found = solver._rate_problem(STAGE, {}, None)
    assert group is not None and tried == [group, None]
    assert found is (UNIQUE if goes_on else none)
    assert (solver.model.symmetry is None) == goes_on
    assert solver.symmetry_kept.startswith("given up at parameter 0") == goes_on
    # Without a symmetry there is no second try.
    tried.clear()
    if goes_on:
        assert solver._rate_problem(STAGE, {}, None) is UNIQUE and tried == [None]


@pytest.mark.parametrize(
    ("common", "own", "stages", "kept", "taken"),
    [
        (2, 4, 2, loop_path.SYMMETRY_KEPT, 4),
        (2, 2, 2, loop_path.SYMMETRY_KEPT, "common"),
        (None, 2, 2, loop_path.SYMMETRY_KEPT, 2),
        (4, 2, 2, loop_path.SYMMETRY_KEPT, "common"),
        (2, None, 2, loop_path.SYMMETRY_KEPT, "common"),
        (2, 4, 1, loop_path.SYMMETRY_KEPT, "before"),
        (2, 4, 2, "given up", "before"),
    ],
)
def test_a_stage_may_keep_a_larger_symmetry_than_all_together(
    monkeypatch, common, own, stages, kept, taken
):
    solver = solver_of(*square(1.0, 1.0))
    before = SimpleNamespace(order=8)
    common, own = (
        None if order is None else SimpleNamespace(order=order) for order in (common, own)
    )
    solver.programmes = (STAGE.programme,) * stages
    solver.common, solver.symmetry_kept = common, kept
    solver.model = loop_path.replace(solver.model, symmetry=before)
    monkeypatch.setattr(solver, "_symmetry", lambda programmes: own)
    solver._start_stage(0, STAGE)
    known = {"common": common, "before": before}
    found = solver.model.symmetry
    assert found is (known[taken] if taken in known else own)


@pytest.mark.parametrize(
    ("fired", "how", "status"),
    [
        ("collapse", "ignore", "lost"),
        ("stage_end", "ignore", "finished"),
        ("singular", "ignore", "control_limit"),
        ("control_limit", "ignore", "control_limit"),
        ("opposite_contact", "stop", "opposite_contact"),
        ("opposite_contact", "add", None),
        ("yield", "stop", None),
    ],
)
def test_events_that_end_a_stage(fired, how, status):
    solver = solver_of(*square(1.0, 1.0, 0.02), "affine", contact_on_touch=how)
    end = SimpleNamespace(fired=[(fired, 0)], pairs=np.array([[0, 2]]))
    found = solver._outcome(STAGE, end)
    assert (found and found[0]) == status


def test_grains_that_touch_are_watched_no_more():
    graph = diamond(np.radians(40.0))
    law = LinearFrictional(1.0, 0.2, 0.3)
    for how in ("ignore", "add"):
        solver = solver_of(graph, law, contact_on_touch=how, model="full")
        met, y = len(solver.model.met), solver.y
        none = SimpleNamespace(fired=[("yield", 0)], pairs=np.array([[1, 3]]))
        solver._take_on_contacts(none)
        assert len(solver.model.met) == met and solver.y is y
        solver._take_on_contacts(SimpleNamespace(fired=[("opposite_contact", 0)], pairs=none.pairs))
        assert len(solver.model.met) == met + 1
        assert solver.model.contact_count == 4 + (how == "add")
        assert len(solver.y) == solver.model.size == len(y) + (how == "add")
