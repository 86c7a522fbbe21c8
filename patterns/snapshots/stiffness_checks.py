"""Checks of stiffnesses and radii: forces against overlaps, changes of T against slip."""

from __future__ import annotations

import numpy as np

from loops.arrays import Floats, Integers, median
from loops.laws.kinds import HertzMindlin
from patterns.snapshots.checked import FEWEST, ROUNDINGS, Checked
from patterns.snapshots.findings import NEAR_ROUND, Finding, few, finding, power_of_ten, rounding

# N over the force that kn and the overlap give, less one (median): clean 4e-5, which is damping in
# a sample that moves; scatter and rounding of the file come on top.
STIFFNESS_OFF = 0.005


def stiffness(state: Checked) -> Finding | None:
    """N against kn times the overlap: scale of forces or kn, units, exchanged stiffnesses."""
    fit = state.fit
    if fit is None:
        return None
    rows = fit.rows
    kn, kt = (values[rows] for values in state.stiffnesses)
    secant = state.pressed[rows] / state.overlap[rows]
    raw, exceeds = median(secant / kn), median(kt / kn)
    off = abs(fit.ratio - 1) > STIFFNESS_OFF + fit.error
    of_kt = median(secant / kt)
    if off and abs(of_kt - 1) < NEAR_ROUND < abs(exceeds - 1):
        return finding("stiffness", raw, "exchanged", of_kt=of_kt, hertz="")
    needed, power = _needed_stiffness(state, rows, secant)
    modulus = _needed_modulus(state, rows) if off or power > 1 else ""
    if power != fit.power and not state.goes_with_root(kn, rows):
        return finding("stiffness", raw, "root", needed=needed, modulus=modulus, hertz="")
    hertz = f", Hertz's tangents give {1 / fit.power:.4g}" if fit.power > 1 else ""
    if off:
        unit = power_of_ten(fit.ratio)
        of_modulus = state.law is not None and state.law.of_moduli
        right = modulus if of_modulus else f"kn = {needed:.4g}"
        right += f" ({modulus})" if fit.power > 1 and not of_modulus else ""
        values = {"ratio": fit.ratio, "inverse": 1 / fit.ratio, "right": right, "unit": unit}
        values |= {"stiff": "the modulus" if of_modulus else "kn", "hertz": hertz}
        return finding("stiffness", raw, "unit" if unit else "scale", **values)
    if fit.power != state.power and not state.cohesive:
        return finding("stiffness", raw, "strains", hertz=hertz)
    if exceeds > 1 + NEAR_ROUND:
        return finding("stiffness", exceeds, "shear")
    return finding("stiffness", raw, hertz=hertz)


def _needed_stiffness(state: Checked, rows: Integers, secant: Floats) -> tuple[float, float]:
    """Median kn that forces and overlaps need, and the power of the overlap that N goes with."""
    of_hertz = state.goes_with_root(secant, rows)
    power = HertzMindlin.overlap_power if of_hertz else state.power
    return median(secant) / (1.0 / power), power


def _needed_modulus(state: Checked, rows: Integers) -> str:
    """`E/(1 - nu^2)` that forces and overlaps need under Hertz's law (median), for a sentence."""
    reduced = state.radii[state.contacts[rows]].prod(axis=1) / state.reach[rows]
    overlap = state.overlap[rows]
    share = 1.0 / HertzMindlin.overlap_power
    modulus = median(state.pressed[rows] / overlap / (share * np.sqrt(reduced * overlap)))
    return f"E/(1 - nu^2) = {modulus:.4g}"


def needed_stiffness(state: Checked) -> Finding | None:
    """Kn that forces and overlaps need, of an input that has none."""
    rows = state.overlapping
    if len(rows) == 0:
        return None
    needed, power = _needed_stiffness(state, rows, state.pressed[rows] / state.overlap[rows])
    if power > 1:
        return finding("stiffness", needed, "needed_hertz", modulus=_needed_modulus(state, rows))
    return finding("stiffness", needed, "needed")


# Overlaps off by a share of the larger one and of the typical one: clean 1e-3 at rest, most of it
# the damping of LAMMPS; what most contacts are off by is told from them besides.
ODD_SHARE = 0.01
# Multiple of that noise for the contacts of one grain, which agree.
OF_GRAIN = 5.0
# For a single contact: where a sample moves, its damping is up to 30 times that of most.
OF_CONTACT = 50.0
# Share of the contacts of a grain whose overlaps need one change of its radius.
AGREEING_CONTACTS = 0.8


def wrong_radii(state: Checked) -> tuple[Integers, Floats]:
    """Grains whose contacts need another radius, all by one change, and that change.

    A grain has two contacts at least: of a single one the other grain may be the wrong one.
    """
    fit = state.fit
    if fit is None or len(state.contacts) < FEWEST:
        return np.zeros(0, dtype=np.int64), np.zeros(0)
    pushed = state.pressed > 0
    allowed = fit.allowed(OF_GRAIN, ODD_SHARE, state.rounded)
    if not (np.abs(fit.off) > allowed).any():
        return np.zeros(0, dtype=np.int64), np.zeros(0)
    allowed, off = (np.tile(values[pushed], 2) for values in (allowed, fit.off))
    grain = state.contacts[pushed].T.ravel()
    degree = np.bincount(grain, minlength=len(state.x))
    outlying = np.bincount(grain[np.abs(off) > allowed], minlength=len(state.x))
    candidates = (outlying >= 2) & (outlying >= AGREEING_CONTACTS * degree)
    rows = np.flatnonzero(candidates[grain])
    if len(rows) == 0:
        return np.zeros(0, dtype=np.int64), np.zeros(0)
    rows = rows[np.lexsort((off[rows], grain[rows]))]
    grains, first, count = np.unique(grain[rows], return_index=True, return_counts=True)
    change = off[rows][first + count // 2]
    common = np.repeat(change, count)
    agrees = np.abs(off[rows] - common) <= allowed[rows] + NEAR_ROUND * np.abs(common)
    sound = np.add.reduceat(agrees, first, dtype=np.int64) >= AGREEING_CONTACTS * count
    sound &= state.radii[grains] + change > 0
    return grains[sound], change[sound]


def one_radius(state: Checked) -> Finding | None:
    """Grains whose radius is not the one that all their contacts need."""
    if state.fit is None or len(state.contacts) < FEWEST:
        return None
    grains, change = wrong_radii(state)
    old, ids = state.radii[grains], state.ids[grains]
    new, rows = old + change, range(len(grains))
    each = few(
        rows, lambda g: f"that of grain {ids[g]} is {old[g] / new[g]:.6g} times what they need"
    )
    right = few(rows, lambda g: f"grain {ids[g]} the radius {new[g]:.8g}")
    case = "some" if len(grains) else "ok"
    return finding("radius", len(grains), case, each=each, right=right)


def one_contact(state: Checked) -> Finding | None:
    """Contacts whose force, kn and overlap do not fit where those of the others do."""
    fit = state.fit
    if fit is None or len(state.contacts) < FEWEST:
        return None
    odd = np.abs(fit.off) > fit.allowed(OF_CONTACT, ODD_SHARE, state.rounded)
    rows = np.flatnonzero(odd)
    # Of a wrong radius another check tells.
    rows = rows[~np.isin(state.contacts[rows], wrong_radii(state)[0]).any(axis=1)]
    touches, kn = state.overlap > 0, state.stiffnesses[0]
    ratio = fit.needed / np.where(touches, state.overlap, 1.0)

    def each(c: int) -> str:
        what = f"N is {ratio[c]:.4g} times what they give" if touches[c] else "N acts across a gap"
        return f"grains {state.names(np.array([c]))} ({what})"

    right = few(rows, lambda c: f"kn = {kn[c] * ratio[c]:.4g}" if touches[c] else "N = 0")
    case = "some" if len(rows) else "ok"
    return finding("kn", len(rows), case, each=few(rows, each), right=right)


# Share of the radii by which all of them are off: clean 1e-4 (kn not known), else 1e-7.
RADII_OFF = 2e-4
# That change must leave so much less of N - kn times overlap unexplained.
EXPLAINED = 3.0


def radii(state: Checked) -> Finding | None:
    """Radii that are all off by one factor: N is then linear in the overlap but not proportional.

    Least squares for `N / kn = a overlap + b (r1 + r2)`; radii too large by a share s give
    `b = -a s`.
    """
    rows = state.overlapping
    if len(rows) < FEWEST:
        return None
    needed = state.pressed[rows] / state.stiffnesses[0][rows]
    overlap, reach = state.overlap[rows], state.reach[rows]
    squares = [[overlap @ overlap, overlap @ reach], [overlap @ reach, reach @ reach]]
    slope, offset = np.linalg.lstsq(squares, [overlap @ needed, reach @ needed], rcond=None)[0]
    share = float(-offset / slope)
    case = "ok"
    coarse = ROUNDINGS * rounding(state.x) / float(reach.mean())
    if slope > 0 and abs(share) > RADII_OFF + coarse:
        without = median(np.abs(needed - overlap * median(needed / overlap)))
        left = median(np.abs(needed - slope * overlap - offset * reach))
        case = "off" if EXPLAINED * left < without else "ok"
    return finding("radii", share, case, times=1 - share, by=1 / (1 - share))
