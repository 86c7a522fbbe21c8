"""One step of the contacts of a material: compiled for powers of the overlap, by numpy else."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from loops.arrays import Floats
from loops.errors import InputError
from loops.graph import ContactState
from loops.laws import ContactLaw, FrictionalLaw, Regime
from loops.laws.frictional import TOUCHING_RTOL
from stability.material.kernels import (
    ANSWER,
    FX,
    HERTZ_DISPLACEMENT,
    HERTZ_FORCE,
    KXX,
    LINEAR,
    NODES,
    REGIME,
    SHEAR,
    WEIGHTS,
    contact_steps,
)

# Kernel of a step by the power of the overlap that forces go with, and what T keeps.
KERNELS = {
    (1.0, "force"): LINEAR,
    (1.5, "force"): HERTZ_FORCE,
    (1.5, "displacement"): HERTZ_DISPLACEMENT,
}
# Step of the differences that give the tangent of a law in numpy, over the length at touch. With
# the fourth order what is left is rounding, some 1e-12 of kt.
DIFFERENCE = 1e-3
# Overlap at which the tangent of a law is tried, over the length at touch.
TRIAL_OVERLAP = 1e-3
# Shear force there, over the normal force.
TRIAL_SHEAR = 0.1


@dataclass(frozen=True, eq=False)
class Touching:
    """Contacts of a material, (m,) each: their grains' radii and their length at first touch."""

    radii_i: Floats
    radii_j: Floats
    length: Floats

    def state(self, d: Floats, shear: Floats) -> ContactState:
        """Return the contacts at the branches `d` (..., m, 2), without a normal force."""
        length = np.sqrt(d[..., 0] ** 2 + d[..., 1] ** 2)
        n = d / length[..., None]
        t = np.stack([-n[..., 1], n[..., 0]], axis=-1)
        # The radii share the length at touch, so that the overlap counts from there.
        share = self.length / (self.radii_i + self.radii_j)
        radii = share * self.radii_i, share * self.radii_j
        return ContactState(length, n, t, np.zeros_like(length), shear, *radii)


def require_steps(law: ContactLaw, touching: Touching) -> None:
    """Raise `InputError` unless one step of the law's contacts can be taken at once."""
    remedy = "Follow loops under this law by gl.follow."
    for broken, received in (
        (isinstance(law, FrictionalLaw) and law.bonded, "bonds, which break for good"),
        (not law.keeps_strength, "a sliding shear force that has its own rate"),
    ):
        if broken:
            raise InputError("law of the material", received, "a law of the present state", remedy)
    d = (1.0 - TRIAL_OVERLAP) * touching.length[:, None] * np.array([1.0, 0.0])
    state = touching.state(d, np.zeros(len(d)))
    try:
        N = np.broadcast_to(np.asarray(law.closed_force(state), dtype=float), len(d))
        # A coupling may go with the shear force.
        state = replace(state, normal_force=N, shear_force=TRIAL_SHEAR * np.abs(N))
        elastic = np.full(len(d), Regime.ELASTIC, dtype=np.int8)
        stiffness = law.local_stiffness(state, elastic)
    except (NotImplementedError, ValueError, IndexError) as error:
        received = f"{type(law).__name__}: {error}"
        expected = f"stiffnesses of {len(d)} contacts"
        raise InputError("law of the material", received, expected, "Correct the law.") from None
    compiled = steps_of(law, touching).compiled is not None
    if not compiled and (np.any(stiffness[..., 0, 1]) or np.any(stiffness[..., 1, 0])):
        received = "a stiffness between normal and shear"
        raise InputError("law of the material", received, "none while it sticks", remedy)


@dataclass(frozen=True, eq=False)
class CompiledLaw:
    """Kind of a compiled law, how it counts shear, and the parameters (m, 4) of its contacts."""

    kind: int
    by_radii: bool
    parameters: Floats


@dataclass(frozen=True, eq=False)
class ContactSteps:
    """Contacts of one law, whose steps are taken together; `compiled` where it is a known one."""

    law: ContactLaw
    touching: Touching
    compiled: CompiledLaw | None

    def __call__(self, start: Floats, end: Floats, shear: Floats) -> Floats:
        """Return the answers (q, m, 8) of contacts that move between branches (q, m, 2).

        `shear` (q, m) are their shear forces at the start.
        """
        if self.compiled is None:
            return _protocol_steps(self.law, self.touching, start, end, shear)
        answer = np.empty((*shear.shape, ANSWER))
        known = self.compiled
        contact_steps(known.kind, known.by_radii, known.parameters, start, end, shear, answer)
        return answer


def steps_of(law: ContactLaw, touching: Touching) -> ContactSteps:
    """Return the contacts of a law, compiled where its springs are a power of the overlap."""
    radii = np.stack([touching.radii_i, touching.radii_j])
    if not isinstance(law, FrictionalLaw) or (springs := law.power_springs(radii)) is None:
        return ContactSteps(law, touching, None)
    power, *numbers = springs
    columns = [np.asarray(one, dtype=float) for one in (touching.length, *numbers, law.mu)]
    parameters = np.ascontiguousarray(np.stack(np.broadcast_arrays(*columns), axis=-1))
    kind = KERNELS[power, law.shear_history]
    known = CompiledLaw(kind, law.shear_increment == "radii", parameters)
    return ContactSteps(law, touching, known)


def _protocol_steps(
    law: ContactLaw, touching: Touching, start: Floats, end: Floats, shear: Floats
) -> Floats:
    """Return the answers of contacts by the law's own methods, (q, m, 8)."""
    state = touching.state(end, shear)
    closed = law.gap(state) < TOUCHING_RTOL * touching.length
    normal = np.where(closed, law.closed_force(state), 0.0)
    state = replace(state, normal_force=normal)
    elastic = np.full(normal.shape, Regime.ELASTIC, dtype=np.int8)
    kn = law.local_stiffness(state, elastic)[..., 0, 0]
    trial, slope = _trial(law, touching, start, end, shear)
    strength = law.strength(state)
    slides = (np.abs(trial) > strength) | (np.asarray(law.mu) == 0.0)
    state = replace(state, shear_force=np.where(trial > 0.0, strength, -strength))
    sliding = law.local_stiffness(state, np.full_like(elastic, Regime.SLIDING))[..., 1, 0]
    slope = np.where(slides[..., None], -sliding[..., None] * state.n, slope)
    T = np.where(closed, np.where(slides, state.shear_force, trial), 0.0)
    n, t = state.n, state.t
    force = normal[..., None] * n + T[..., None] * t
    turning = t[..., None, :] / state.length[..., None, None]
    gradient = (
        -kn[..., None, None] * n[..., None] * n[..., None, :]
        + t[..., None] * slope[..., None, :]
        + (normal[..., None] * t - T[..., None] * n)[..., None] * turning
    )
    answer = np.empty((*normal.shape, ANSWER))
    answer[..., FX:KXX] = np.where(closed[..., None], force, 0.0)
    tangent = np.where(closed[..., None, None], -gradient, 0.0)
    answer[..., KXX:SHEAR] = tangent.reshape(*normal.shape, 4)
    answer[..., SHEAR] = T
    regime = np.where(slides, Regime.SLIDING, Regime.ELASTIC)
    answer[..., REGIME] = np.where(closed, regime, Regime.OPEN)
    return answer


def _trial(
    law: ContactLaw, touching: Touching, start: Floats, end: Floats, shear: Floats
) -> tuple[Floats, Floats]:
    """Return the shear force of contacts that stick all the way, and its gradient at the end."""
    h = DIFFERENCE * touching.length[:, None]
    gradient = np.zeros_like(end)
    for axis in range(2):
        for reach, weight in ((1.0, 8.0), (-1.0, -8.0), (2.0, -1.0), (-2.0, 1.0)):
            near = end.copy()
            near[..., axis] += reach * h[:, 0]
            gradient[..., axis] += weight * _stuck(law, touching, start, near, shear)
    return _stuck(law, touching, start, end, shear), gradient / (12.0 * h)


def _stuck(
    law: ContactLaw, touching: Touching, start: Floats, end: Floats, shear: Floats
) -> Floats:
    """Return `T = T_n - integral of kt g t.dd` by five Gauss points, from the touch on."""
    way, far = end - start, (start**2).sum(axis=-1) - touching.length**2
    approach, way2 = (start * way).sum(axis=-1), (way**2).sum(axis=-1)
    root = np.sqrt(np.maximum(approach**2 - way2 * far, 0.0))
    was_open = law.gap(touching.state(start, shear)) > 0.0
    with np.errstate(divide="ignore", invalid="ignore"):
        first = np.where(was_open & (far > 0.0), far / (root - approach), 0.0)
    begin = start + np.clip(np.nan_to_num(first), 0.0, 1.0)[..., None] * way
    way = end - begin
    T = np.where(was_open, 0.0, shear)
    for node, weight in zip(NODES, WEIGHTS, strict=True):
        state = touching.state(begin + node * way, shear)
        state = replace(state, normal_force=law.closed_force(state))
        elastic = np.full(shear.shape, Regime.ELASTIC, dtype=np.int8)
        kt = np.where(law.gap(state) < 0.0, law.local_stiffness(state, elastic)[..., 1, 1], 0.0)
        T = T - weight * kt * law.shear_kinematics(state)[0] * (state.t * way).sum(axis=-1)
    return T


def length_at_touch(law: ContactLaw, touching: Touching, d: Floats, normal: Floats) -> Floats:
    """Return the lengths (m,) at touch with which the law gives the normal forces (m,).

    Forces and positions of a file are each rounded; the overlaps follow the forces. Contacts
    without a force, and laws whose force has no such overlap, keep the sum of the radii.
    """
    given, state = touching.length, touching.state(d, np.zeros(len(d)))
    elastic = np.full(len(d), Regime.ELASTIC, dtype=np.int8)
    length = given.copy()
    for _ in range(50):
        at = replace(touching, length=length).state(d, np.zeros(len(d)))
        force = law.closed_force(at)
        at = replace(at, normal_force=force)
        kn = law.local_stiffness(at, elastic)[..., 0, 0]
        with np.errstate(divide="ignore", invalid="ignore"):
            change = np.where((normal > 0.0) & (kn > 0.0), (normal - force) / kn, 0.0)
        length = length + change
        if np.all(np.abs(change) <= TOUCHING_RTOL * 1e-3 * given):
            return length
    raise InputError(
        "forces of the loops",
        f"{float(normal.max()):.6g} at an overlap of {float(state.overlap.max()):.3g}",
        "normal forces that the law has at some overlap",
        "Give the law of the snapshot.",
    )
