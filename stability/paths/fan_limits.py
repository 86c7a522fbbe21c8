"""First limits of many programmes of one loop, followed together."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import ArrayLike

from loops import GrainGraph, Regime, Scene, boundary_of
from loops.arrays import Flags, Floats, Integers, Regimes
from loops.closures import Spins
from stability.paths.fan import Fan, LoopStates, stability_measures
from stability.paths.loop_path import LoopPathOptions
from stability.paths.of_graph import follow_loop
from stability.paths.regimes import edge_problem
from stability.paths.state import Mode, PathState
from stability.programmes import Stage, proportional_strain, proportional_stress
from stability.spectra import restrict

CONTROLS = {"strain": proportional_strain, "stress": proportional_stress}
# Limits of a programme, in the order in which they are told.
SPECTRAL = ("cone_opening", "det_Ks_zero", "det_K_zero")
LIMITS = (*SPECTRAL, "yield", "opening", "branching", "limit")
# Longest step in the space of H, over the reach of the programmes.
MAX_STEP = 0.04
# Share of a first step before which no event is looked for: at the first touch all forces are zero,
# and a contact that sticks again is at its strength.
BEGUN = 1e-4
# Steps after which a programme without a limit is left to `follow`.
MOST_FAN_STEPS = 600
# Halvings that locate an event: as many as a number has bits, so to the rounding of a step.
EVENT_HALVINGS = 52
# Newton's steps that follow on the states that are integrated to.
EVENT_POLISHES = 3
# Half the distance, in shares of a step, over which the slope of an event function is taken.
SLOPE_WIDTH = 1e-4
# Stress over kn at which a programme of stress ends that `follow` takes, over its reach in strain.
STRESS_REACH = 5.0
# Event functions this close to zero where another one vanishes do so there too.
COINCIDENT = 1e-13
# A normalised eigenvalue or rate this small is zero.
SINGULAR_RTOL = 1e-12
# What |T| of the first state may lack to the strength, over it, where a contact is at yield.
YIELD_RTOL = 1e-9
# Overlap of the first state over r_i + r_j up to which a contact just touches.
TOUCHING_GAP = 1e-11
# A programme along which both strains are equal to this is isotropic: several modes go singular.
ISOTROPIC_RTOL = 1e-9
# Shortest step, over the reach of the programmes; below, the question is left to `follow`.
SHORTEST_STEP = 1e-9
# Event functions of states on the programmes of some rows, see `Fan.functions`.
Pending = Callable[[LoopStates, Integers], tuple[Floats, dict[str, slice]]]


@dataclass(frozen=True, eq=False)
class FanLimits:
    """First limits along the programmes of a fan.

    `found` (B,) and `states` by kind, see `LIMITS`; of a limit reached in a jump the regimes are
    those after it. `open_question` (B,): Programmes without an answer yet, for `follow`. `end`:
    Last states of the programmes, where they are kept.
    """

    found: dict[str, Flags]
    states: dict[str, LoopStates]
    open_question: Flags
    end: LoopStates | None = None

    @classmethod
    def none(cls, programmes: int, contacts: int) -> FanLimits:
        """No limit found on any programme."""
        found = {kind: np.zeros(programmes, dtype=bool) for kind in LIMITS}
        return cls(
            found,
            {kind: LoopStates.at_rest(programmes, contacts) for kind in LIMITS},
            np.zeros(programmes, dtype=bool),
            LoopStates.at_rest(programmes, contacts),
        )

    def record(self, kind: str, rows: Integers, states: LoopStates) -> None:
        """Record a limit where none of this kind is known."""
        new = np.logical_not(self.found[kind][rows])
        self.states[kind].put(rows[new], states.take(new))
        self.found[kind][rows[new]] = True

    def record_lost(self, rows: Integers, states: LoopStates, lost: Flags) -> None:
        """Record the `SPECTRAL` limits that are lost, (R, 3), in the states of these rows."""
        for kind, here in zip(SPECTRAL, lost.T, strict=True):
            self.record(kind, rows[here], states.take(rows[here]))


def first_limits(fan: Fan, start: LoopStates) -> FanLimits:
    """Follow every programme from a state to where det K is lost, a contact opens or `reach` ends.

    `start` has one row. Regimes at the start are those that the rates of each programme ask for.
    """
    model, count = fan.model, len(fan.programme)
    limits = FanLimits.none(count, model.contact_count)
    now = start.take(np.zeros(count, dtype=int))
    rows = _first_regimes(fan, now, limits)
    balance, gone = np.zeros((count, len(fan.blocks), 2)), np.zeros(count)
    _set_balance(fan, balance, now, rows)
    h = np.full(count, MAX_STEP * fan.reach)
    for _ in range(MOST_FAN_STEPS):
        if len(rows) == 0:
            break
        before, h[rows] = now.take(rows), np.minimum(h[rows], fan.reach - gone[rows])
        taken = h[rows]
        after, error = fan.step(before, rows, taken)
        error = np.nan_to_num(error, nan=np.inf)
        growth = np.clip(0.9 * np.maximum(error, 1e-9) ** -0.125, 0.2, 4.0)
        h[rows] = np.minimum(taken * growth, MAX_STEP * fan.reach)
        limits.open_question[rows[taken < SHORTEST_STEP * fan.reach]] = True
        good = error <= 1.0
        if good.any():
            going, low = rows[good], np.where(before.heading[good].any(axis=1), 0.0, BEGUN)
            pending = partial(_pending, fan, limits, balance)
            after, share, fired = _to_event(
                fan, pending, before.take(good), after.take(good), going, taken[good], low
            )
            now.put(going, after)
            gone[going] += share * taken[good]
            here = fired >= 0
            if here.any():
                _after_event(fan, limits, pending, now, balance, going[here], fired[here])
            _set_balance(fan, balance, now, going[~here], balance[going[~here], :, 0])
        ended = limits.open_question.copy()
        for kind in ("det_K_zero", "opening", "limit"):
            ended |= limits.found[kind]
        rows = np.flatnonzero(~ended & (gone < fan.reach * (1.0 - 1e-12)))
    limits.open_question[rows] = True
    return replace(limits, end=now)


def _set_balance(
    fan: Fan, balance: Floats, now: LoopStates, rows: Integers, sign: Floats | None = None
) -> None:
    """Note the determinants of the balance, their signs if they are not given."""
    if fan.blocks and len(rows):
        _, signs, sizes = fan.operator(fan.stiffnesses(now.take(rows)))
        balance[rows, :, 0], balance[rows, :, 1] = signs if sign is None else sign, sizes


def _pending(
    fan: Fan, limits: FanLimits, balance: Floats, states: LoopStates, rows: Integers
) -> tuple[Floats, dict[str, slice]]:
    """Event functions of rows, infinite where their limit is known already.

    Determinants are over those of the last step.
    """
    values, sizes, columns = fan.functions(states, rows)
    sign, size = balance[rows, :, 0], balance[rows, :, 1]
    ratio = values[:, columns["balance"]] * sign * np.exp(np.clip(sizes - size, -700.0, 50.0))
    values[:, columns["balance"]] = np.where(sign == 0.0, np.inf, ratio)
    for k, kind in enumerate(SPECTRAL):
        values[limits.found[kind][rows], columns["spectral"].start + k] = np.inf
    return values, columns


def _to_event(
    fan: Fan, pending: Pending, before: LoopStates, after: LoopStates, rows: Integers, h: Floats,
    low: Floats,
) -> tuple[LoopStates, Floats, Integers]:  # fmt: skip
    """States at the first event of each step or at its end, their share of it, the function.

    Bracketed on the interpolant, then corrected by integrating to it (Newton with the slope of the
    interpolant). The function's column is -1 where none vanishes; no event is looked for in the
    share `low` (B,) of a step.
    """
    share, fired = np.ones(len(rows)), np.full(len(rows), -1)
    crossed = np.flatnonzero(pending(after, rows)[0].min(axis=1) < 0.0)
    if len(crossed) == 0:
        return after, share, fired
    start, own, size = before.take(crossed), rows[crossed], h[crossed]
    between, every = fan.interpolant(start, own, size), np.arange(len(crossed))

    def smallest(theta: Floats, pick: Integers) -> Floats:
        return np.asarray(pending(between(theta, pick), own[pick])[0].min(axis=1))

    theta = first_sign_change(smallest, low[crossed])
    values, columns = pending(between(theta, every), own)
    which, balance = values.argmin(axis=1), values[:, columns["balance"]]
    if fan.blocks:
        # At a pole of the tangent the determinant is smooth, and its eigenvalues are not.
        smooth = columns["balance"].start + balance.argmin(axis=1)
        which = np.where(balance.min(axis=1) <= 0.0, smooth, which)
    ends = theta - SLOPE_WIDTH, theta + SLOPE_WIDTH
    lower, upper = (pending(between(end, every), own)[0][every, which] for end in ends)
    with np.errstate(divide="ignore", invalid="ignore"):
        width = np.nan_to_num(2.0 * SLOPE_WIDTH / (upper - lower), posinf=0.0, neginf=0.0)
    best = np.full(len(every), np.inf)
    trial = theta
    for _ in range(EVENT_POLISHES):
        there = fan.step(start, own, trial * size)[0]
        value = pending(there, own)[0][every, which]
        better = np.abs(value) < best
        best, theta = np.where(better, np.abs(value), best), np.where(better, trial, theta)
        after.put(crossed[better], there.take(better))
        if not better.any():
            break
        trial = np.clip(np.where(better, trial - value * width, theta), 0.0, 1.0)
    share[crossed], fired[crossed] = theta, which
    return after, share, fired


def first_sign_change(values: Callable[[Floats, Integers], Floats], low: Floats) -> Floats:
    """Roots in (low, 1) of functions that are negative at 1, by bisection.

    The far end of the bracket is returned; `low` where a function is negative there.
    """
    a, b = low.copy(), np.ones(len(low))
    every = np.arange(len(low))
    b = np.where(values(a, every) <= 0.0, a, b)
    for _ in range(EVENT_HALVINGS):
        middle = 0.5 * (a + b)
        beyond = values(middle, every) <= 0.0
        a, b = np.where(beyond, a, middle), np.where(beyond, middle, b)
    return b


def _first_regimes(fan: Fan, now: LoopStates, limits: FanLimits) -> Integers:
    """Find regimes of the start that agree with the rates; return the programmes that go on.

    Where a contact parts at once the programme has its limit there; where regimes don't settle the
    question stays open.
    """
    model, count = fan.model, len(fan.programme)
    rows, contacts = np.arange(count), fan.contacts(now)
    at_edge = np.abs(contacts.shear_force) >= (1.0 - YIELD_RTOL) * model.law.strength(contacts)
    at_edge &= model.has_cone
    still = SINGULAR_RTOL * model.stiffness * model.length
    for _ in range(2 * model.contact_count + 2):
        rates, shift = fan.rates(now, rows)
        normal, beyond = fan.edges(now, rates, shift)
        sliding = now.regime == Regime.SLIDING
        start = at_edge & ~sliding & (beyond > still)
        stop = sliding & (beyond < -still)
        settled = ~(start | stop).any(axis=1)
        if settled.all():
            break
        # At the first touch the side is that of the rate.
        T = np.where(now.shear_force == 0.0, rates.shear_force, now.shear_force)
        now.side[start], now.side[stop] = np.sign(T)[start], 0.0
        now.regime[start], now.regime[stop] = Regime.SLIDING, Regime.ELASTIC
    touching = contacts.overlap <= TOUCHING_GAP * model.touching
    parting = np.asarray((touching & (normal < -still)).any(axis=1))
    limits.record("opening", rows[parting], now.take(parting))
    # On isotropic programmes several modes go singular at one state, which symmetry alone resolves.
    together = fan.control == "stress" or model.closure == "traction"
    alike = np.abs(np.cos(fan.programme) - np.sin(fan.programme)) < ISOTROPIC_RTOL
    limits.open_question[~parting & (~settled | (alike & together))] = True
    going = np.flatnonzero(~limits.open_question & ~parting)
    slides = going[(now.regime[going] == Regime.SLIDING).any(axis=1)]
    limits.record("yield", slides, now.take(slides))
    values, _, columns = fan.functions(now.take(going), going)
    limits.record_lost(going, now, values[:, columns["spectral"]] <= SINGULAR_RTOL)
    return going[~limits.found["det_K_zero"][going]]


def _after_event(
    fan: Fan, limits: FanLimits, pending: Pending, now: LoopStates, balance: Floats, rows: Integers,
    fired: Integers,
) -> None:  # fmt: skip
    """Record what happens in the states of `rows`, and change the regimes that it changes."""
    values, columns = pending(now.take(rows), rows)
    fires = np.asarray(values <= COINCIDENT)
    fires[np.arange(len(rows)), fired] = True
    singular = fires[:, columns["balance"]]
    # In the fields of the path itself: the strain does not grow on, or its tangent has a pole.
    ends = singular[:, :1].any(axis=1)
    # In those of shear the work along it passes from plus to minus infinity.
    strained = np.array([len(block.strains) > 0 for block in fan.blocks], dtype=bool)
    poles = singular[:, strained].any(axis=1)
    branching = np.asarray(singular.any(axis=1))
    fires[branching, columns["spectral"]] = False
    limits.record_lost(rows, now, fires[:, columns["spectral"]])
    opening = fires[:, columns["opening"]].any(axis=1)
    told = {"opening": opening, "branching": branching, "limit": ends, "cone_opening": poles}
    for kind, where in told.items():
        limits.record(kind, rows[where], now.take(rows[where]))
    kept = np.where(singular, 0.0, balance[rows, :, 0])
    _set_balance(fan, balance, now, rows, kept)
    yields, sticks = fires[:, columns["yield"]], fires[:, columns["unloading"]]
    changed = (yields | sticks).any(axis=1)
    own, yields, sticks = rows[changed], yields[changed], sticks[changed]
    if len(own) == 0:
        return
    slips, regime, side = yields.any(axis=1), now.regime[own], now.side[own]
    regime[yields], side[yields] = Regime.SLIDING, np.sign(now.shear_force[own][yields])
    _set_regimes(fan, now, own, regime, side)
    values, _, columns = fan.functions(now.take(own), own)
    agrees = np.asarray((values[:, columns["unloading"]] > 0.0).all(axis=1) & ~sticks.any(axis=1))
    for k in np.flatnonzero(~agrees):
        agrees[k] = _search_regimes(fan, limits, now, own[[k]])
    limits.record("yield", own[slips], now.take(own[slips]))
    # Regimes that have changed have a balance of their own.
    _set_balance(fan, balance, now, own)
    values, columns = pending(now.take(own), own)
    lost = values[:, columns["spectral"]] <= SINGULAR_RTOL
    limits.record_lost(own, now, agrees[:, None] & lost)


def _set_regimes(fan: Fan, now: LoopStates, rows: Integers, regime: Regimes, side: Floats) -> None:
    """Change the regimes of rows, with `T` at its strength where contacts slide."""
    now.regime[rows], now.side[rows], now.heading[rows] = regime, side, 0.0
    now.shear_force[rows] = fan.contacts(now.take(rows)).shear_force


def _search_regimes(fan: Fan, limits: FanLimits, now: LoopStates, row: Integers) -> bool:
    """Take the regimes with which a programme goes on; whether there are any.

    Each contact at its strength may slide or stick. Where no regimes agree with their rates the
    programme has its limit; where several do, or only such that break the symmetry, the question
    is left to `follow`.
    """
    model, one = fan.model, now.take(row)
    moved, b = one.moved[0], float(fan.programme[row[0]])
    place = one.H[0] if model.closure == "affine" else np.cumsum(moved, axis=0) - moved
    state = PathState(place, one.shear_force[0], 0.0, np.zeros(4))
    about = state, Mode(one.regime[0], one.side[0]), CONTROLS[fan.control](np.cos(b), np.sin(b))
    found = edge_problem(model, *about, preferred={}, direction=None)
    if found.status in ("unique", "one found"):
        mode = found.taken.rates.mode
        side = np.where(mode.regime == Regime.SLIDING, mode.side, 0.0)
        _set_regimes(fan, now, row, mode.regime, side)
        return True
    whole = replace(model, symmetry=None)
    if found.solutions or edge_problem(whole, *about, preferred={}, direction=None).solutions:
        limits.open_question[row] = True
    else:
        limits.record("limit", row, one)
    return False


def followed_limits(
    fan: Fan, programme: int, limits: FanLimits, spins: Spins, start: GrainGraph
) -> None:
    """Limits of one programme from the path that `follow` takes; replaces those found before."""
    b, model = float(fan.programme[programme]), fan.model
    load = CONTROLS[fan.control](np.cos(b), np.sin(b))
    stage = Stage(load, "parameter", fan.reach * (1.0 if fan.control == "strain" else STRESS_REACH))
    watched = ("diagonal", "symmetric")
    options = LoopPathOptions(spins=spins, subspace=watched)
    around = boundary_of(start, volume=model.volume)
    path = follow_loop(Scene(start, model.law, around), [stage], model.closure, options)
    i, j = model.contacts.T

    def state(row: int, H: ArrayLike) -> LoopStates:
        C = model.contact_count
        moved = path.x[row][j] - path.x[row][i] - model.d0
        regime = path.regime[row, :C]
        side = np.where(regime == Regime.SLIDING, np.sign(path.shear_force[row, :C]), 0.0)
        return LoopStates(np.array([H]), moved[None], path.shear_force[[row], :C], regime[None],
                          side[None], np.zeros((1, 2)))  # fmt: skip

    row = np.array([programme])
    for kind in LIMITS:
        limits.found[kind][row] = False
    limits.open_question[row] = False
    first = stability_measures(restrict(path.A[0], "symmetric"))
    for k, kind in enumerate(SPECTRAL):
        # A path whose first tangent has no single value begins on a mechanism.
        if not first[k] > SINGULAR_RTOL:
            limits.record(kind, row, state(0, path.H[0]))
    for event in path.events:
        lost = limits.states["det_K_zero"].H[programme]
        # Events of the state at which det K is lost still count.
        if limits.found["det_K_zero"][programme] and np.abs(lost - event.H).max() > SINGULAR_RTOL:
            break
        kind = "limit" if event.kind == "control_limit" else str(event.kind)
        if event.subspace == "symmetric":
            kind = "cone_opening" if kind == "det_Ks_zero" else ""
        if kind in LIMITS:
            jumps = event.index + 1 < len(path) and (path.H[event.index + 1] == event.H).all()
            limits.record(kind, row, state(event.index + int(jumps), event.H))
        if kind in ("opening", "limit"):
            break
    if limits.end is not None:
        limits.end.put(row, state(len(path) - 1, path.H[-1]))
