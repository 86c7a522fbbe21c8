"""Formulae of contact laws for the pairs of a packing at their overlaps.

A pair is two grains, or a grain and a wall, which is a plane under the same law, of a stiffness of
its own; a spring against rolling stands beside any law. From the formulae follow the springs of an
interval (`tangent`), forces, energies, strengths, and the law as the kernel of motion calls it
(`filling`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self, cast

import numpy as np

from loops.arrays import Flags, Floats, Integers, median
from loops.errors import InputError
from loops.graph import ContactState
from loops.laws.compiled import Filling, answer_of, compiled, pressed_contacts
from loops.laws.frictional import FrictionalLaw, Regime
from loops.laws.kinds import (
    HERTZ,
    HERTZ_BAND,
    CohesiveFrictional,
    HertzMindlin,
    LinearFrictional,
    RollingResistance,
    effective_radius,
    linear_springs,
)

# Which pairs touch, and all of them as their law sees them.
Pressed = tuple[Flags, ContactState]
# Smallest overlap, over the distance of the centres, that stiffnesses are estimated at.
SMALL_OVERLAP = 1e-4
# Stiffness over the one given, at most and at least, that the force of a wall may tell: beyond, its
# overlap is rounding.
AS_GIVEN = 3.0
# Forces at touch below this share of those at overlap are rounding: the law has no cohesion.
AT_TOUCH = 1e-9
# Share of the contacts that tell whose forces they are.
MOSTLY = 0.9
# Methods that a law of one's own may not change.
LEFT = ("shear_kinematics", "rolling_stiffness", "regime")


@dataclass(frozen=True, eq=False)
class PairLaw:
    """A law between pairs (P,), asked by its formulae.

    `law` holds between grains; `radii` (2, P), zero at walls; `wall` the number of the wall, -1
    between grains. At a wall the formulae are of two grains of twice the radius, as a plane has no
    curvature, and of the parameters of a typical contact: there `kn` is a factor of their force,
    `kt` of their force over the overlap, and walls don't pull; between grains `kn` is 1. `mu` is
    the friction, `reach` the gap at which a closed pair opens, zero but for bonds; `k_r`, `mu_r`
    stiffness against rolling, zero at walls and where there is no such spring, and `|M|/(R N)` at
    its limit.
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

    def __len__(self) -> int:
        return len(self.wall)

    @property
    def linear(self) -> bool:
        """Whether springs are constant, so that an increment knows their energy."""
        return linear_springs(self.law)

    @property
    def remembers(self) -> bool:
        """Whether the law asks for the overlap a step before, as any law may that is not known."""
        known = type(self.law) in KERNELS
        return not known or self.law.shear_history == "displacement"

    @property
    def compiled(self) -> bool | None:
        """Whether the equations of motion have to compile the law; None where they may choose."""
        return self.law.compiled

    @property
    def by_radii(self) -> bool:
        """Whether a turn of the branch shears by the radii, see `FrictionalLaw`."""
        return self.law.shear_increment == "radii"

    @cached_property
    def at_wall(self) -> Flags:
        """(P,) contacts with walls."""
        return np.asarray(self.wall >= 0)

    # ---- how it is made

    @classmethod
    def made(
        cls, given: FrictionalLaw, radii: Floats, wall: Integers, at_walls: Floats | None = None
    ) -> Self:
        """Return the law of pairs of radii (2, P), those with walls last, see `with_walls`.

        `wall` is the number of the wall, -1 between grains, whose parameters the law has.
        """
        springs = given if isinstance(given, RollingResistance) else RollingResistance(given, 0.0)
        law = springs.law
        count = int(np.count_nonzero(wall < 0))
        numbers = (np.full(count, k) for k in (1.0, 0.0, law.mu, 0.0, springs.k_r, springs.mu_r))
        pairs = cls(law, radii[:, :count], wall[:count], *numbers).with_law(law)
        if at_walls is None:
            return pairs
        return pairs.with_walls(radii[:, count:], wall[count:], at_walls)

    def with_law(self, law: FrictionalLaw) -> Self:
        """Return the same pairs under another law, with the reach that its gap tells."""
        touching = replace(self, law=law, reach=np.zeros(len(self)))
        return replace(touching, reach=np.where(self.at_wall, 0.0, -law.gap(touching.parting)))

    def with_walls(self, radii: Floats, wall: Integers, springs: Floats) -> Self:
        """Return the law with contacts at walls, of the forces and of the `kt/kn` given.

        `springs` (5, W) are their tangent stiffnesses, friction, overlaps and normal forces.
        """
        ones, (kn_given, kt_given, mu, overlap, force) = np.ones(len(wall)), springs
        unit = self._with_rows(radii, wall, ones, ones, mu, 0.0 * ones, np.inf * ones)
        small, count = SMALL_OVERLAP * radii[0], len(self)
        at = np.append(np.zeros(count), np.where(overlap > 0, overlap, small))
        by_force = force / unit.normal_force(at)[count:]
        given = kn_given / unit.stiffnesses(at)[0][count:]
        known = (overlap > 0) & (by_force < AS_GIVEN * given) & (given < AS_GIVEN * by_force)
        at[count:] = np.where(known, overlap, np.maximum(overlap, small))
        kn, kt = (k[count:] for k in unit.stiffnesses(at))
        share = np.where(known, by_force, kn_given / kn)
        shear = share * kn / kt * kt_given / kn_given
        return replace(unit, kn=np.append(self.kn, share), kt=np.append(self.kt, shear))

    def grown(self, radii: Floats, wall: Integers) -> Self:
        """Return the law with further pairs of radii (2, Q), whose constants are medians.

        A wall is as stiff to other grains as to those that are known, over their radius if that
        varies less.
        """
        between, numbers = ~self.at_wall, []
        for k in (self.kn, self.kt, self.mu):
            added = np.full(len(wall), median(k[between]))
            for number in np.unique(wall[wall >= 0]):
                of, own = self.wall == number, wall == number
                added[own] = as_known(k[of], self.radii[0, of], radii[0, own])
            numbers.append(added)
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
        """Return the law in which further pairs have the medians of the parameters.

        Parameters that are not real numbers are those of the first pair.
        """
        between, known = np.flatnonzero(~self.at_wall), np.arange(len(self))
        law = self.law.take(np.append(known, np.full(count, between[0])))
        for name, value in vars(law).items():
            if isinstance(value, np.ndarray) and value.shape == (len(known) + count,):
                if value.dtype.kind == "f":
                    values = np.append(value[known], np.full(count, median(value[between])))
                    vars(law)[name] = values
        # What touches later was never bonded.
        return law.parted(np.arange(len(known) + count) >= len(known))

    def parted(self, opened: Flags) -> Self:
        """Return the law without the bonds of pairs (P,) that have opened."""
        if not opened.any():
            return self
        law = self.law.parted(opened)
        return self if law is self.law else self.with_law(law)

    def taken(self, rows: Integers) -> Self:
        """Return the law of some pairs alone, `rows` in ascending order."""
        names = ("radii", "wall", "kn", "kt", "mu", "reach", "k_r", "mu_r")
        kept = {name: getattr(self, name)[..., rows] for name in names}
        return replace(self, law=self.law.take(rows), **kept)

    # ---- the pairs as the formulae see them

    @cached_property
    def of_formulae(self) -> Floats:
        """(2, P) radii that the formulae see."""
        return np.where(self.at_wall, 2.0 * self.radii[0], self.radii)

    def contacts(self, overlap: Floats, T: Floats | float = 0.0) -> Pressed:
        """(P,) which pairs touch, and contacts of overlaps (P,); those apart as at a small one.

        Overlaps are measured from where a closed contact opens. Forces are those of the formulae.
        """
        small = SMALL_OVERLAP * self.of_formulae.sum(axis=0)
        depth, T = np.where(overlap > 0, overlap, small), np.broadcast_to(T, len(overlap))
        state = pressed_contacts(self.law, self.of_formulae, depth - self.reach, T)
        return overlap > 0, state

    @cached_property
    def parting(self) -> ContactState:
        """Contacts (P,) where they open, with the force of the formulae there.

        A force that is rounding beside that at a small overlap is zero.
        """
        _, pressed = self.contacts(np.zeros(len(self)))
        state = pressed_contacts(self.law, self.of_formulae, -self.reach, np.zeros(len(self)))
        rounding = AT_TOUCH * np.abs(pressed.normal_force)
        N = np.where(np.abs(state.normal_force) > rounding, state.normal_force, 0.0)
        return replace(state, normal_force=N)

    def local_stiffness(self, state: ContactState, regime: Regime) -> Floats:
        """(P, 2, 2) `D` of the formulae."""
        return self.law.local_stiffness(state, np.full(len(state.length), regime, dtype=np.int8))

    # ---- where a pair opens

    @cached_property
    def touching(self) -> Floats:
        """(P,) distances of the centres at which pairs open: at touch, of bonds beyond it."""
        return np.asarray(self.radii.sum(axis=0) + self.reach)

    @cached_property
    def pull(self) -> Floats:
        """(P,) normal force of the formulae where a wall opens, which it does not have."""
        return np.where(self.at_wall, self.parting.normal_force, 0.0)

    @cached_property
    def at_touch(self) -> Floats:
        """(P,) normal force where a closed pair opens: zero without cohesion, else below."""
        return self.parting.normal_force - self.pull

    @cached_property
    def energy_at_touch(self) -> Floats:
        """(P,) energy where pairs open, over that of the factor at walls."""
        return np.asarray(self.law.normal_energy(self.parting))

    @cached_property
    def strength_at_touch(self) -> Floats:
        """(P,) shear force that pairs can carry where they open; rounding is none."""
        slides = self.slides & ~self.at_wall
        at_touch = np.where(slides, self.law.strength(self.parting), 0.0)
        return np.where(at_touch > AT_TOUCH * self.friction * np.abs(self.at_touch), at_touch, 0.0)

    @cached_property
    def slides(self) -> Flags:
        """(P,) pairs whose strength is finite."""
        return np.isfinite(self.mu)

    @cached_property
    def friction(self) -> Floats:
        """(P,) `mu`, zero where pairs never slide."""
        return np.where(self.slides, self.mu, 0.0)

    # ---- forces, energies and stiffnesses at overlaps (P,), zero where a pair is apart

    def normal_force(self, overlap: Floats, known: Pressed | None = None) -> Floats:
        """Return the force of the law; `known` is `contacts(overlap)`."""
        if overlap.ndim > 1:
            return np.array([self.normal_force(one) for one in overlap])
        touch, state = known or self.contacts(overlap)
        return np.where(touch, self.kn * (state.normal_force - self.pull), 0.0)

    def normal_energy(self, overlap: Floats, known: Pressed | None = None) -> Floats:
        """Return the energy of the law; of pairs apart that at their opening."""
        touch, state = known or self.contacts(overlap)
        energy = self.law.normal_energy(state) - self.pull * overlap
        return self.kn * np.where(touch, energy, self.energy_at_touch)

    def stiffnesses(self, overlap: Floats) -> tuple[Floats, Floats]:
        """Return tangents; zero where pairs don't touch, of springs that are not constant."""
        return self._elastic(overlap, np.zeros(len(self)))[:2]

    def typical_stiffness(self, overlap: Floats) -> Floats:
        """Return `kn` (P,), of pairs that hardly touch at a small overlap."""
        return self.stiffnesses(np.maximum(overlap, SMALL_OVERLAP * self.touching))[0]

    def _elastic(self, overlap: Floats, T: Floats) -> tuple[Floats, Floats, Floats]:
        """(P,) `kn`, `kt` and `-dT/dun` of stuck pairs, see `stiffnesses`."""
        touch, state = self.contacts(overlap, T)
        touch = touch | self.linear
        D = np.where(touch[:, None, None], self.local_stiffness(state, Regime.ELASTIC), 0.0)
        secant = np.where(touch, (state.normal_force - self.pull) / state.overlap, 0.0)
        kt = np.where(self.at_wall, self.kt * secant, D[:, 1, 1])
        return self.kn * D[:, 0, 0], kt, D[:, 1, 0]

    def shear_strength(self, overlap: Floats, N: Floats, known: Pressed | None = None) -> Floats:
        """Return the strength (P,) under these `N`, at walls `mu N`, infinite where none slides."""
        touch, state = known or self.contacts(overlap)
        own = self.law.strength(replace(state, normal_force=N))
        most = np.where(touch & ~self.at_wall, own, self.friction * N)
        return np.where(self.slides, most, np.inf)

    def tangent(self, overlap: Floats, T: Floats, reach: float) -> dict[str, Floats]:
        """Return springs (P,) over an interval: `N' = -kn un'`, `T' = -kt ut' - coupling un'`.

        The strength is `mu N + cohesion`, where it is finite. They are tangents; near touch secants
        of the force and of the strength to those there.
        """
        at, far = np.where(overlap > 0, overlap, reach), (overlap > reach) | self.linear
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
        cohesion = np.where(np.abs(cohesion) > AT_TOUCH * most, cohesion, 0.0)
        kn = np.where(far, kn, rise / np.where(touch, at, 1.0))
        mu = np.where(self.at_wall, self.friction, slope)
        cohesion = np.where(self.at_wall, 0.0, cohesion)
        return {"kn": kn, "kt": kt, "coupling": coupling, "mu": mu, "cohesion": cohesion}

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
        """Return the law as the kernel of motion calls it; or why numpy is asked in its place.

        A law that is not known is compiled from its methods, where that is wanted and numba can.
        """
        if type(self.law) in KERNELS:
            from loops.compiled import laws as kernels

            fill, constants = KERNELS[type(self.law)](self)
            return Filling(kernels.Pointer(getattr(kernels, fill)), np.array(constants))
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


def _springs(pairs: PairLaw) -> tuple[str, list[Floats]]:
    """Linear springs, which may pull between grains."""
    law, walls = cast(CohesiveFrictional, pairs.law), pairs.at_wall
    kt = np.where(walls, pairs.kt * law.kn, law.kt)
    pulls = (np.where(walls, 0.0, force) for force in (law.attraction, law.cohesion))
    return "springs", [pairs.kn * law.kn, kt, pairs.mu, *pulls]


def _spheres(pairs: PairLaw) -> tuple[str, list[Floats]]:
    """Spheres, over the root of the overlap."""
    law = cast(HertzMindlin, pairs.law)
    modulus = law.young / (1.0 - law.poisson**2)
    kn = modulus * np.sqrt(effective_radius(*pairs.of_formulae))
    kt = np.where(pairs.at_wall, HERTZ * pairs.kt, law.stiffness_ratio) * kn
    fill = "hertz_by_displacement" if pairs.remembers else "hertz"
    return fill, [HERTZ * pairs.kn * kn, kt, pairs.mu]


# Laws with a kernel of motion, by its name and constants; derived classes may have other formulae.
KERNELS: dict[type, Callable[[PairLaw], tuple[str, list[Floats]]]] = {
    LinearFrictional: _springs,
    CohesiveFrictional: _springs,
    HertzMindlin: _spheres,
}


def law_of(law: object, pairs: PairLaw, rows: Flags) -> FrictionalLaw:
    """Return the law of the picked pairs between grains, of the same kind as the one given."""
    picked = pairs.law.take(np.flatnonzero(rows))
    if isinstance(law, RollingResistance):
        return RollingResistance(picked, pairs.k_r[rows], pairs.mu_r[rows])
    return picked


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


# ---- which laws are taken, and why others are refused


def require_movable(law: object, state: ContactState) -> FrictionalLaw:
    """The law of paths, motions and materials; refuse others, and packings without contacts.

    The normal force is one of the overlap; where the grains part it vanishes, or pulls.
    """
    if not len(state.length):
        raise InputError("packing", "no contacts", "a packing that carries", "Compress it first.")
    sheared = law.law if isinstance(law, RollingResistance) else law
    if isinstance(sheared, RollingResistance) or not isinstance(sheared, FrictionalLaw):
        expected = "a law derived from gl.FrictionalLaw, and at most one spring for rolling"
        remedy = "Give another, or compute tangents alone."
        raise InputError("law", type(sheared).__name__, expected, remedy)
    require_linear_forces(sheared, state)
    if not linear_springs(sheared) and type(sheared) is not HertzMindlin:
        _require_formulae(sheared, state)
    return law if isinstance(law, RollingResistance) else sheared


def require_linear_forces(law: object, state: ContactState) -> None:
    """Raise `InputError` where linear springs have the tangents of Hertz's law; others pass."""
    if not linear_springs(law):
        return
    closed = (state.normal_force != 0) & (state.overlap > 0)
    hertz = HERTZ * (law.kn * state.overlap)[closed]
    as_hertz = np.abs(state.normal_force[closed] - hertz) < HERTZ_BAND * hertz
    if np.count_nonzero(as_hertz) > MOSTLY * len(as_hertz):
        received = "normal forces of 2/3 of kn times the overlap, as Hertz's tangents give them"
        expected = "linear springs, of which N is kn times the overlap"
        remedy = "Give law='hertz' (--law hertz), or study rates."
        raise InputError("law", received, expected, remedy)


def require_unlimited_rolling(law: object) -> None:
    """Raise `InputError` for springs against rolling that yield, which paths of loops lack."""
    if isinstance(law, RollingResistance) and np.isfinite(law.mu_r).any():
        expected = "springs for rolling without a limit, mu_r=inf, in paths of loops"
        raise InputError("law", "a finite mu_r", expected, "Follow the packing, or leave it out.")


def require_linear_springs(law: object, where: str, remedy: str) -> LinearFrictional:
    """Return linear springs with friction; raise `InputError` for another law."""
    if not linear_springs(law):
        raise InputError(where, type(law).__name__, "linear springs", remedy)
    return law


def _require_formulae(law: FrictionalLaw, state: ContactState) -> None:
    """Raise `InputError` unless a law gives what pairs ask of it."""
    name, kind, loops_alone = type(law).__name__, type(law), "Use the law for single loops."

    def refuse(received: str, expected: str, remedy: str = loops_alone) -> InputError:
        return InputError("law", received, expected, remedy)

    changed = [m for m in LEFT if getattr(kind, m) is not getattr(FrictionalLaw, m)]
    changed += [] if law.keeps_strength else ["keeps_strength"]
    if changed:
        expected = "a law that leaves these to gl.FrictionalLaw"
        remedy = "Leave them out, or use the law for single loops."
        raise refuse(f"{name} with {', '.join(changed)}", expected, remedy)
    radii = np.array([state.radii_i, state.radii_j])
    try:
        own = PairLaw.made(law, radii, np.full(radii.shape[1], -1))
        _, pressed = own.contacts(state.overlap)
        D = own.local_stiffness(pressed, Regime.ELASTIC)
    except NotImplementedError as lacks:
        remedy = "Add it to the class."
        expected = "closed_force, and kt or stiffnesses"
        raise refuse(f"{name} without {lacks}", expected, remedy) from None
    parting = own.parting
    rise = law.gap(pressed) - law.gap(parting)
    if np.any(own.reach < 0) or not np.allclose(rise, pressed.length - parting.length):
        expected = "a gap of the branch less its length where the contact opens, at touch or beyond"
        raise refuse(f"{name} with gap", expected)
    if np.any(parting.normal_force > 0) or np.any(D[:, 0, 1] != 0):
        raise refuse(name, "a normal force of the overlap alone that vanishes or pulls at touch")
    least = np.where(np.isfinite(law.mu), law.strength(parting), 0.0)
    if np.any(least < -AT_TOUCH * np.abs(parting.normal_force)):
        expected = "a strength that is not negative where the contact pulls"
        remedy = "Give the class a strength such as mu (N + adhesion)."
        raise refuse(f"{name} with a strength of {least.min():.2g}", expected, remedy)
