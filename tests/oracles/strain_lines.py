"""The diamond along straight lines in (E1, E2), in closed form.

In half diagonals `(X, Y) = ((1 - E1) cos a0, (1 - E2) sin a0)`, lengths over `l0`, a line passes
the origin at the distance `d`; with `u` the length along it, counted from the foot of the
perpendicular, `l^2 = d^2 + u^2`. The normal force is `N = 1 - l`, and the shear increment
integrates to `Int l d(alpha) = o d asinh(u/d)` (the paper's) or to `alpha` itself (by radii,
`2 r d(alpha)`), `o` the sense of turning. From `T = 0` the contacts stick up to one yield point and
slide from there on until they open: slip dissipates where `kappa d + mu u >= 0` (by radii
`kappa d + mu u l >= 0`), and `u` only grows. Where a line leaves the quadrant `X, Y > 0` the
diamond folds onto an axis and ends; the formulas don't stop there.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = np.ndarray

# Halvings of a bracket, down to the rounding of its ends.
BRACKET_HALVINGS = 64


@dataclass(frozen=True, eq=False)
class StrainLine:
    """Straight strain paths of diamonds from states with `T = 0`; arrays (...)."""

    alpha0: Floats
    direction: Floats
    foot: Floats
    distance: Floats
    sense: Floats
    start: Floats

    def take(self, rows: NDArray[np.bool_]) -> StrainLine:
        """The picked lines of (n,)."""
        return StrainLine(**{field.name: getattr(self, field.name)[rows] for field in fields(self)})

    @property
    def folding(self) -> Floats:
        """`u` where the line leaves the quadrant `X, Y > 0`; infinite if it never does."""
        with np.errstate(divide="ignore", invalid="ignore"):
            reach = np.where(self.direction < 0.0, -self.foot / self.direction, np.inf)
        return reach.min(axis=-1)

    @property
    def opening(self) -> Floats:
        """`u` where the contacts open, `l = 1`; NaN on lines that never touch the disc."""
        with np.errstate(invalid="ignore"):
            return np.sqrt(1.0 - self.distance**2)


@dataclass(frozen=True, eq=False)
class LineStates:
    """States on strain lines; arrays (...). Forces over `kn l0`, stresses over `kn`, radians."""

    E1: Floats
    E2: Floats
    alpha: Floats
    length: Floats
    N: Floats
    T: Floats
    s1: Floats
    s2: Floats


def strain_line(alpha0: ArrayLike, E1: ArrayLike, E2: ArrayLike, angle: ArrayLike) -> StrainLine:
    """Line from the strains `(E1, E2)` in the direction `(cos(angle), sin(angle))`."""
    alpha0, E1, E2, angle = (
        np.asarray(x, dtype=float) for x in np.broadcast_arrays(alpha0, E1, E2, angle)
    )
    start = half_diagonals(alpha0, E1, E2)
    rate = -np.stack([np.cos(angle) * np.cos(alpha0), np.sin(angle) * np.sin(alpha0)], axis=-1)
    direction = rate / np.linalg.norm(rate, axis=-1, keepdims=True)
    turning = start[..., 0] * direction[..., 1] - start[..., 1] * direction[..., 0]
    # Along a radial line the branches turn only by the rounding of its direction.
    turning = np.where(np.abs(turning) > 4 * np.finfo(float).eps, turning, 0.0)
    along = np.sum(start * direction, axis=-1)
    return StrainLine(
        alpha0=alpha0,
        direction=direction,
        foot=start - along[..., None] * direction,
        distance=np.abs(turning),
        sense=np.sign(turning),
        start=along,
    )


def half_diagonals(alpha0: ArrayLike, E1: ArrayLike, E2: ArrayLike) -> Floats:
    """Half diagonals (..., 2) over `l0`, `((1 - E1) cos a0, (1 - E2) sin a0)`."""
    X, Y = (1.0 - np.asarray(E1)) * np.cos(alpha0), (1.0 - np.asarray(E2)) * np.sin(alpha0)
    return np.stack(np.broadcast_arrays(X, Y), axis=-1)


def sticking_shear(
    line: StrainLine, u: ArrayLike, kappa: ArrayLike, increment: str = "branch"
) -> Floats:
    """Shear force at `u` where the contacts have stuck from the start."""
    d = np.where(line.distance > 0.0, line.distance, 1.0)
    scale, primitive = (d, np.arcsinh) if increment == "branch" else (1.0, np.arctan)
    turned = primitive(np.asarray(u) / d) - primitive(line.start / d)
    return np.asarray(kappa) * line.sense * scale * turned


def yield_position(
    line: StrainLine, kappa: ArrayLike, mu: ArrayLike, increment: str = "branch"
) -> Floats:
    """`u` at which sticking contacts reach `|T| = mu N`; NaN where they open without shear.

    From the start on `|T| - mu N` is negative up to one root: it falls at most until slip would
    dissipate, and rises from there on.
    """
    mu, kappa = np.asarray(mu, dtype=float), np.asarray(kappa, dtype=float)
    slides = np.isfinite(mu) & (line.sense != 0.0) & (line.distance < 1.0)
    friction = np.where(slides, mu, 1.0)
    high = np.where(slides, line.opening, line.start)

    def excess(u: Floats) -> Floats:
        N = 1.0 - np.hypot(line.distance, u)
        return np.abs(sticking_shear(line, u, kappa, increment)) - friction * N

    return np.where(slides, bisect(excess, line.start, high), np.nan)


def bisect(rising: Callable[[Floats], Floats], low: Floats, high: Floats) -> Floats:
    """Roots of functions that are negative at `low` and not beyond the root; arrays (...)."""
    for _ in range(BRACKET_HALVINGS):
        middle = 0.5 * (low + high)
        beyond = rising(middle) >= 0.0
        low, high = np.where(beyond, low, middle), np.where(beyond, middle, high)
    return high


def line_states(
    line: StrainLine,
    u: ArrayLike,
    kappa: ArrayLike,
    mu: ArrayLike = np.inf,
    increment: str = "branch",
) -> LineStates:
    """States at `u`: sticking up to yield, then `T = s mu N`, nothing once open."""
    u = np.asarray(u, dtype=float)
    length = np.hypot(line.distance, u)
    N = np.maximum(1.0 - length, 0.0)
    T = sticking_shear(line, u, kappa, increment)
    slides = u > yield_position(line, kappa, mu, increment)
    friction = np.where(np.isfinite(mu), mu, 0.0)
    T = np.where(N > 0.0, np.where(slides, line.sense * friction * N, T), 0.0)
    X, Y = np.moveaxis(line.foot + u[..., None] * line.direction, -1, 0)
    cos0, sin0 = np.cos(line.alpha0), np.sin(line.alpha0)
    with np.errstate(invalid="ignore", divide="ignore"):
        cos, sin = X / length, Y / length
    return LineStates(
        E1=1.0 - X / cos0,
        E2=1.0 - Y / sin0,
        alpha=np.arctan2(Y, X),
        length=length,
        N=N,
        T=T,
        s1=(N * cos + T * sin) / sin0,
        s2=(N * sin - T * cos) / cos0,
    )
