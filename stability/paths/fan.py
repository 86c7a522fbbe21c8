"""A fan of straight programmes of one loop, integrated side by side to the limits of stability.

What `follow` does for one programme, for hundreds at once: the rates of a ring of contacts with
blocked spins, solved as one batch, an explicit Runge-Kutta method of order 8 with a step of each
programme's own, and events located by integrating to them. Where contacts reach their strength or
stick again, each of those at it slides or sticks as agrees with the rates; where no regimes agree,
the programme ends. A question that this cannot settle (several answers, several modes singular at
one state) is left to `follow`, which also serves spins that are not blocked.

Mirrors in the axes and the half turn that leave loop and load as they are split the relaxed
displacements into fields of one character each, which answer to themselves alone. The path uses
the fields that keep the symmetry. So it passes states where the balance of the others is singular,
where paths that break the symmetry branch off.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Literal, NamedTuple

import numpy as np
from scipy.integrate import DOP853

from loops import Regime
from loops.arrays import Flags, Floats, Integers, Regimes
from loops.assembly import translational_blocks
from loops.laws.frictional import edge_rates, with_sides
from loops.symmetry import identity
from stability.paths.model import PathModel
from stability.paths.state import PathContacts, moved_contacts
from stability.spectra import restrict, symmetric_part

Control = Literal["strain", "stress"]
# Local error of a step over the size of the variables.
STEP_RTOL = 1e-14


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
        forces = states.shear_force, states.regime, states.side
        return moved_contacts(self.model, states.moved, *forces)

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
        """Return states after steps `h` (B,) each, and the error of each over `STEP_RTOL`."""
        k = self._stages(states, rows, h, STAGES)
        change = h[:, None] * np.tensordot(DOP853.B, k, 1)
        # Error of the embedded orders 5 and 3, as DOP853 weighs it.
        weighed = k / self.units
        five, three = (np.tensordot(E[:STAGES], weighed, 1) for E in (DOP853.E5, DOP853.E3))
        five, three = ((e**2).mean(axis=1) for e in (five, three))
        error = h * five / np.sqrt(np.maximum(five + 0.01 * three, np.finfo(float).tiny))
        heading = np.where(h[:, None] > 0.0, change[:, [0, 3]], states.heading)
        after = replace(self._at(states, self._flat(states) + change), heading=heading)
        return after, error / (STEP_RTOL * max(self.reach, 1e-300))

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
