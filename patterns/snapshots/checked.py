"""A snapshot as its checks look at it: contacts, forces against overlaps, resultants on grains."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from loops import FrictionalLaw, GrainGraph, HertzMindlin, Regime, contact_state
from loops.arrays import Flags, Floats, Integers, median, quantiles
from patterns.snapshots.findings import few, rounding
from patterns.snapshots.geometry import sums_on_grains

# Weaker contacts, in mean normal forces, hold mostly rounding and damping.
LOADED = 0.1
# Fewer contacts or grains than these are not judged together.
FEWEST = 20
# Multiple of the rounding of coordinates that directions and radii may be off by.
ROUNDINGS = 5.0
# The same of all overlaps together.
OVERLAP_ROUNDINGS = 2.0
# Least spread of the logarithm of overlaps that tells an exponent.
LEAST_SPREAD = 0.1
# How far the exponent of kn over R times the overlap may be from a half: two materials of 1:4 leave
# 0.07 among 44 contacts. Springs have an exponent of 0, Yade's that go with the radii 0.05 at most.
ROOT_BAND = 0.2
# A force this many times the median stands out: of a million at rest the largest is 20 times it.
STANDS_OUT = 20.0
FEW_FORCES = 100_000  # of which that median is taken
# Such a force is a fault if it leaves this share of itself on a grain: clean none.
UNBALANCED = 0.3
# Share of the contacts that may be wrong, one by one or by their grain: the others tell the noise.
FEW_WRONG = 0.1
# Standard errors of a median, of numbers that scatter by a quartile range, that are allowed.
ERRORS = 3.0


class OverlapFit(NamedTuple):
    """Forces of the contacts against their overlaps.

    `ratio` is N over the force that the overlap gives with the file's kn (median), `error` what
    rounding and scatter leave open of it, `power` that of the overlap which goes with N, so that
    `N = kn overlap/power`. `needed` (C,) are the overlaps that the forces over the ratio need,
    `off` (C,) these less those of the centres, of a typical contact `typical`; `noise` is the share
    of the larger of the two overlaps, and of the typical one, that most contacts are off by.
    """

    rows: Integers
    ratio: float
    error: float
    power: float
    needed: Floats
    off: Floats
    size: Floats
    typical: float
    noise: tuple[float, float]

    def allowed(self, times: float, least: float, rounded: float) -> Floats:
        """(C,) largest `off` by so many times the noise, and at least a share of the overlap."""
        own, common = (max(least, times * noise) for noise in self.noise)
        return np.maximum(own * self.size, common * self.typical) + rounded


@dataclass(eq=False)
class Checked:
    """Contacts between grains with their branches, law and regimes, as the checks need them.

    `given` (C, 2) are the branches or normals of the file, `walls` the grains that walls touch and
    the forces on them (W, 2), `ids` (G,) those of the grains, `rows` those of the contacts in the
    file. Forces may be known without a law.
    """

    graph: GrainGraph
    d: Floats
    length: Floats
    law: FrictionalLaw | None
    regime: NDArray[np.int8] | None
    given: Floats | None
    walls: tuple[Integers, Floats] | None
    ids: Integers
    forces_known: bool = False
    periodic: tuple[bool, bool] = (True, True)
    rows: Integers | None = None

    def __post_init__(self) -> None:
        graph = self.graph
        self.x, self.radii, self.contacts = graph.x, graph.radii, graph.contacts
        self.normal, self.shear = graph.normal_force, graph.shear_force
        self.sliding = None if self.regime is None else self.regime == Regime.SLIDING
        self.degree = np.bincount(self.contacts.ravel(), minlength=len(self.x))
        self.inner = self.degree > 0
        if (graph.cell is None or not all(self.periodic)) and self.walls is None:
            # Walls whose forces are not known may push on the rim.
            free = [k for k in (0, 1) if graph.cell is None or not self.periodic[k]]
            self.inner &= ~on_rim(self.x[:, free], self.radii, self.inner)
        self.reach = self.radii[self.contacts[:, 0]] + self.radii[self.contacts[:, 1]]
        self.overlap = self.reach - self.length
        self.touched = self.degree > 0
        self.odd = self._unbalanced()
        self.inner[self.contacts[self.odd].ravel()] = False
        limit = LOADED * float(self.judged[0].sum()) / (len(self.normal) - len(self.odd))
        self.loaded = self.judged[0] > limit if limit > 0 else np.ones(len(self.normal), dtype=bool)

    def _unbalanced(self) -> Integers:
        """Contacts whose force stands out, and which a grain of theirs does not balance."""
        size = np.maximum(np.abs(self.normal), np.abs(self.shear))
        limit = STANDS_OUT * median(size[:: max(1, len(size) // FEW_FORCES)])
        rows = np.flatnonzero(size > limit) if limit > 0 else np.zeros(0, dtype=np.int64)
        if not len(rows):
            return rows
        rest = np.hypot(*np.add(*self.residuals).T)
        # Found anew without these grains.
        del self.__dict__["residuals"], self.__dict__["resultants"]
        return rows[rest[self.contacts[rows]].max(axis=1) > UNBALANCED * size[rows]]

    @cached_property
    def judged(self) -> tuple[Floats, Floats]:
        """`normal` and `shear`, zero where a force stands out that nothing balances."""
        if not len(self.odd):
            return self.normal, self.shear
        normal, shear = self.normal.copy(), self.shear.copy()
        normal[self.odd] = shear[self.odd] = 0.0
        return normal, shear

    @cached_property
    def mean_force(self) -> float:
        """Mean size of the contact forces, but for those that nothing balances."""
        return float(np.hypot(*self.judged).sum()) / (len(self.normal) - len(self.odd))

    @property
    def mu(self) -> Floats:
        """(C,) array: friction of the contacts."""
        assert self.law is not None
        return np.broadcast_to(self.law.mu, len(self.contacts))

    @property
    def strength(self) -> Floats:
        """(C,) array: shear force at which contacts slide, `mu N` and the cohesion."""
        assert self.law is not None
        return self.mu * self.normal + np.asarray(self.law.cohesion, dtype=float)

    @cached_property
    def pressed(self) -> Floats:
        """(C,) array: force of the springs, `N` and the adhesion of contacts that attract."""
        if self.law is None:
            return self.normal
        return self.normal + np.asarray(self.law.attraction, dtype=float)

    @property
    def cohesive(self) -> bool:
        """Whether contacts may pull under the law."""
        return self.law is not None and self.law.cohesive

    @property
    def power(self) -> float:
        """Power of the overlap that N goes with under the law, 1 where none is known."""
        return (None if self.law is None else self.law.overlap_power) or 1.0

    @cached_property
    def stiffnesses(self) -> tuple[Floats, Floats]:
        """`kn` and `kt`, (C,) each; under Hertz's law of the tangents of `N`."""
        assert self.law is not None
        kn, kt = self.law.constant_springs or self.law.stiffnesses(contact_state(self.graph))
        return np.broadcast_to(kn, len(self.contacts)), np.broadcast_to(kt, len(self.contacts))

    @cached_property
    def overlapping(self) -> Integers:
        """Loaded contacts whose overlap tells a stiffness, none if the centres are too coarse."""
        coarse = OVERLAP_ROUNDINGS * rounding(self.x)
        if not self.loaded.any() or median(self.overlap[self.loaded]) <= coarse:
            return np.zeros(0, dtype=np.int64)
        return np.flatnonzero(self.loaded & (self.overlap > 0))

    def names(self, contacts: Integers) -> str:
        """Grains of the first three of some contacts."""
        return few(self.ids[self.contacts[contacts]], lambda pair: f"{pair[0]} and {pair[1]}")

    @cached_property
    def rounded(self) -> float:
        """Largest error of an overlap by the digits that centres and radii show.

        Radii may be round numbers: they are as good as the centres at least.
        """
        centres = rounding(self.x)
        return float(2.0 * (np.sqrt(2.0) * centres + min(centres, rounding(self.radii))))

    @cached_property
    def fit(self) -> OverlapFit | None:
        """Forces against overlaps; None where neither law nor overlaps tell."""
        if self.law is None or not (self.stiffnesses[0] > 0).any():
            return None
        kn, overlap = self.stiffnesses[0], self.overlap
        rows = self.overlapping
        rows = rows[(kn[rows] > 0) & (self.pressed[rows] > 0)]
        if len(rows) == 0:
            return None
        secant = self.pressed[rows] / self.overlap[rows]
        # Secants of Hertz's law go with the root as well.
        of_hertz = HertzMindlin.overlap_power
        low = median(secant / kn[rows]) < of_hertz**-0.5
        of_N = of_hertz if low and self.goes_with_root(kn[rows], rows) else self.power
        unit = kn * (1.0 / of_N)
        needed = np.where(unit > 0, self.pressed, 0.0) / np.where(unit > 0, unit, 1.0)
        by_force = needed[rows] / overlap[rows]
        scale = median(by_force)
        # Tangents of a given modulus grow with N themselves.
        power = self.power if self.law.of_moduli else 1.0
        typical = median(overlap[rows])
        quarter, rest = quantiles(by_force, [0.25, 0.75])
        needed = needed / scale
        off, size = needed - overlap, np.maximum(needed, overlap)
        pushed = (self.pressed > 0) & (size > 0)
        apart = np.abs(off[pushed])
        noise = [quantiles(apart / of, [1 - FEW_WRONG])[0] for of in (size[pushed], typical)]
        # The median of ratios is off by their scatter, and where overlaps are in the denominator.
        error = power * (ERRORS * (rest - quarter) / np.sqrt(len(rows)) + noise[1] ** 2)
        return OverlapFit(
            *(rows, scale**power, error, of_N, needed, off, size, typical),
            (noise[0], noise[1]),
        )

    def goes_with_root(self, stiffness: Floats, rows: Integers) -> bool:
        """Whether stiffnesses of some contacts go with the root of their overlaps."""
        if not np.ptp(stiffness):
            return False
        return goes_with_root(stiffness, self.radii[self.contacts[rows]], self.overlap[rows])

    def parts(self, rows: Integers | slice = slice(None)) -> tuple[Floats, Floats]:
        """Normal and shear force on grain 2 of some contacts, (C, 2) each."""
        n = self.d[rows] / self.length[rows, None]
        t = np.column_stack([-n[:, 1], n[:, 0]])
        return self.normal[rows, None] * n, self.shear[rows, None] * t

    @cached_property
    def resultants(self) -> tuple[Floats, Floats]:
        """Forces that the normal forces with the walls', and the shear forces, leave on the grains.

        (G, 2) each, less a uniform body force that inner grains tell.
        """
        area = np.where(self.inner, self.radii**2, 0.0)
        touched = np.where(self.touched, self.radii**2, 0.0)
        found: list[Floats] = []
        for part in self.parts():
            rest = sums_on_grains(self.contacts, part.T, len(self.x))
            if not found and self.walls is not None:
                np.add.at(rest, *self.walls)
            rest -= touched[:, None] * ((area @ rest) / (area @ area or 1.0))
            found.append(rest)
        return found[0], found[1]

    @cached_property
    def residuals(self) -> tuple[Floats, Floats]:
        """`resultants` of the inner grains, zero on the others."""
        normal, shear = (np.where(self.inner[:, None], r, 0.0) for r in self.resultants)
        return normal, shear


def goes_with_root(stiffness: Floats, radii: Floats, overlap: Floats) -> bool:
    """Whether stiffnesses are Hertz's: they go with the root of the overlap; `radii` (C, 2)."""
    one, two = radii[:, 0], radii[:, 1]
    size = np.log(one * two / (one + two) * overlap)
    size -= size.mean() if len(size) else 0.0
    spread = float(size @ size)
    if len(size) < FEWEST or spread < LEAST_SPREAD**2 * len(size):
        return False
    return bool(abs(size @ np.log(stiffness) / spread - 0.5) < ROOT_BAND)


# Grains this near the bounding box, in mean radii, may touch a wall whose force is not known.
RIM = 0.05


def on_rim(x: Floats, radii: Floats, touched: Flags) -> Flags:
    """(G,) array: grains at the border of the box around those touched, where walls may be."""
    margin, near = RIM * radii.mean(), np.zeros(len(x), dtype=bool)
    for along in x.T:
        low, high = along - radii, along + radii
        near |= low < low[touched].min() + margin
        near |= high > high[touched].max() - margin
    return near
