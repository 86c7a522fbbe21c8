"""A fan of straight programmes of one loop, integrated side by side to the limits of stability.

What `follow` does for one programme, for hundreds at once: the rates of a ring of contacts with
blocked spins, solved as one batch, an explicit Runge-Kutta method of order 8 with a step of each
programme's own, and events located by integrating to them. Contacts that reach their strength
slide; where such regimes do not agree with their rates the programme ends. A question that this
cannot settle (a sliding contact that sticks again, several modes singular at one state) is left to
`follow`, which also serves spins that are not blocked.

Mirrors in the axes and the half turn that leave loop and load as they are split the relaxed
displacements into fields of one character each, which answer to themselves alone. The path uses
the fields that keep the symmetry. So it passes states where the balance of the others is singular,
where paths that break the symmetry branch off.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from functools import cached_property, partial
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.integrate import DOP853

from loops import GrainGraph, Regime, Scene, boundary_of
from loops.arrays import Flags, Floats, Integers, Regimes
from loops.assembly import translational_blocks
from loops.closures import Spins
from loops.laws.frictional import edge_rates, with_sides
from loops.symmetry import identity
from stability.paths.loop_path import LoopPathOptions
from stability.paths.model import PathModel
from stability.paths.of_graph import follow_loop
from stability.paths.state import PathContacts
from stability.programmes import Stage, proportional_strain, proportional_stress
from stability.spectra import restrict, symmetric_part

Control = Literal["strain", "stress"]
CONTROLS = {"strain": proportional_strain, "stress": proportional_stress}
# Limits of a programme, in the order in which they are told.
SPECTRAL = ("cone_opening", "det_Ks_zero", "det_K_zero")
LIMITS = (*SPECTRAL, "yield", "opening", "branching", "limit")
# Local error of a step over the size of the variables.
RTOL = 1e-14
# Longest step in the space of H, over the reach of the programmes.
MAX_STEP = 0.04
# Share of a step before which no event is looked for: at the first touch all forces are zero.
BEGUN = 1e-4
# Steps after which a programme without a limit is left to `follow`.
MOST_STEPS = 600
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
SINGULAR = 1e-12
# What |T| of the first state may lack to the strength, over it, where a contact is at yield.
AT_YIELD = 1e-9
# Overlap of the first state over r_i + r_j up to which a contact just touches.
TOUCHING = 1e-11
# A programme along which both strains are equal to this is isotropic: several modes go singular.
ISOTROPIC = 1e-9
# Shortest step, over the reach of the programmes; below, the question is left to `follow`.
SHORTEST = 1e-9


@dataclass(frozen=True, eq=False)
class LoopStates:
    """States of one loop on B programmes.

    `H` (B, 4); `moved` (B, C, 2): Branches less their references; `shear_force`, `regime`, `side`
    (B, C): `T`, regimes, and the sign of `T` where a contact slides; `heading` (B, 2): Change of
    (H11, H22) on the last step, 0 at the start and where regimes have changed.
    """

    H: Floats
    moved: Floats
    shear_force: Floats
    regime: Regimes
    side: Floats
    heading: Floats

    @classmethod
    def at_rest(cls, count: int, contacts: int, T: Floats | float = 0.0) -> LoopStates:
        """The reference with these shear forces, contacts sticking, `count` times."""
        shape = count, contacts
        return cls(np.zeros((count, 4)), np.zeros((*shape, 2)), np.zeros(shape) + T,
                   np.full(shape, Regime.ELASTIC, dtype=np.int8), np.zeros(shape),
                   np.zeros((count, 2)))  # fmt: skip

    def take(self, rows: Flags | Integers) -> LoopStates:
        """The picked states."""
        return LoopStates(*(getattr(self, field.name)[rows] for field in fields(self)))

    def put(self, rows: Flags | Integers, states: LoopStates) -> None:
        """Overwrite the picked states."""
        for field in fields(self):
            getattr(self, field.name)[rows] = getattr(states, field.name)


# Stages of the method of order 8 (DOP853 of Hairer and Wanner).
STAGES = 12
# Those of its interpolant: the end of the step, and three more.
DENSE_STAGES = 16
TABLEAU = np.zeros((DENSE_STAGES, DENSE_STAGES))
TABLEAU[:STAGES, :STAGES], TABLEAU[STAGES, :STAGES] = DOP853.A, DOP853.B
TABLEAU[STAGES + 1 :] = DOP853.A_EXTRA

# Event functions of states on the programmes of some rows, see `Fan.functions`.
Pending = Callable[[LoopStates, Integers], tuple[Floats, dict[str, slice]]]


@dataclass(frozen=True, eq=False)
class FanLimits:
    """First limits along the programmes of a fan.

    `found` (B,) and `states` by kind, see `LIMITS`; of a limit reached in a jump the regimes are
    those after it. `open_question` (B,): Programmes without an answer yet, for `follow`.
    """

    found: dict[str, Flags]
    states: dict[str, LoopStates]
    open_question: Flags

    @classmethod
    def none(cls, programmes: int, contacts: int) -> FanLimits:
        """No limit found on any programme."""
        found = {kind: np.zeros(programmes, dtype=bool) for kind in LIMITS}
        return cls(
            found,
            {kind: LoopStates.at_rest(programmes, contacts) for kind in LIMITS},
            np.zeros(programmes, dtype=bool),
        )

    def record(self, kind: str, rows: Integers, states: LoopStates) -> None:
        """Record a limit where none of this kind is known."""
        new = np.logical_not(self.found[kind][rows])
        self.states[kind].put(rows[new], states.take(new))
        self.found[kind][rows[new]] = True


def stability_measures(K: Floats) -> Floats:
    """(..., 3) numbers of `SPECTRAL`, positive where stable, of tangents in `symmetric`.

    Smallest eigenvalue of Ks over the norm of K; smallest eigenvalue of Ks, and smallest real part
    of the eigenvalues of K, in (11, 22), over the norm there: where K has a pole in shear alone
    these two are finite.
    """
    tiny = np.finfo(float).tiny
    plane_norm = np.maximum(np.linalg.norm(K[..., :2, :2], axis=(-2, -1)), tiny)
    a, b, c, d = (K[..., i, j] / plane_norm for i in (0, 1) for j in (0, 1))
    K = K / np.maximum(np.linalg.norm(K, axis=(-2, -1)), tiny)[..., None, None]
    mean, half = 0.5 * (a + d), 0.5 * (a - d)
    plane = mean - np.hypot(half, 0.5 * (b + c))
    real = mean - np.sqrt(np.maximum(half**2 + b * c, 0.0))
    finite = np.asarray(np.isfinite(K).all(axis=(-2, -1)))
    Ks = np.where(finite[..., None, None], symmetric_part(K), 0.0)
    return np.stack([np.linalg.eigvalsh(Ks)[..., 0], plane, real], axis=-1)


@dataclass(frozen=True, eq=False)
class Fan:
    """Programmes `(cos b, sin b)` of the strains H11, H22 or stresses P11, P22, no shear strain."""

    model: PathModel
    control: Control
    programme: Floats
    reach: float

    # ---- states and rates

    def contacts(self, states: LoopStates) -> PathContacts:
        """Contacts (B, C) with their forces; `T` at its strength on its side where they slide."""
        model = self.model
        d = model.d0 + states.moved
        length = np.hypot(d[..., 0], d[..., 1])
        shortening = -((d + model.d0) * states.moved).sum(axis=-1) / (length + model.length0)
        n = d / length[..., None]
        radii_i, radii_j = model.radii[model.contacts].T
        is_open = states.regime == Regime.OPEN
        contacts = PathContacts(
            length=length,
            n=n,
            t=np.stack([-n[..., 1], n[..., 0]], axis=-1),
            normal_force=np.zeros_like(length),
            shear_force=states.shear_force,
            radii_i=radii_i,
            radii_j=radii_j,
            exact_overlap=model.overlap0 + shortening,
        )
        normal = np.where(is_open, 0.0, model.law.closed_force(contacts))
        contacts = replace(contacts, normal_force=normal)
        sliding = states.regime == Regime.SLIDING
        if sliding.any():
            strength = states.side * np.where(sliding, model.law.strength(contacts), 0.0)
            contacts = replace(
                contacts, shear_force=np.where(sliding, strength, states.shear_force)
            )
        return contacts

    @cached_property
    def blocks(self) -> tuple[FieldBlock, ...]:
        """Fields of the traction closure by character; those that hold (11, 22) first."""
        return field_blocks(self.model) if self.model.closure == "traction" else ()

    def stiffnesses(self, states: LoopStates) -> Floats:
        """(B, C, 2, 2) tangent blocks of the contacts."""
        contacts = with_sides(self.contacts(states), states.side)
        return translational_blocks(contacts, self.model.law, states.regime)

    def response(self, k: Floats) -> tuple[Floats, Floats]:
        """(B, C, 2, 4) branch rates and (B, 4, 4) stress rates per `H'` along the path.

        Under the traction closure those of the first of `blocks`, the rest zero.
        """
        model, C = self.model, self.model.contact_count
        D, A = np.zeros((len(k), C, 2, 4)), np.zeros((len(k), 4, 4))
        if model.closure == "affine":
            D[..., 0, :2] = D[..., 1, 2:] = -model.d0
            pairs = (model.d0[:, :, None] * model.d0[:, None, :]).reshape(C, 4)
            A = (np.moveaxis(k, 1, -1) @ pairs).reshape(-1, 2, 2, 2, 2)
            return D, np.moveaxis(A, 2, 3).reshape(-1, 4, 4) / model.volume
        block = self.blocks[0]
        strains, z = block.strains, block.solve(k, model.volume)
        D[..., strains] = block.branch_rates(z)
        A[:, strains[:, None], strains] = z[:, -len(strains) :]
        return D, A

    def operator(self, k: Floats) -> tuple[Floats, Floats, Floats]:
        """(B, 4, 4) whole tangent; signs and logarithms of the determinants of `blocks` (B, Q)."""
        _, A = self.response(k)
        for block in self.blocks[1:]:
            if len(block.strains):
                strains, z = block.strains, block.solve(k, self.model.volume)
                A[:, strains[:, None], strains] = z[:, -len(strains) :]
        found = np.array([np.linalg.slogdet(block.balance(k)) for block in self.blocks])
        sign, size = found.reshape(len(self.blocks), 2, len(k)).transpose(1, 2, 0)
        return A, sign, size

    def strain_rate(self, A: Floats, rows: Integers, heading: Floats) -> Floats:
        """(B, 4) `H'` of unit length; under stress control on the side of `heading` (B, 2).

        So it goes on smoothly past a limit of the stress; 0: where the stress grows.
        """
        b = self.programme[rows]
        along, across = np.cos(b), np.sin(b)
        if self.control == "stress":
            (a11, a12), (a21, a22) = (A[:, i, [0, 3]].T for i in (0, 3))
            grows = np.sign(a11 * a22 - a12 * a21)
            along, across = a22 * along - a12 * across, a11 * across - a21 * along
            ahead = np.sign(along * heading[:, 0] + across * heading[:, 1])
            size = np.hypot(along, across) * np.where(ahead == 0.0, grows, ahead)
            along, across = along / size, across / size
        none = np.zeros_like(along)
        return np.stack([along, none, none, across], axis=-1)

    def rates(self, states: LoopStates, rows: Integers) -> tuple[LoopStates, Floats]:
        """Rates of the states per unit of |H|, and of the contacts' displacements (2, B, C)."""
        law, contacts = self.model.law, with_sides(self.contacts(states), states.side)
        D, A = self.response(translational_blocks(contacts, law, states.regime))
        H = self.strain_rate(A, rows, states.heading)
        motion = (D @ H[:, None, :, None])[..., 0]
        un = (contacts.n * motion).sum(axis=-1)
        ut = law.shear_kinematics(contacts)[0] * (contacts.t * motion).sum(axis=-1)
        k = law.local_stiffness(contacts, states.regime)
        shear = -(k[..., 1, 0] * un + k[..., 1, 1] * ut)
        return replace(states, H=H, moved=motion, shear_force=shear), np.stack([un, ut])

    def edges(self, states: LoopStates, rates: LoopStates, shift: Floats) -> tuple[Floats, Floats]:
        """(B, C) `N'`, and the rate of |T| beyond that of the strength if the contacts stuck."""
        contacts = with_sides(self.contacts(states), states.side)
        side = np.sign(np.where(states.shear_force == 0.0, rates.shear_force, states.shear_force))
        side = np.where(states.side == 0.0, side, states.side)
        normal, sticking, strength = edge_rates(self.model.law, contacts, side, *shift)
        return normal, np.where(side == 0.0, np.abs(sticking), side * sticking) - strength

    # ---- steps and events

    @cached_property
    def units(self) -> Floats:
        """Units of the variables of a step: strains, displacements, shear forces."""
        length, C = self.model.length, self.model.contact_count
        return np.repeat([1.0, length, self.model.stiffness * length], [4, 2 * C, C])

    def _flat(self, states: LoopStates) -> Floats:
        return np.concatenate(
            [states.H, states.moved.reshape(len(states.H), -1), states.shear_force], axis=1
        )

    def _at(self, states: LoopStates, y: Floats) -> LoopStates:
        end = 4 + states.moved[0].size
        moved = y[:, 4:end].reshape(states.moved.shape)
        return replace(states, H=y[:, :4], moved=moved, shear_force=y[:, end:])

    def _stages(self, states: LoopStates, rows: Integers, h: Floats, count: int) -> Floats:
        y0 = self._flat(states)
        k = np.zeros((count, *y0.shape))
        for stage in range(count):
            dy = np.tensordot(TABLEAU[stage, :stage], k[:stage], 1)
            k[stage] = self._flat(self.rates(self._at(states, y0 + h[:, None] * dy), rows)[0])
        return k

    def step(self, states: LoopStates, rows: Integers, h: Floats) -> tuple[LoopStates, Floats]:
        """One step of length `h` (B,) each; the states at its end, and its error over `RTOL`."""
        k = self._stages(states, rows, h, STAGES)
        change = h[:, None] * np.tensordot(DOP853.B, k, 1)
        # Error of the embedded orders 5 and 3, as DOP853 weighs it.
        weighed = k / self.units
        five, three = (np.tensordot(E[:STAGES], weighed, 1) for E in (DOP853.E5, DOP853.E3))
        five, three = ((e**2).mean(axis=1) for e in (five, three))
        error = h * five / np.sqrt(np.maximum(five + 0.01 * three, np.finfo(float).tiny))
        heading = np.where(h[:, None] > 0.0, change[:, [0, 3]], states.heading)
        after = replace(self._at(states, self._flat(states) + change), heading=heading)
        return after, error / (RTOL * max(self.reach, 1e-300))

    def interpolant(
        self, states: LoopStates, rows: Integers, h: Floats
    ) -> Callable[[Floats, Integers], LoopStates]:
        """States at the shares `theta` of some steps, of order 7 (Hairer, Norsett, Wanner)."""
        k = self._stages(states, rows, h, DENSE_STAGES)
        y0, size = self._flat(states), h[:, None]
        change = size * np.tensordot(DOP853.B, k[:STAGES], 1)
        slopes = size * k[0], size * k[STAGES]
        F = [change, slopes[0] - change, 2.0 * change - slopes[0] - slopes[1],
             *(size * np.tensordot(DOP853.D, k, 1))]  # fmt: skip

        def at(theta: Floats, pick: Integers) -> LoopStates:
            x, y = theta[:, None], np.zeros_like(y0[pick])
            for power, f in enumerate(reversed(F)):
                y = (y + f[pick]) * (x if power % 2 == 0 else 1.0 - x)
            return self._at(states.take(pick), y0[pick] + y)

        return at

    def functions(
        self, states: LoopStates, rows: Integers
    ) -> tuple[Floats, Floats, dict[str, slice]]:
        """(B, M) functions that are positive before their events, and the columns of each kind.

        The last columns, one of each of `blocks`, hold the sign of its determinant; between the
        two, (B, Q), its logarithm.
        """
        law, C = self.model.law, self.model.contact_count
        contacts = self.contacts(states)
        A, sign, size = self.operator(self.stiffnesses(states))
        _, beyond = self.edges(states, *self.rates(states, rows))
        rate = self.model.stiffness * self.model.length
        closed, sticks = states.regime != Regime.OPEN, states.regime == Regime.ELASTIC
        below = (law.strength(contacts) - np.abs(contacts.shear_force)) / (rate * self.reach)
        cone = sticks & self.model.has_cone
        slipping = np.where(states.regime == Regime.SLIDING, beyond / rate, np.inf)
        gap = -law.gap(contacts) / (self.model.touching * self.reach)
        spectral = stability_measures(restrict(A, "symmetric"))
        table = [np.where(cone, below, np.inf), slipping, np.where(closed, gap, np.inf),
                 np.where(np.isnan(spectral), -1.0, spectral), sign]  # fmt: skip
        ends = np.cumsum([0, C, C, C, 3, len(self.blocks)])
        names = ("yield", "unloading", "opening", "spectral", "balance")
        return (
            np.concatenate(table, axis=1),
            size,
            {name: slice(a, b) for name, a, b in zip(names, ends[:-1], ends[1:], strict=True)},
        )


class FieldBlock(NamedTuple):
    """Equations of the traction closure in the displacement fields of one character.

    A field is known from the `first` (R,) contacts of the orbits, of whose 2 R components those in
    `free` (q,) need not vanish: contact c has `sign` (C, 2) times those of orbit `image` (C,).
    `strains` (s,): Components of H and P of this character; `matrix` (q + p + s, same): The
    equations of branches, redundant force and strain with the stiffness left out.
    """

    first: Integers
    free: Integers
    image: Integers
    sign: Floats
    strains: Integers
    matrix: Floats

    def balance(self, k: Floats) -> Floats:
        """(B, q + p + s, same) equations with contact tangents `k` (B, C, 2, 2)."""
        R, q = len(self.first), len(self.free)
        stiffness = np.zeros((len(k), R, 2, R, 2))
        stiffness[:, np.arange(R), :, np.arange(R)] = np.moveaxis(k[:, self.first], 1, 0)
        matrix = np.repeat(self.matrix[None], len(k), axis=0)
        square = stiffness.reshape(len(k), 2 * R, 2 * R)
        matrix[:, :q, :q] = square[:, self.free[:, None], self.free]
        return matrix

    def solve(self, k: Floats, volume: float) -> Floats:
        """(B, q + p + s, s) fields per `H'`, not a number where the balance is singular."""
        matrix, s = self.balance(k), len(self.strains)
        rhs = np.zeros((*matrix.shape[:2], s))
        rhs[:, -s:] = volume * np.eye(s)
        try:
            return np.asarray(np.linalg.solve(matrix, rhs))
        except np.linalg.LinAlgError:
            # Contacts that slide from the first touch leave the balance singular.
            matrix[np.linalg.slogdet(matrix)[0] == 0.0] = np.nan
            return np.asarray(np.linalg.solve(matrix, rhs))

    def branch_rates(self, z: Floats) -> Floats:
        """(B, C, 2, s) branch rates of the fields `z`."""
        whole = np.zeros((len(z), 2 * len(self.first), z.shape[2]))
        whole[:, self.free] = z[:, : len(self.free)]
        fields = whole.reshape(len(z), len(self.first), 2, z.shape[2])
        return fields[:, self.image] * self.sign[..., None]


def field_blocks(model: PathModel) -> tuple[FieldBlock, ...]:
    """Fields of a ring by the characters of its mirrors in the axes and half turn."""
    group = model.symmetry or identity(model.grain_count, model.contact_count)
    group, c = group.along_axes(), np.arange(model.contact_count)
    first, image = np.unique(group.contact_orbits, return_inverse=True)
    R, axes = len(first), np.diagonal(group.maps, axis1=1, axis2=2)
    big, weight, m = np.zeros((2 * R + 6, 2 * R + 6)), np.bincount(image), model.m[first]
    for i in (0, 1):
        big[i : 2 * R : 2, 2 * R + i], big[2 * R + i, i : 2 * R : 2] = 1.0, weight
        for j in (0, 1):
            big[i : 2 * R : 2, 2 * R + 2 + 2 * i + j] = -m[:, j]
            big[2 * R + 2 + 2 * i + j, i : 2 * R : 2] = weight * m[:, j]
    characters = dict.fromkeys(
        tuple(map(float, each)) for each in (group.parity**2, group.parity, *axes.T)
    )
    blocks = []
    for character in map(np.array, characters):
        # A mirror turns the ring's sense round, and with it the branches and forces.
        action = (character * group.parity)[:, None] * axes
        fixed = group.contacts[:, first] == first
        kept = (action[:, None] * fixed[..., None]).sum(axis=0) == fixed.sum(axis=0)[:, None]
        tensor = character[:, None] * np.stack([group.parity**k for k in (0, 1, 1, 0)], axis=1)
        force, strain = (np.flatnonzero(a.sum(axis=0) == group.order) for a in (action, tensor))
        sign = action[np.argmax(group.contacts[:, first[image]] == c, axis=0)]
        free = np.flatnonzero(kept)
        used = np.concatenate([free, 2 * R + force, 2 * R + 2 + strain])
        blocks.append(FieldBlock(first, free, image, sign, strain, big[np.ix_(used, used)]))
    return tuple(blocks)


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
    for _ in range(MOST_STEPS):
        if len(rows) == 0:
            break
        before, h[rows] = now.take(rows), np.minimum(h[rows], fan.reach - gone[rows])
        taken = h[rows]
        after, error = fan.step(before, rows, taken)
        error = np.nan_to_num(error, nan=np.inf)
        growth = np.clip(0.9 * np.maximum(error, 1e-9) ** -0.125, 0.2, 4.0)
        h[rows] = np.minimum(taken * growth, MAX_STEP * fan.reach)
        limits.open_question[rows[taken < SHORTEST * fan.reach]] = True
        good = error <= 1.0
        if good.any():
            going, low = rows[good], np.where(gone[rows[good]] > 0.0, 0.0, BEGUN)
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
    return limits


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
    at_edge = np.abs(contacts.shear_force) >= (1.0 - AT_YIELD) * model.law.strength(contacts)
    at_edge &= model.has_cone
    still = SINGULAR * model.stiffness * model.length
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
    touching = contacts.overlap <= TOUCHING * model.touching
    parting = np.asarray((touching & (normal < -still)).any(axis=1))
    limits.record("opening", rows[parting], now.take(parting))
    # On isotropic programmes several modes go singular at one state, which symmetry alone resolves.
    together = fan.control == "stress" or model.closure == "traction"
    alike = np.abs(np.cos(fan.programme) - np.sin(fan.programme)) < ISOTROPIC
    limits.open_question[~parting & (~settled | (alike & together))] = True
    going = np.flatnonzero(~limits.open_question & ~parting)
    slides = going[(now.regime[going] == Regime.SLIDING).any(axis=1)]
    limits.record("yield", slides, now.take(slides))
    values, _, columns = fan.functions(now.take(going), going)
    for k, kind in enumerate(SPECTRAL):
        lost = going[values[:, columns["spectral"].start + k] <= SINGULAR]
        limits.record(kind, lost, now.take(lost))
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
    for k, kind in enumerate(SPECTRAL):
        own = rows[fires[:, columns["spectral"].start + k]]
        limits.record(kind, own, now.take(own))
    opening = fires[:, columns["opening"]].any(axis=1)
    told = {"opening": opening, "branching": branching, "limit": ends, "cone_opening": poles}
    for kind, where in told.items():
        limits.record(kind, rows[where], now.take(rows[where]))
    kept = np.where(singular, 0.0, balance[rows, :, 0])
    _set_balance(fan, balance, now, rows, kept)
    limits.open_question[rows[fires[:, columns["unloading"]].any(axis=1)]] = True
    yields = fires[:, columns["yield"]]
    own = rows[yields.any(axis=1)]
    if len(own) == 0:
        return
    which = np.zeros(now.regime.shape, dtype=bool)
    which[rows] = yields
    now.side[which] = np.sign(now.shear_force[which])
    now.regime[which] = Regime.SLIDING
    now.heading[own] = 0.0
    now.shear_force[own] = fan.contacts(now.take(own)).shear_force
    limits.record("yield", own, now.take(own))
    # Regimes that have changed have a balance of their own.
    _set_balance(fan, balance, now, own)
    values, columns = pending(now.take(own), own)
    agrees = (values[:, columns["unloading"]] > 0.0).all(axis=1)
    # With these contacts sliding the programme does not go on: it ends here, or snaps.
    limits.record("limit", own[~agrees], now.take(own[~agrees]))
    for k, kind in enumerate(SPECTRAL):
        lost = own[agrees & (values[:, columns["spectral"].start + k] <= SINGULAR)]
        limits.record(kind, lost, now.take(lost))


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
        if not first[k] > SINGULAR:
            limits.record(kind, row, state(0, path.H[0]))
    for event in path.events:
        lost = limits.states["det_K_zero"].H[programme]
        # Events of the state at which det K is lost still count.
        if limits.found["det_K_zero"][programme] and np.abs(lost - event.H).max() > SINGULAR:
            break
        kind = "limit" if event.kind == "control_limit" else str(event.kind)
        if event.subspace == "symmetric":
            kind = "cone_opening" if kind == "det_Ks_zero" else ""
        if kind in LIMITS:
            jumps = event.index + 1 < len(path) and (path.H[event.index + 1] == event.H).all()
            limits.record(kind, row, state(event.index + int(jumps), event.H))
        if kind in ("opening", "limit"):
            break
