"""Steps of the contacts of a material, under any law between pairs of grains."""

from __future__ import annotations

import numpy as np

from loops.arrays import Floats
from loops.compiled import given, laws
from loops.errors import InputError
from loops.graph import ContactState
from loops.laws.frictional import TOUCHING_RTOL, ContactLaw, Regime
from loops.laws.of_pairs import KERNELS, PairLaw, require_movable
from stability.material.kernels import ANSWER, CHUNK, NODES, contact_steps

# Differences of the fourth order that give the slopes of a law of one's own: reaches over this
# share of the overlap, and weights.
DIFFERENCE = 1e-3
REACH, WEIGHT = np.array([0.0, 1.0, -1.0, 2.0, -2.0]), np.array([8.0, -8.0, -1.0, 1.0]) / 12.0
# Overlap at which a law is tried, over the length at touch.
TRIAL = 1e-3


def material_law(law: ContactLaw, radii: Floats) -> PairLaw:
    """Return the law of contacts between grains of radii (2, m).

    `InputError` unless one step of them can be taken at once.
    """
    touching = radii.sum(axis=0)
    n, none, overlap = np.tile([1.0, 0.0], (len(touching), 1)), 0.0 * touching, TRIAL * touching
    state = ContactState(touching - overlap, n, n[:, ::-1], none, none, *radii)
    pairs = PairLaw.made(require_movable(law, state), radii, np.full(len(touching), -1))
    # A coupling may go with the shear force.
    _, state = pairs.contacts(overlap, pairs.normal_force(overlap))
    coupled = pairs.local_stiffness(state, Regime.ELASTIC)[:, 1, 0].any()
    if pairs.law.bonded or (coupled and type(pairs.law) not in KERNELS):
        bonds, coupling = "bonds, which break for good", "a stiffness between normal and shear"
        expected, remedy = "a law of the present state", "Follow loops under it by gl.follow."
        received = bonds if pairs.law.bonded else coupling
        raise InputError("law of the material", received, expected, remedy)
    return pairs


class ContactSteps:
    """Contacts (m,) whose steps are taken together.

    `touching` (2, m): Their lengths at first touch, and those at which they open.
    """

    def __init__(self, law: PairLaw, touching: Floats) -> None:
        self.law, self.touching = law, touching
        # In chunks (chunks, C) of one size; the last contact stands for what lacks.
        size, filling = min(CHUNK, len(law)), law.filling(compile_own=False)
        every = np.arange(-(-len(law) // size) * size)
        self._rows = rows = np.minimum(every, len(law) - 1).reshape(-1, size)

        def chunks(numbers: Floats) -> Floats:
            return np.ascontiguousarray(np.moveaxis(numbers[:, rows], 0, 1))

        # Each point has constants of its own, and `kt` changes on the way.
        self._law, self._nodes = (laws.Pointer(laws.given), np.zeros((0, 0))), len(NODES)
        if not isinstance(filling, str):
            # Chunks of few contacts have those of several points.
            rows = np.tile(rows, max(1, CHUNK // len(law)))
            self._law = filling.pointer, chunks(filling.constants)[None, None]
            # Of other known laws `kt` is constant, or goes with all of the shear force.
            self._nodes = len(NODES) if filling.pointer.function is laws.hertz else 0
        self._radii, self._touching = chunks(law.radii), chunks(touching)

    def __call__(self, start: Floats, end: Floats, shear: Floats) -> Floats:
        """Return the answers (q, 8, m) of contacts that move between branches (q, m, 2).

        `shear` (q, m) are their shear forces at the start.
        """
        (pointer, constants), radii, nodes = self._law, self._radii, self._nodes
        answer = np.empty((len(shear), ANSWER, shear.shape[1]))
        ends = (given(a, np.float64) for a in (start, end, shear))
        ways = radii, self._touching, nodes, self.law.by_radii, *ends, answer
        if not constants.size:
            constants = np.zeros((len(shear), 1 + nodes, len(radii), 3, radii.shape[2]))
            contact_steps(laws.Pointer(laws.asked), constants, *ways)
            constants = self._by_differences(*np.moveaxis(constants, 3, 0))
        contact_steps(pointer, constants, *ways)
        return answer

    def _by_differences(self, overlap: Floats, before: Floats, T: Floats) -> Floats:
        """Return the answers and slopes of a law of one's own, as the constants of a kernel."""
        step = DIFFERENCE * np.maximum(overlap, TOUCHING_RTOL * self.touching[0, self._rows])
        near = overlap + np.multiply.outer(REACH, step)
        before, T = (np.broadcast_to(k, near.shape).ravel() for k in (before, T))
        law = self.law.taken(np.broadcast_to(self._rows, near.shape).ravel())
        with np.errstate(all="ignore"):
            answers = law.answer(near.ravel(), before, T).reshape(4, *near.shape)
            slopes = np.einsum("r,kr...->k...", WEIGHT, answers[:, 1:]) / step
        constants = np.moveaxis(np.concatenate([answers[:, 0], slopes]), 0, 3)
        return np.ascontiguousarray(constants)


def lengths_at_touch(pairs: PairLaw, d: Floats, normal: Floats) -> Floats:
    """Return the lengths (m,) at which contacts open, with which the law gives the forces (m,).

    Forces and positions of a file are each rounded; the overlaps follow the forces. Contacts
    without a force, and laws whose force has no such overlap, keep the sum of the radii.
    """
    length = np.sqrt(d[:, 0] ** 2 + d[:, 1] ** 2)
    overlap = pairs.touching - length
    for _ in range(50):
        force, kn = pairs.normal_force(overlap), pairs.stiffnesses(overlap)[0]
        change = np.divide(normal - force, kn, out=0.0 * kn, where=(normal > 0.0) & (kn > 0.0))
        overlap = overlap + change
        if np.all(np.abs(change) <= TOUCHING_RTOL * 1e-3 * pairs.touching):
            return np.where(normal > 0.0, length + overlap, pairs.touching)
    raise InputError(
        "forces of the loops",
        f"{float(normal.max()):.6g} at an overlap of {float(overlap.max()):.3g}",
        "normal forces that the law has at some overlap",
        "Give the law of the snapshot.",
    )
