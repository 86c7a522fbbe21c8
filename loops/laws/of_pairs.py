"""Formulae of contact laws for the pairs of a packing at their overlaps, one class a kind of law.

A pair is two grains, or a grain and a wall. Those who ask know none of the kinds: springs of an
interval (`tangent`), forces, energies, strengths, the law as the kernel of motion calls it
(`filling`). A wall is a plane under the same law, of a stiffness of its own; a spring against
rolling stands beside any law.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar, NamedTuple, Self, cast

import numpy as np

from loops.arrays import Flags, Floats, Integers, median
from loops.graph import ContactState
from loops.laws.cohesive import CohesiveFrictional
from loops.laws.compiled import Filling, answer_of, compiled, pressed_contacts
from loops.laws.frictional import ContactLaw, FrictionalLaw, LinearFrictional, Regime
from loops.laws.hertz_mindlin import HERTZ, HertzMindlin, effective_radius
from loops.laws.rolling_resistance import RollingResistance

# Contact laws of paths and equations of motion.
MovableLaw = FrictionalLaw | RollingResistance
# Smallest overlap, over the distance of the centres, that stiffnesses are estimated at.
SMALL_OVERLAP = 1e-4
# Stiffness over the one given, at most and at least, that the force of a wall may tell: beyond, its
# overlap is rounding.
AS_GIVEN = 3.0
# Forces at touch below this share of those at overlap are rounding: the law has no cohesion.
AT_TOUCH = 1e-9


class WallSprings(NamedTuple):
    """Contacts with walls: tangent stiffnesses, friction, overlaps and normal forces, (W,)."""

    kn: Floats
    kt: Floats
    mu: Floats
    overlap: Floats
    force: Floats


AtWalls = WallSprings | None


class Tangent(NamedTuple):
    """Springs of pairs (P,) over an interval: `N' = -kn un'`, `T' = -kt ut' - coupling un'`.

    The strength is `mu N + cohesion`, where it is finite.
    """

    kn: Floats
    kt: Floats
    coupling: Floats
    mu: Floats
    cohesion: Floats


@dataclass(frozen=True, eq=False)
class PairLaw:
    """Linear springs between pairs (P,), and what all laws of pairs have.

    `law` holds between grains; `radii` (2, P), zero at walls; `wall` the number of the wall, -1
    between grains; `kn`, `kt`, `mu` constants of the pairs; `reach` the gap at which a closed pair
    opens, zero but for bonds; `k_r`, `mu_r` stiffness against rolling, zero at walls and where
    there is no such spring, and `|M|/(R N)` at its limit.
    """

    law: FrictionalLaw
    radii: Floats
    wall: Integers
    kn: Floats
    kt: Floats
    mu: Floats
    reach: Floats
    k_r: Floats
    mu_r: Floats

    # Whether springs are constant, so that an increment knows their energy.
    linear: ClassVar[bool] = True

    def __len__(self) -> int:
        return len(self.wall)

    @property
    def remembers(self) -> bool:
        """Whether the law asks for the overlap a step before."""
        return False

    @property
    def compiled(self) -> bool | None:
        """Whether the equations of motion have to compile the law; None where they may choose."""
        return None

    @property
    def by_radii(self) -> bool:
        """Whether a turn of the branch shears by the radii, see `FrictionalLaw`."""
        return self.law.shear_increment == "radii"

    # ---- how it is made

    @classmethod
    def made(cls, law: FrictionalLaw, radii: Floats, wall: Integers, walls: AtWalls = None) -> Self:
        """Return the law of pairs, those with walls last."""
        count = int(np.count_nonzero(wall < 0))
        kn, kt, mu = (
            np.broadcast_to(k, count).astype(float)
            for k in (*cls.grain_springs(law, radii[:, :count]), law.mu)
        )
        none = np.zeros(count)
        rest = none, none, np.full(count, np.inf)
        pairs = cls(law, radii[:, :count], wall[:count], kn, kt, mu, *rest).with_law(law)
        return pairs.with_walls(radii[:, count:], wall[count:], walls) if walls else pairs

    @classmethod
    def grain_springs(cls, law: FrictionalLaw, radii: Floats) -> tuple[Floats, Floats]:
        """Return the constants `kn`, `kt` between grains of radii (2, C)."""
        known = cast(LinearFrictional, law)
        return known.kn, known.kt

    def with_walls(self, radii: Floats, wall: Integers, walls: WallSprings) -> Self:
        """Return the law with contacts at walls, of the forces and of the `kt/kn` given."""
        ones = np.ones(len(wall))
        unit = self._with_rows(radii, wall, ones, ones, walls.mu, 0.0 * ones, np.inf * ones)
        at = np.append(np.zeros(len(self)), np.maximum(walls.overlap, SMALL_OVERLAP * radii[0]))
        N, kn, kt = (k[len(self) :] for k in (unit.normal_force(at), *unit.stiffnesses(at)))
        by_force, given = walls.force / N, walls.kn / kn
        known = (walls.overlap > 0) & (by_force < AS_GIVEN * given) & (given < AS_GIVEN * by_force)
        share = np.where(known, by_force, given)
        shear = share * kn / kt * walls.kt / walls.kn
        return replace(unit, kn=np.append(self.kn, share), kt=np.append(self.kt, shear))

    def with_law(self, law: FrictionalLaw) -> Self:
        """Return the same pairs under another law of this kind."""
        return self

    def grown(self, radii: Floats, wall: Integers) -> Self:
        """Return the law with further pairs of radii (2, Q), whose constants are medians.

        A wall is as stiff to other grains as to those that are known, over their radius if that
        varies less.
        """
        between, numbers = self.wall < 0, []
        old, fresh = self.scale(self.radii), self.scale(radii)
        units = ((self.kn, old, fresh), (self.kt, old, fresh), (self.mu, 1.0, 1.0))
        for k, one, other in units:
            k = k / one
            added = np.full(len(wall), median(k[between]))
            for number in np.unique(wall[wall >= 0]):
                of, own = self.wall == number, wall == number
                added[own] = as_known(k[of], self.radii[0, of], radii[0, own])
            numbers.append(added * other)
        k_r, mu_r = (np.where(wall >= 0, 0.0, median(k[between])) for k in (self.k_r, self.mu_r))
        return self._with_rows(radii, wall, *numbers, k_r, mu_r)

    def _with_rows(self, radii: Floats, wall: Integers, *numbers: Floats) -> Self:
        """Return the law with further pairs, of these `kn`, `kt`, `mu`, `k_r`, `mu_r`."""
        law = self._with_typical(len(wall))
        radii = np.ascontiguousarray(np.hstack([self.radii, radii]))
        wall = np.append(self.wall, wall)
        old = self.kn, self.kt, self.mu, self.k_r, self.mu_r
        kn, kt, mu, k_r, mu_r = (np.append(*k) for k in zip(old, numbers, strict=True))
        reach = np.append(self.reach, np.zeros(len(wall) - len(self)))
        return type(self)(law, radii, wall, kn, kt, mu, reach, k_r, mu_r).with_law(law)

    def _with_typical(self, count: int) -> FrictionalLaw:
        """Return the law whose formulae hold for `count` further pairs."""
        return self.law

    def scale(self, radii: Floats) -> Floats | float:
        """Return what stiffnesses of pairs of radii (2, P) go with."""
        return 1.0

    def parted(self, opened: Flags) -> Self:
        """Return the law once some pairs (P,) have opened: bonds among these are gone."""
        return self

    def taken(self, rows: Integers) -> Self:
        """Return the law of some pairs alone, `rows` in ascending order."""
        names = ("radii", "wall", "kn", "kt", "mu", "reach", "k_r", "mu_r")
        return replace(self, **{name: getattr(self, name)[..., rows] for name in names})

    def picked(self, rows: Flags) -> FrictionalLaw:
        """Return the law of the picked pairs (P,) between grains, without springs for rolling."""
        kn, kt, mu = (k[rows] for k in (self.kn, self.kt, self.mu))
        return LinearFrictional(kn, kt, mu, self.law.shear_increment)

    # ---- where a pair opens

    @cached_property
    def touching(self) -> Floats:
        """(P,) distances of the centres at which pairs open: at touch, of bonds beyond it."""
        return np.asarray(self.radii.sum(axis=0) + self.reach)

    @cached_property
    def at_touch(self) -> Floats:
        """(P,) normal force where a closed pair opens: zero without cohesion, else below."""
        return np.zeros(len(self))

    @cached_property
    def strength_at_touch(self) -> Floats:
        """(P,) shear force that pairs can carry where they open."""
        return np.zeros(len(self))

    @cached_property
    def slides(self) -> Flags:
        """(P,) pairs whose strength is finite."""
        return np.isfinite(self.mu)

    @cached_property
    def friction(self) -> Floats:
        """(P,) `mu`, zero where pairs never slide."""
        return np.where(self.slides, self.mu, 0.0)

    # ---- forces, energies and stiffnesses at overlaps (P,), zero where a pair is apart

    def normal_force(self, overlap: Floats) -> Floats:
        """Return `N` of overlaps (..., P)."""
        return self.kn * overlap

    def normal_energy(self, overlap: Floats) -> Floats:
        """Return the energy (P,) of the normal springs."""
        return 0.5 * self.normal_force(overlap) * overlap

    def stiffnesses(self, overlap: Floats) -> tuple[Floats, Floats]:
        """Return `kn` and `kt` (P,)."""
        return self.kn.copy(), self.kt.copy()

    def typical_stiffness(self, overlap: Floats) -> Floats:
        """Return `kn` (P,), of pairs that hardly touch at a small overlap."""
        return self.stiffnesses(np.maximum(overlap, SMALL_OVERLAP * self.touching))[0]

    def shear_strength(self, overlap: Floats, N: Floats) -> Floats:
        """Return the shear force (P,) that pairs can carry, infinite where they never slide."""
        return np.where(self.slides, self.friction * N, np.inf)

    def tangent(self, overlap: Floats, T: Floats, reach: float) -> Tangent:
        """Return the springs of an interval, at overlaps that are negative where a pair is apart.

        Springs that are not linear have their tangents, and those with an overlap below `reach`,
        which may open, `N` over the overlap: so they open where the grains part. Open ones have
        those at it.
        """
        none = np.zeros(len(self))
        return Tangent(self.kn, self.kt, none, self.friction, none)

    # ---- springs against rolling

    @cached_property
    def springs(self) -> int:
        """Shear springs of a pair: two where some pairs have one against rolling."""
        return 2 if self.k_r.any() else 1

    def of_springs(self, shear: Floats, rolling: Floats) -> Floats:
        """Return numbers (P,) of the shear springs, then of those against rolling if any."""
        return np.concatenate([shear, rolling][: self.springs])

    def rolling_part(self, numbers: Floats) -> Floats:
        """Return those (P,) of `of_springs` against rolling; zero without such springs."""
        return np.asarray(numbers.reshape(self.springs, -1)[1:].sum(axis=0))

    @cached_property
    def rolling_reach(self) -> Floats:
        """(P,) largest `|M|/(N - at_touch)` of rolling springs, infinite where there is none."""
        finite = (self.k_r > 0) & np.isfinite(self.mu_r)
        R = effective_radii(self.radii)
        return np.where(finite, np.where(finite, self.mu_r, 0.0) * R, np.inf)

    def rolling_strength(self, N: Floats, closed: Flags) -> Floats:
        """Return the rolling moment (P,) that pairs can carry."""
        finite = np.isfinite(self.rolling_reach)
        N = N - np.where(closed, self.at_touch, 0.0)
        return np.where(finite, np.where(finite, self.rolling_reach, 0.0) * N, np.inf)

    def rolling_energy(self, M: Floats) -> float:
        """Return the energy of rolling springs with these moments."""
        k_r = self.k_r
        return float(np.sum(np.divide(M**2, 2.0 * k_r, out=0.0 * M, where=k_r > 0)))

    # ---- the equations of motion

    def filling(self, compile_own: bool) -> Filling | str:
        """Return the law as the kernel of motion calls it; or why numpy is asked in its place."""
        from loops.compiled import laws as kernels

        return Filling(kernels.Pointer(kernels.linear), np.array([self.kn, self.kt, self.mu]))

    def answer(self, overlap: Floats, before: Floats, T: Floats) -> Floats:
        """Return (4, P) what the law fills in at overlaps that are positive where pairs touch."""
        return np.array([self.kn * overlap, self.kt, self.mu * self.kn * overlap, T])


class HertzPairs(PairLaw):
    """Hertz and Mindlin's spheres: `kn`, `kt` are over the root of the overlap.

    `N = 2/3 kn overlap^(3/2)`.
    """

    linear = False

    @property
    def remembers(self) -> bool:
        """Whether `T` goes with `kt`."""
        return cast(HertzMindlin, self.law).shear_history == "displacement"

    @classmethod
    def grain_springs(cls, law: FrictionalLaw, radii: Floats) -> tuple[Floats, Floats]:
        """Return `E/(1 - nu^2)` times the root of the effective radius, and its share."""
        known = cast(HertzMindlin, law)
        kn = known.young / (1.0 - known.poisson**2) * np.sqrt(effective_radii(radii))
        return kn, known.stiffness_ratio * kn

    def scale(self, radii: Floats) -> Floats:
        """Return the roots of the effective radii."""
        return np.sqrt(effective_radii(radii))

    def picked(self, rows: Flags) -> FrictionalLaw:
        """Return spheres of the moduli of the picked pairs."""
        law = cast(HertzMindlin, self.law)
        kn, kt, mu = (k[rows] for k in (self.kn, self.kt, self.mu))
        modulus = kn / self.scale(self.radii[:, rows])
        return HertzMindlin(modulus, 0.0, mu, law.shear_increment, law.shear_history, kt / kn)

    def normal_force(self, overlap: Floats) -> Floats:
        """Return `2/3 kn overlap^(3/2)`."""
        return HERTZ * self.kn * overlap**1.5

    def normal_energy(self, overlap: Floats) -> Floats:
        """Return `2/5 N overlap`."""
        return 0.4 * self.normal_force(overlap) * overlap

    def stiffnesses(self, overlap: Floats) -> tuple[Floats, Floats]:
        """Return the tangents."""
        root = np.sqrt(overlap)
        return self.kn * root, self.kt * root

    def tangent(self, overlap: Floats, T: Floats, reach: float) -> Tangent:
        """Return tangents, near touch the secant; `T/(2 overlap)` of shear that goes with `kt`."""
        closed = overlap > 0
        kn, kt = self.stiffnesses(np.where(closed, overlap, reach))
        coupling = none = np.zeros(len(self))
        if self.remembers:
            coupling = np.where(closed, T / (2.0 * np.where(closed, overlap, 1.0)), 0.0)
        kn = np.where(overlap > reach, kn, HERTZ * kn)
        return Tangent(kn, kt, coupling, self.friction, none)

    def filling(self, compile_own: bool) -> Filling | str:
        """Return one of Hertz's kernels."""
        from loops.compiled import laws as kernels

        fill = kernels.hertz_by_displacement if self.remembers else kernels.hertz
        return Filling(kernels.Pointer(fill), np.array([HERTZ * self.kn, self.kt, self.mu]))


class FormulaPairs(PairLaw):
    """A law that is asked by its formulae.

    At a wall these are of two grains of twice the radius, as a plane has no curvature, and of the
    parameters of a typical contact; `kn` is a factor of their force, `kt` of their force over the
    overlap, `mu` the friction. Walls don't pull. Between grains `kn` is 1.
    """

    linear = False
    # Any law may ask for the overlap a step before.
    remembers = True

    @property
    def compiled(self) -> bool | None:
        """Whether its author wants it compiled."""
        return self.law.compiled

    @classmethod
    def grain_springs(cls, law: FrictionalLaw, radii: Floats) -> tuple[Floats, Floats]:
        """Return no springs: the law has them."""
        return np.ones(()), np.zeros(())

    @cached_property
    def at_wall(self) -> Flags:
        """(P,) contacts with walls."""
        return np.asarray(self.wall >= 0)

    @cached_property
    def of_formulae(self) -> Floats:
        """(2, P) radii that the formulae see."""
        return np.where(self.at_wall, 2.0 * self.radii[0], self.radii)

    def with_law(self, law: FrictionalLaw) -> Self:
        """Return the same pairs under another law, with the reach that its gap tells."""
        touching = replace(self, law=law, reach=np.zeros(len(self)))
        return replace(touching, reach=np.where(self.at_wall, 0.0, -law.gap(touching.parting())))

    def _with_typical(self, count: int) -> FrictionalLaw:
        """Return the law in which the pair of the median stiffness stands for further ones."""
        _, pressed = self.contacts(np.zeros(len(self)))
        stiff = self.local_stiffness(pressed, Regime.ELASTIC)[:, 0, 0]
        between = np.flatnonzero(~self.at_wall)
        typical = between[np.argsort(stiff[between])[len(between) // 2]]
        law = self.law.take(np.append(np.arange(len(self)), np.full(count, typical)))
        # What touches later was never bonded.
        return law.parted(np.arange(len(self) + count) >= len(self))

    def parted(self, opened: Flags) -> Self:
        """Return the law without the bonds of pairs that have opened."""
        if not opened.any():
            return self
        law = self.law.parted(opened)
        return self if law is self.law else self.with_law(law)

    def taken(self, rows: Integers) -> Self:
        """Return the law of some pairs alone, with the parameters of its formulae there."""
        return replace(super().taken(rows), law=self.law.take(rows))

    def picked(self, rows: Flags) -> FrictionalLaw:
        """Return the law of the picked pairs."""
        return self.law.take(np.flatnonzero(rows))

    def contacts(self, overlap: Floats, T: Floats | float = 0.0) -> tuple[Flags, ContactState]:
        """(P,) which pairs touch, and contacts of overlaps (P,); those apart as at a small one.

        Overlaps are measured from where a closed contact opens. Forces are those of the formulae.
        """
        i, j = self.of_formulae
        length = (i + j) + self.reach - np.where(overlap > 0, overlap, SMALL_OVERLAP * (i + j))
        T = np.broadcast_to(T, len(overlap))
        return overlap > 0, pressed_contacts(self.law, self.of_formulae, length, T)

    def parting(self) -> ContactState:
        """Return the contacts (P,) where they open, with the force of the formulae there.

        A force that is rounding beside that at a small overlap is zero.
        """
        _, pressed = self.contacts(np.zeros(len(self)))
        state = replace(pressed, length=pressed.touching_length + self.reach)
        N = np.asarray(self.law.closed_force(state), dtype=float)
        least = AT_TOUCH * np.abs(pressed.normal_force)
        return replace(state, normal_force=np.where(np.abs(N) > least, N, 0.0))

    def local_stiffness(self, state: ContactState, regime: Regime) -> Floats:
        """(P, 2, 2) `D` of the formulae."""
        return self.law.local_stiffness(state, np.full(len(state.length), regime, dtype=np.int8))

    @cached_property
    def pull(self) -> Floats:
        """(P,) normal force of the formulae where a wall opens, which it does not have."""
        return np.where(self.at_wall, self.parting().normal_force, 0.0)

    @cached_property
    def at_touch(self) -> Floats:
        """(P,) normal force where a closed pair opens."""
        return self.parting().normal_force - self.pull

    @cached_property
    def strength_at_touch(self) -> Floats:
        """(P,) shear force that pairs can carry where they open; rounding is none."""
        slides = self.slides & ~self.at_wall
        at_touch = np.where(slides, self.law.strength(self.parting()), 0.0)
        return np.where(at_touch > AT_TOUCH * self.friction * np.abs(self.at_touch), at_touch, 0.0)

    def normal_force(self, overlap: Floats) -> Floats:
        """Return the force of the law."""
        if overlap.ndim > 1:
            return np.array([self.normal_force(one) for one in overlap])
        touch, state = self.contacts(overlap)
        return np.where(touch, self.kn * (state.normal_force - self.pull), 0.0)

    def normal_energy(self, overlap: Floats) -> Floats:
        """Return the energy of the law; of pairs apart that at their opening."""
        touch, state = self.contacts(overlap)
        energy = self.law.normal_energy(state) - self.pull * overlap
        return self.kn * np.where(touch, energy, self.law.normal_energy(self.parting()))

    def stiffnesses(self, overlap: Floats) -> tuple[Floats, Floats]:
        """Return tangents, zero where pairs don't touch."""
        kn, kt, _ = self._elastic(overlap, np.zeros(len(self)))
        return kn, kt

    def _elastic(self, overlap: Floats, T: Floats) -> tuple[Floats, Floats, Floats]:
        """(P,) `kn`, `kt` and `-dT/dun` of stuck pairs, zero where they don't touch."""
        touch, state = self.contacts(overlap, T)
        D = np.where(touch[:, None, None], self.local_stiffness(state, Regime.ELASTIC), 0.0)
        secant = np.where(touch, (state.normal_force - self.pull) / state.overlap, 0.0)
        kt = np.where(self.at_wall, self.kt * secant, D[:, 1, 1])
        return self.kn * D[:, 0, 0], kt, D[:, 1, 0]

    def shear_strength(self, overlap: Floats, N: Floats) -> Floats:
        """Return the strength of the law, at walls `mu N`."""
        touch, state = self.contacts(overlap)
        own = touch & self.slides & ~self.at_wall
        return np.where(own, self.law.strength(state), super().shear_strength(overlap, N))

    def tangent(self, overlap: Floats, T: Floats, reach: float) -> Tangent:
        """Return tangents; near touch secants of the force and of the strength to those there."""
        at, far = np.where(overlap > 0, overlap, reach), overlap > reach
        touch, state = self.contacts(at, 1.0)
        kn, kt, coupling = self._elastic(at, T)
        N0, most0 = self.at_touch, self.strength_at_touch
        N = np.where(touch, self.normal_force(at), N0)
        slides = self.slides & ~self.at_wall
        most = np.where(slides & touch, self.law.strength(state), 0.0)
        rise, D = N - N0, self.local_stiffness(state, Regime.SLIDING)
        slope = np.divide(most - most0, rise, out=0.0 * N, where=slides & (rise > 0))
        steep = D[:, 1, 0] / np.where(D[:, 0, 0] > 0, D[:, 0, 0], 1.0)
        slope = np.where(far & slides, steep, slope)
        cohesion = np.where(far, most - slope * N, most0 - slope * N0)
        kn = np.where(far, kn, rise / np.where(touch, at, 1.0))
        mu = np.where(self.at_wall, self.friction, slope)
        return Tangent(kn, kt, coupling, mu, np.where(self.at_wall, 0.0, cohesion))

    def filling(self, compile_own: bool) -> Filling | str:
        """Return the law compiled from its methods, where that is wanted and numba can."""
        if not compile_own:
            return "numpy"
        walls = np.where(self.at_wall, [self.kn, self.pull, self.kt, self.mu], 0.0)
        return compiled(self.law, self.of_formulae, walls)

    def answer(self, overlap: Floats, before: Floats, T: Floats) -> Floats:
        """Return (4, P) what the law fills in, from numpy."""
        out = answer_of(self.law, self.of_formulae, overlap, before, T)
        pushed = out[0] - self.pull
        with np.errstate(invalid="ignore"):
            walls = self.kn * pushed, self.kt * pushed / overlap, self.mu * self.kn * pushed
        out[:3] = np.where(self.at_wall, walls, out[:3])
        return out


class CohesivePairs(FormulaPairs):
    """Linear springs that pull, with a kernel of motion of their own."""

    def filling(self, compile_own: bool) -> Filling | str:
        """Return the kernel of cohesion."""
        from loops.compiled import laws as kernels

        law, walls = cast(CohesiveFrictional, self.law), self.at_wall
        kt = np.where(walls, self.kt * law.kn, law.kt)
        pulls = (np.where(walls, 0.0, force) for force in (law.attraction, law.cohesion))
        constants = np.array([self.kn * law.kn, kt, self.mu, *pulls])
        return Filling(kernels.Pointer(kernels.cohesive), constants)


# What is known of some laws better than by their formulae; derived classes may have others.
KINDS: dict[type, type[PairLaw]] = {
    LinearFrictional: PairLaw,
    HertzMindlin: HertzPairs,
    CohesiveFrictional: CohesivePairs,
}


def law_of_pairs(law: MovableLaw, radii: Floats, wall: Integers, walls: AtWalls = None) -> PairLaw:
    """Return a law between pairs of radii (2, P), those with walls last and of their springs.

    `wall` is the number of the wall, -1 between grains, whose parameters the law has.
    """
    if not isinstance(law, RollingResistance):
        return KINDS.get(type(law), FormulaPairs).made(law, radii, wall, walls)
    free = law_of_pairs(cast(FrictionalLaw, law.law), radii, wall, walls)
    # Walls have no springs for rolling.
    k_r, mu_r = np.zeros((2, len(wall)))
    k_r[wall < 0], mu_r[wall < 0] = law.k_r, law.mu_r
    return replace(free, k_r=k_r, mu_r=mu_r) if k_r.any() else free


def law_of(law: ContactLaw, pairs: PairLaw, rows: Flags) -> MovableLaw:
    """Return the law of the picked pairs between grains, of the same kind as the one given."""
    if isinstance(law, RollingResistance):
        return RollingResistance(pairs.picked(rows), pairs.k_r[rows], pairs.mu_r[rows])
    return pairs.picked(rows)


def effective_radii(radii: Floats) -> Floats:
    """Return `r_i r_j/(r_i + r_j)` (P,) of radii (2, P); of the grain alone at a wall."""
    i, j = radii
    return np.asarray(np.where(j > 0, effective_radius(i, j), i))


def as_known(values: Floats, radii: Floats, others: Floats) -> Floats:
    """Return the mean of the values, or of values over radii where that varies less."""
    mean = float(values.mean())
    if not np.isfinite(mean):
        return np.full(len(others), mean)
    per_radius = values / radii
    if np.std(per_radius) * mean < np.std(values) * per_radius.mean():
        return np.asarray(per_radius.mean() * others)
    return np.full(len(others), mean)
