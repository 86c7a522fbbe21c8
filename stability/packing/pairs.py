"""Pairs of grains, or of a grain and a wall, that touch or soon might: law's parameters, frames."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from loops.arrays import Flags, Floats, Integers
from loops.boundary import Boundary
from loops.errors import InputError
from loops.graph import ContactState, GrainGraph, contact_state, require_one_state
from loops.laws import (
    CohesiveFrictional,
    FrictionalLaw,
    HertzMindlin,
    LinearFrictional,
    Regime,
    RollingResistance,
)
from loops.laws.compiled import Filling, answer_of, compiled
from stability.packing.state import PackingState

# A pair at one geometry, as the kernels take it; all lengths but `d` are over the mean radius.
PAIR = np.dtype(
    [
        ("grains", "i8", 2),
        ("d", "f8", 2),  # from the first centre to the second, or to the point of the wall
        ("n", "f8", 2),
        ("t", "f8", 2),
        ("turning", "f8"),  # the shear rate is `turning` times `t . d'`
        ("lever", "f8", 2),  # minus `lever` times the spins
        ("arm", "f8", 2),  # levers of the shear force
        ("rotation", "f8", 2),  # force rate per `t . d'`, as the pair rotates
        ("growth", "f8"),  # moment rate per `n . d'`, as the arms grow
        ("kn", "f8"),
        ("kt", "f8"),
        ("coupling", "f8"),  # stuck, `-T'` per `n . d'`: of a `T` that goes with `kt`
        ("mu", "f8"),  # slope of the strength with N, 0 where it is not finite
        ("cohesion", "f8"),  # the strength less `mu N`
        ("at_touch", "f8"),  # normal force at which it opens and with which it closes
        ("slides", "i8"),  # whether the strength is finite
        ("push", "f8"),  # share of the normal force that acts on the grains: none of a spring's
    ]
)

# Contact laws of paths and equations of motion.
MovableLaw = FrictionalLaw | RollingResistance
# Share of its strength from which a contact is at yield.
AT_YIELD = 1.0 - 1e-6
# Smallest overlap, over the distance of the centres, that stiffnesses are estimated at.
SMALL_OVERLAP = 1e-4
# N over the overlap times Hertz's tangent; the law is his where most contacts are that close to it.
HERTZ, HERTZ_BAND, MOSTLY = 2.0 / 3.0, 0.01, 0.9
# Methods that a law of one's own may not change.
LEFT = ("shear_kinematics", "rolling_stiffness", "regime")
# Forces at touch below this share of those at overlap are rounding: the law has no cohesion.
AT_TOUCH = 1e-9


class OwnLaw(NamedTuple):
    """A law of one's own between grains: parameters, pairs (R,), radii (2, R), reach (R,).

    The reach is the gap across which a closed contact still holds: overlaps here are measured from
    there.
    """

    law: FrictionalLaw
    rows: Integers
    radii: Floats
    reach: Floats

    def contacts(self, overlap: Floats, T: Floats | float = 0.0) -> tuple[Flags, ContactState]:
        """(R,) which pairs touch, and contacts of overlaps (P,); those apart as at a small one."""
        i, j = self.radii
        own, n = overlap[self.rows], np.tile([1.0, 0.0], (len(i), 1))
        length = (i + j) + self.reach - np.where(own > 0, own, SMALL_OVERLAP * (i + j))
        T = np.broadcast_to(T, len(overlap))[self.rows]
        state = ContactState(length, n, n[:, ::-1], 0.0 * length, T, i, j)
        return own > 0, replace(state, normal_force=np.asarray(self.law.closed_force(state)))

    def parting(self) -> ContactState:
        """Return the contacts (R,) where they open, with the force there.

        A force that is rounding beside that at a small overlap is zero.
        """
        _, pressed = self.contacts(np.zeros(int(self.rows.max(initial=-1)) + 1))
        state = replace(pressed, length=pressed.touching_length + self.reach)
        N = np.asarray(self.law.closed_force(state), dtype=float)
        least = AT_TOUCH * np.abs(pressed.normal_force)
        return replace(state, normal_force=np.where(np.abs(N) > least, N, 0.0))

    def stiffness(self, state: ContactState, regime: Regime) -> Floats:
        """(R, 2, 2) `D` of contacts."""
        return self.law.local_stiffness(state, np.full(len(state.length), regime, dtype=np.int8))


def own_law(law: FrictionalLaw, rows: Integers, radii: Floats) -> OwnLaw:
    """Return a law between the pairs `rows` of radii (2, R), with the reach that its gap tells."""
    touching = OwnLaw(law, rows, radii, np.zeros(len(rows))).parting()
    return OwnLaw(law, rows, radii, np.broadcast_to(-law.gap(touching), len(rows)))


class Rolling(NamedTuple):
    """Springs against rolling (P,): stiffness, zero at walls, and `|M|/(R N)` at the limit."""

    k_r: Floats
    mu_r: Floats


@dataclass(frozen=True, eq=False)
class Pairs:
    """Pairs (P, 2) with the image of the second grain (P, 2), and `kn`, `kt`, `mu` (P,).

    The second one of a pair is the wall, if there is one. Under Hertz's law `kn`, `kt` are the
    tangents over the root of the overlap, `N = 2/3 kn overlap^(3/2)`; `by_displacement`, `T` goes
    with `kt`. A law of one's `own` holds between grains, `kn` and `kt` at walls alone.
    """

    grains: Integers
    images: Integers
    kn: Floats
    kt: Floats
    mu: Floats
    hertz: bool = False
    by_displacement: bool = False
    own: OwnLaw | None = None
    rolling: Rolling | None = None

    def __len__(self) -> int:
        return len(self.grains)

    @property
    def linear(self) -> bool:
        """Whether all springs are linear."""
        return not (self.hertz or self.own)

    @cached_property
    def reach(self) -> Floats:
        """(P,) gap at which a closed pair opens: zero but for bonds."""
        gap = np.zeros(len(self))
        if self.own:
            gap[self.own.rows] = self.own.reach
        return gap

    def parted(self, opened: Flags) -> Pairs:
        """Return the pairs once some of them (P,) have opened: bonds among these are gone."""
        if not (self.own and opened[self.own.rows].any()):
            return self
        law = self.own.law.parted(opened[self.own.rows])
        if law is self.own.law:
            return self
        return replace(self, own=own_law(law, self.own.rows, self.own.radii))

    @cached_property
    def at_touch(self) -> Floats:
        """(P,) normal force where a closed pair opens: zero without cohesion, else below."""
        force = np.zeros(len(self))
        if self.own:
            force[self.own.rows] = self.own.parting().normal_force
        return force

    def filling(self, compile_own: bool) -> Filling | str:
        """Return the law as the kernel of motion calls it; or why numpy is asked in its place."""
        from loops.compiled import laws as kernels

        constants = np.array([self.kn, self.kt, self.mu])
        if self.hertz:
            constants[0] *= HERTZ
            fill = kernels.hertz_by_displacement if self.by_displacement else kernels.hertz
            return Filling(kernels.Pointer(fill), constants)
        if not self.own:
            return Filling(kernels.Pointer(kernels.linear), constants)
        law, rows = self.own.law, self.own.rows
        if type(law) is CohesiveFrictional:
            constants = np.concatenate([constants, np.zeros((2, len(self)))])
            attraction = 0.0 if law.bonded else law.adhesion
            for row, of in enumerate((law.kn, law.kt, law.mu, attraction, law.cohesion)):
                constants[row, rows] = of
            return Filling(kernels.Pointer(kernels.cohesive), constants)
        if not compile_own:
            return "numpy"
        constants[:, rows] = 0.0
        return compiled(law, rows, self.own.radii, constants)

    def answer(self, overlap: Floats, before: Floats, T: Floats) -> Floats:
        """Return (4, P) what the law fills in at overlaps that are positive where pairs touch."""
        assert self.own is not None
        # Walls; between grains these are no numbers, and filled by the law.
        with np.errstate(invalid="ignore"):
            out = np.array([self.kn * overlap, self.kt, self.mu * self.kn * overlap, T])
        rows = self.own.rows
        now = (overlap[rows], before[rows], T[rows])
        out[:, rows] = answer_of(self.own.law, self.own.radii, *now)
        return out

    @cached_property
    def strength_at_touch(self) -> Floats:
        """(P,) shear force that pairs can carry where they open."""
        most = np.zeros(len(self))
        if self.own:
            rows = self.own.rows
            finite = np.isfinite(self.mu[rows])
            at_touch = np.where(finite, self.own.law.strength(self.own.parting()), 0.0)
            least = AT_TOUCH * np.where(finite, self.mu[rows], 0.0) * np.abs(self.at_touch[rows])
            most[rows] = np.where(at_touch > least, at_touch, 0.0)
        return most


def touching_distances(state: PackingState, pairs: Pairs) -> Floats:
    """(P,) distances of the centres at which pairs open: at touch, of bonds beyond it."""
    return np.asarray(state.radii[pairs.grains].sum(axis=1) + pairs.reach)


def overlaps(state: PackingState, pairs: Pairs) -> Floats:
    """(P,) overlaps, zero where a pair is apart."""
    length = np.linalg.norm(state.branches, axis=1)
    return np.asarray(np.maximum(touching_distances(state, pairs) - length, 0.0))


def normal_forces(pairs: Pairs, overlap: Floats) -> Floats:
    """(..., P) `N` of the overlaps."""
    N = HERTZ * pairs.kn * overlap**1.5 if pairs.hertz else pairs.kn * overlap
    if pairs.own:
        for of, all_overlaps in zip(np.atleast_2d(N), np.atleast_2d(overlap), strict=True):
            touch, state = pairs.own.contacts(all_overlaps)
            of[pairs.own.rows] = np.where(touch, state.normal_force, 0.0)
    return N


def with_normal_forces(state: PackingState, pairs: Pairs) -> PackingState:
    """Return the state with normal forces of its overlaps; what overlaps is closed."""
    overlap = overlaps(state, pairs)
    return replace(state, normal_force=normal_forces(pairs, overlap), closed=overlap > 0)


def tangents(pairs: Pairs, overlap: Floats) -> tuple[Floats, Floats]:
    """(P,) `kn` and `kt` at the overlaps."""
    if pairs.own:
        kn, kt, _ = own_stiffness(pairs, overlap, np.zeros(len(pairs)))
        return kn, kt
    root = np.sqrt(overlap) if pairs.hertz else 1.0
    return pairs.kn * root, pairs.kt * root


def own_stiffness(pairs: Pairs, overlap: Floats, T: Floats) -> tuple[Floats, Floats, Floats]:
    """(P,) `kn`, `kt` and `-dT/dun` of stuck pairs, zero between grains that don't touch."""
    assert pairs.own is not None
    touch, state = pairs.own.contacts(overlap, T)
    D = np.where(touch[:, None, None], pairs.own.stiffness(state, Regime.ELASTIC), 0.0)
    kn, kt, coupling = pairs.kn.copy(), pairs.kt.copy(), np.zeros(len(pairs))
    rows = pairs.own.rows
    kn[rows], kt[rows], coupling[rows] = D[:, 0, 0], D[:, 1, 1], D[:, 1, 0]
    return kn, kt, coupling


def normal_energy(pairs: Pairs, overlap: Floats) -> Floats:
    """(P,) energy of the normal springs at the overlaps."""
    energy = (0.4 if pairs.hertz else 0.5) * normal_forces(pairs, overlap) * overlap
    if pairs.own:
        touch, state = pairs.own.contacts(overlap)
        parting = pairs.own.law.normal_energy(pairs.own.parting())
        energy[pairs.own.rows] = np.where(touch, pairs.own.law.normal_energy(state), parting)
    return energy


def typical_stiffness(pairs: Pairs, state: PackingState) -> Floats:
    """(P,) `kn`, of pairs that hardly touch at a small overlap."""
    least = SMALL_OVERLAP * touching_distances(state, pairs)
    return tangents(pairs, np.maximum(overlaps(state, pairs), least))[0]


def strength(pairs: Pairs, state: PackingState) -> Floats:
    """(P,) shear force that pairs can carry, infinite where a closed contact never slides."""
    finite = np.isfinite(pairs.mu)
    most = np.where(finite, np.where(finite, pairs.mu, 0.0) * state.normal_force, np.inf)
    if pairs.own:
        rows, (touch, own) = pairs.own.rows, pairs.own.contacts(overlaps(state, pairs))
        most[rows] = np.where(touch & finite[rows], pairs.own.law.strength(own), most[rows])
    return most


def at_limit(pairs: Pairs, state: PackingState, share: float = AT_YIELD) -> Flags:
    """(P,) closed contacts whose shear force has this share of their strength at least."""
    reached = np.abs(state.shear_force) >= share * strength(pairs, state)
    return np.asarray(state.closed & reached)


def rolling_reach(pairs: Pairs, state: PackingState) -> Floats:
    """(P,) largest `|M|/(N - at_touch)` of rolling springs, infinite where there is none."""
    if pairs.rolling is None:
        return np.full(len(pairs), np.inf)
    R = _effective_radii(state.radii[pairs.grains])
    k_r, mu_r = pairs.rolling
    finite = (k_r > 0) & np.isfinite(mu_r)
    return np.where(finite, np.where(finite, mu_r, 0.0) * R, np.inf)


def rolling_strength(pairs: Pairs, state: PackingState) -> Floats:
    """(P,) rolling moment that pairs can carry."""
    reach = rolling_reach(pairs, state)
    finite = np.isfinite(reach)
    N = state.normal_force - np.where(state.closed, pairs.at_touch, 0.0)
    return np.where(finite, np.where(finite, reach, 0.0) * N, np.inf)


def rolling_energy(pairs: Pairs, M: Floats) -> float:
    """Energy of rolling springs with these moments."""
    if pairs.rolling is None:
        return 0.0
    k_r = pairs.rolling.k_r
    return float(np.sum(np.divide(M**2, 2.0 * k_r, out=0.0 * M, where=k_r > 0)))


def require_movable(graph: GrainGraph, law: object) -> MovableLaw:
    """The law of paths and equations of motion; refuse others, and graphs that carry nothing.

    The normal force is one of the overlap; where the grains part it vanishes, or pulls.
    """
    require_one_state(graph)
    if not graph.contact_count:
        raise InputError("packing", "no contacts", "a packing that carries", "Compress it first.")
    state, name = contact_state(graph), type(law).__name__
    closed = (graph.normal_force != 0) & (state.overlap > 0)
    if isinstance(law, RollingResistance):
        require_movable(graph, law.law)
        if not isinstance(law.law, RollingResistance):
            return law
    if not isinstance(law, FrictionalLaw):
        expected = "a law derived from gl.FrictionalLaw, and at most one spring for rolling"
        raise InputError("law", name, expected, "Give another, or compute tangents alone.")
    if type(law) is LinearFrictional:
        hertz = HERTZ * (law.kn * state.overlap)[closed]
        as_hertz = np.abs(graph.normal_force[closed] - hertz) < HERTZ_BAND * hertz
        if np.count_nonzero(as_hertz) > MOSTLY * len(as_hertz):
            received = "normal forces of 2/3 of kn times the overlap, as Hertz's tangents give them"
            expected = "linear springs, of which N is kn times the overlap"
            remedy = "Give law='hertz' (--law hertz), or study rates."
            raise InputError("law", received, expected, remedy)
    elif type(law) is not HertzMindlin:
        changed = [m for m in LEFT if getattr(type(law), m) is not getattr(FrictionalLaw, m)]
        changed += [] if law.keeps_strength else ["keeps_strength"]
        if changed:
            expected = "in paths of packings a law that leaves these to gl.FrictionalLaw"
            remedy = "Leave them out, or use the law for single loops."
            raise InputError("law", f"{name} with {', '.join(changed)}", expected, remedy)
        ij = graph.radii[graph.contacts].T
        try:
            own = own_law(law, np.arange(len(closed)), ij)
            _, pressed = own.contacts(state.overlap)
            D = own.stiffness(pressed, Regime.ELASTIC)
        except NotImplementedError as lacks:
            expected = "closed_force, and kt or stiffnesses"
            remedy = "Add it to the class."
            raise InputError("law", f"{name} without {lacks}", expected, remedy) from None
        parting = own.parting()
        rise = law.gap(pressed) - law.gap(parting)
        if np.any(own.reach < 0) or not np.allclose(rise, pressed.length - parting.length):
            expected = (
                "a gap of the branch less its length where the contact opens, at touch or beyond"
            )
            raise InputError("law", f"{name} with gap", expected, "Use the law for single loops.")
        if np.any(parting.normal_force > 0) or np.any(D[:, 0, 1] != 0):
            expected = "a normal force of the overlap alone that vanishes or pulls at touch"
            raise InputError("law", name, expected, "Use the law for single loops.")
        least = np.where(np.isfinite(law.mu), law.strength(parting), 0.0)
        if np.any(least < -AT_TOUCH * np.abs(parting.normal_force)):
            expected = "a strength that is not negative where the contact pulls"
            remedy = "Give the class a strength such as mu (N + adhesion)."
            raise InputError(
                "law", f"{name} with a strength of {least.min():.2g}", expected, remedy
            )
    return law


def contact_pairs(start: PackingState, law: MovableLaw, boundary: Boundary | None = None) -> Pairs:
    """The contacts of the start as pairs, those with walls last; `require_movable` gives the law.

    Under Hertz's law walls have the stiffness over the root of the overlap that their forces tell,
    and the ratio of their `kt` to `kn`. Walls have no springs for rolling.
    """
    if isinstance(law, RollingResistance):
        free = contact_pairs(start, cast(FrictionalLaw, law.law), boundary)
        grains = int(np.count_nonzero(~start.at_wall))
        numbers = [np.broadcast_to(k, grains).astype(float) for k in (law.k_r, law.mu_r)]
        k_r, mu_r = (np.append(k, np.zeros(len(free) - grains)) for k in numbers)
        return replace(free, rolling=Rolling(k_r, mu_r)) if k_r.any() else free
    count, hertz, own = int(np.count_nonzero(~start.at_wall)), type(law) is HertzMindlin, None
    radii = start.radii[start.contacts[:count]]
    kn = kt = np.zeros(count)
    if type(law) is HertzMindlin:
        kn = law.young / (1.0 - law.poisson**2) * np.sqrt(_effective_radii(radii))
        kt = law.stiffness_ratio * kn
    elif type(law) is LinearFrictional:
        kn, kt = law.kn, law.kt
    else:
        own = own_law(law, np.arange(count), radii.T)
    numbers = [np.broadcast_to(k, count).astype(float) for k in (kn, kt, law.mu)]
    planes = None if boundary is None else boundary.walls
    if len(start.walls) and planes is not None:
        mu = np.where(planes.kt > 0, np.inf, 0.0) if planes.mu is None else planes.mu
        kn, kt = planes.kn, planes.kt
        if hertz:
            foot = np.linalg.norm(planes.branch, axis=1)
            root = np.sqrt(np.maximum(start.radii[planes.grain] - foot, 0.0))
            carried = start.normal_force[count:]
            told = (root > 0) & (carried > 0)
            over = np.where(told, root, 1.0)
            fitted = np.where(told, carried / (HERTZ * over**3), kn)
            kn, kt = fitted, kt * fitted / kn
        numbers = [np.append(k, one) for k, one in zip(numbers, (kn, kt, mu), strict=True)]
    by_displacement = type(law) is HertzMindlin and law.shear_history == "displacement"
    kn, kt, mu = numbers
    pairs = Pairs(start.contacts, start.images, kn, kt, mu, hertz, by_displacement, own)
    return pairs.parted(overlaps(start, pairs) == 0)


def law_of(law: MovableLaw, pairs: Pairs, rows: Flags, state: PackingState) -> MovableLaw:
    """The law of the picked pairs between grains, of the same kind as the one given."""
    if isinstance(law, RollingResistance):
        inner = law_of(cast(FrictionalLaw, law.law), pairs, rows, state)
        parts = (0.0, np.inf) if pairs.rolling is None else (k[rows] for k in pairs.rolling)
        return RollingResistance(inner, *parts)
    if pairs.own:
        return pairs.own.law.take(np.flatnonzero(rows[pairs.own.rows]))
    kn, kt, mu = (k[rows] for k in (pairs.kn, pairs.kt, pairs.mu))
    if not isinstance(law, HertzMindlin):
        return LinearFrictional(kn, kt, mu, law.shear_increment)
    modulus = kn / np.sqrt(_effective_radii(state.radii[pairs.grains[rows]]))
    return HertzMindlin(modulus, 0.0, mu, law.shear_increment, law.shear_history, kt / kn)


def frame_of(state: PackingState, pairs: Pairs, by_radii: bool, reach: float = 0.0) -> NDArray[Any]:
    """Records `PAIR` (P,) of the pairs at the geometry and forces of a state.

    With springs for rolling (2 P,): theirs come after, with `T` the moment over the mean radius.

    Springs that are not linear have their tangents, and those with an overlap below `reach`, which
    may open, `N` over the overlap: so they open where the grains part. Open ones have those at it.
    """
    frame = np.empty(len(pairs), dtype=PAIR)
    d = state.branches
    length = np.linalg.norm(d, axis=1)
    n = d / length[:, None]
    t = np.column_stack([-n[:, 1], n[:, 0]])
    radii = state.radii[pairs.grains]
    arms = 0.5 * (length[:, None] + radii - radii[:, ::-1])
    unit = state.mean_radius
    N, T = state.normal_force, state.shear_force
    frame["grains"], frame["d"], frame["n"], frame["t"] = pairs.grains, state.apart, n, t
    frame["turning"] = radii.sum(axis=1) / length if by_radii else 1.0
    frame["lever"] = (radii if by_radii else arms) / unit
    frame["arm"] = arms / unit
    frame["rotation"] = (N[:, None] * t - T[:, None] * n) / length[:, None]
    # A wall keeps its direction.
    frame["rotation"][state.at_wall] = 0.0
    frame["growth"] = 0.5 * T / unit
    frame["kn"], frame["kt"], frame["coupling"] = pairs.kn, pairs.kt, 0.0
    frame["slides"] = np.isfinite(pairs.mu)
    frame["mu"], frame["cohesion"] = np.where(frame["slides"], pairs.mu, 0.0), 0.0
    frame["at_touch"] = pairs.at_touch
    if not pairs.linear:
        overlap = touching_distances(state, pairs) - length
        closed = overlap > 0
        at = np.where(closed, overlap, reach)
    if pairs.hertz:
        kn, frame["kt"] = tangents(pairs, at)
        frame["kn"] = np.where(overlap > reach, kn, HERTZ * kn)
        if pairs.by_displacement:
            frame["coupling"] = np.where(closed, T / (2.0 * np.where(closed, overlap, 1.0)), 0.0)
    if pairs.own:
        _add_own(frame, pairs, at, T, overlap > reach)
    frame["push"] = 1.0
    if pairs.rolling is None:
        return frame
    # A spring against rolling slides at a share of the N of its pair, and shears by the spins.
    springs = frame.copy()
    for name in ("t", "turning", "rotation", "growth", "coupling", "push"):
        springs[name] = 0.0
    springs["lever"] = springs["arm"] = 1.0, -1.0
    springs["kt"] = pairs.rolling.k_r / unit**2
    most = rolling_reach(pairs, state) / unit
    springs["slides"] = np.isfinite(most)
    springs["mu"] = np.where(springs["slides"], most, 0.0)
    springs["cohesion"] = -springs["mu"] * springs["at_touch"]
    return np.concatenate([frame, springs])


def _add_own(frame: NDArray[Any], pairs: Pairs, at: Floats, T: Floats, far: Flags) -> None:
    """Stiffness and strength between grains, from touch to `at` where they are not `far` in."""
    own = pairs.own
    assert own is not None
    rows, (touch, state) = own.rows, own.contacts(at, 1.0)
    kn, frame["kt"], frame["coupling"] = own_stiffness(pairs, at, T)
    N0, most0 = pairs.at_touch[rows], pairs.strength_at_touch[rows]
    overlap, N = np.where(touch, at[rows], 1.0), np.where(touch, state.normal_force, N0)
    slides = frame["slides"][rows].astype(bool)
    most = np.where(slides & touch, own.law.strength(state), 0.0)
    rise, D = N - N0, own.stiffness(state, Regime.SLIDING)
    slope = np.divide(most - most0, rise, out=0.0 * N, where=slides & (rise > 0))
    steep = D[:, 1, 0] / np.where(D[:, 0, 0] > 0, D[:, 0, 0], 1.0)
    slope = np.where(far[rows] & slides, steep, slope)
    frame["kn"] = kn
    frame["kn"][rows] = np.where(far[rows], kn[rows], rise / overlap)
    frame["mu"][rows] = slope
    frame["cohesion"][rows] = np.where(far[rows], most - slope * N, most0 - slope * N0)


def with_near(pairs: Pairs, state: PackingState, gap: float) -> Pairs:
    """The pairs, then all others closer than `gap`, with medians of the parameters.

    A wall is as stiff to other grains as to those that are known, over their radius if that varies
    less. Under Hertz's law stiffness goes with the root of the effective radius.
    """
    count, radii, walls = state.count, state.radii, state.walls
    grains, images = near_pairs(state.x[:count], state.cell, radii[:count], gap)
    if len(walls):
        away = np.sum((state.x[:count, None] - state.x[count:]) * walls, axis=2)
        grain, wall = np.nonzero(away < radii[:count, None] + gap)
        near = np.column_stack([grain, count + wall])
        grains = np.vstack([grains[~images.any(axis=1)], near])
        images = np.zeros_like(grains)
    near, known = _codes((grains, images), _ordered(pairs.grains, pairs.images))
    new = ~np.isin(near, known)
    grains, images = grains[new], images[new]
    one, other = np.ones(len(pairs)), np.ones(len(grains))
    if pairs.hertz:
        one, other = (np.sqrt(_effective_radii(radii[g])) for g in (pairs.grains, grains))
    numbers = []
    for k, old, fresh in ((pairs.kn, one, other), (pairs.kt, one, other), (pairs.mu, 1.0, 1.0)):
        k = k / old
        added = np.full(len(grains), np.median(k[pairs.grains[:, 1] < count]))
        for body in range(count, count + len(walls)):
            of, own = pairs.grains[:, 1] == body, grains[:, 1] == body
            added[own] = _as_known(k[of], radii[pairs.grains[of, 0]], radii[grains[own, 0]])
        numbers.append(np.append(k * old, added * fresh))
    kn, kt, mu = numbers
    every, own = np.concatenate([pairs.grains, grains]), pairs.own
    if own:
        # The contact of the median stiffness stands for the new ones.
        _, pressed = own.contacts(np.zeros(len(pairs)))
        stiff = own.stiffness(pressed, Regime.ELASTIC)[:, 0, 0]
        added_rows = len(pairs) + np.flatnonzero(grains[:, 1] < count)
        typical = np.full(len(added_rows), np.argsort(stiff)[len(stiff) // 2])
        law = own.law.take(np.append(np.arange(len(stiff)), typical))
        rows = np.append(own.rows, added_rows)
        # What touches later was never bonded.
        law = law.parted(np.arange(len(rows)) >= len(stiff))
        own = own_law(law, rows, radii[every[rows]].T)
    at, rolling = np.concatenate([pairs.images, images]), pairs.rolling
    if rolling:
        at_wall = grains[:, 1] >= count
        medians = [np.median(k[pairs.grains[:, 1] < count]) for k in rolling]
        more = [np.where(at_wall, 0.0, median) for median in medians]
        rolling = Rolling(*map(np.append, rolling, more))
    return Pairs(every, at, kn, kt, mu, pairs.hertz, pairs.by_displacement, own, rolling)


def _effective_radii(radii: Floats) -> Floats:
    """(P,) `r_i r_j/(r_i + r_j)` of radii (P, 2); of the grain alone at a wall."""
    i, j = radii.T
    return np.asarray(np.where(j > 0, i * j / (i + j), i))


def _as_known(values: Floats, radii: Floats, others: Floats) -> Floats:
    """The mean of the values, or of the values over the radii where that varies less."""
    mean = float(values.mean())
    if not np.isfinite(mean):
        return np.full(len(others), mean)
    per_radius = values / radii
    if np.std(per_radius) * mean < np.std(values) * per_radius.mean():
        return np.asarray(per_radius.mean() * others)
    return np.full(len(others), mean)


def near_pairs(x: Floats, cell: Floats, radii: Floats, gap: float) -> tuple[Integers, Integers]:
    """Pairs (P, 2) whose surfaces are closer than `gap`, smaller grain first, and their images."""
    reach = 2.0 * float(radii.max()) + gap
    share = np.linalg.solve(cell, x.T).T
    home = np.floor(share).astype(np.int64)
    share = share - home
    # Images of grains are needed up to this distance from the cell, in shares of its sides.
    margin = reach * np.linalg.norm(np.linalg.inv(cell), axis=1)
    count = np.ceil(margin).astype(int)
    shifts = np.stack(
        np.meshgrid(*(np.arange(-m, m + 1) for m in count), indexing="ij"), axis=-1
    ).reshape(-1, 2)
    copies = share[None] + shifts[:, None]
    shift, j = np.nonzero(((copies > -margin) & (copies < 1 + margin)).all(axis=2))
    tree = cKDTree(copies[shift, j] @ cell.T)
    found = cKDTree(share @ cell.T).sparse_distance_matrix(tree, reach, output_type="coo_matrix")
    i, other = found.row.astype(np.int64), found.col
    second, image = j[other], shifts[shift[other]] + home[i] - home[j[other]]
    first = i < second
    own = (i == second) & ((image[:, 0] > 0) | ((image[:, 0] == 0) & (image[:, 1] > 0)))
    close = found.data < radii[i] + radii[second] + gap
    kept = (first | own) & close
    return np.column_stack([i, second])[kept], image[kept]


def _codes(*lists: tuple[Integers, Integers]) -> list[Integers]:
    """One number for each pair and image, the same in all lists."""
    bodies = max(int(grains.max(initial=0)) for grains, _ in lists) + 1
    farthest = max(int(np.abs(images).max(initial=0)) for _, images in lists)
    sides = 2 * farthest + 1
    return [
        ((grains[:, 0] * bodies + grains[:, 1]) * sides + images[:, 0]) * sides + images[:, 1]
        for grains, images in lists
    ]


def _ordered(grains: Integers, images: Integers) -> tuple[Integers, Integers]:
    """The smaller grain first, of one grain the larger image."""
    i, j = grains.T
    back = (images[:, 0] < 0) | ((images[:, 0] == 0) & (images[:, 1] < 0))
    flip = (i > j) | ((i == j) & back)
    return (
        np.where(flip[:, None], grains[:, ::-1], grains),
        np.where(flip[:, None], -images, images),
    )
