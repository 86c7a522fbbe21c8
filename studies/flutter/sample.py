"""Loops to search: shapes, forces and regimes over T/N, N/l and asymmetry."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from loops import GrainGraph, LinearFrictional, Regime
from loops.geometry import outward

Floats = NDArray[np.float64]
Shape = Literal["regular", "irregular"]
Forces = Literal["assigned", "balanced"]
Contacts = Literal["elastic", "sliding"]


@dataclass(frozen=True, eq=False)
class Ranges:
    """What is searched.

    Attributes
    ----------
    friction : (float, float)
        |T|/N, the largest of a loop.
    overlap : (float, float)
        N/l over kn, the mean of a loop; drawn evenly in its logarithm.
    kappa : (float, float)
        kt/kn.
    turn, stretch, spread : float
        Asymmetry 1: corners turn by up to `turn` times 2 pi/n and stand at 1 +- `stretch`; normal
        forces vary by +- `spread`.
    """

    friction: tuple[float, float] = (0.01, 1.2)
    overlap: tuple[float, float] = (1e-4, 0.5)
    kappa: tuple[float, float] = (0.05, 1.0)
    turn: float = 0.35
    stretch: float = 0.3
    spread: float = 0.8


@dataclass(frozen=True, eq=False)
class Drawn:
    """Loops drawn once, B of one order, to be loaded to any level of T/N and N/l.

    Attributes
    ----------
    x : (B, n, 2) array
        Corners, sides about 1.
    base, extra : (B, n, 2) array
        (N, T): a set of forces with little or no shear, and one to add in any amount.
    kappa : (B, 1) array
        kt/kn.
    regime : (B, n) array of int8
        Regimes.
    """

    x: Floats
    base: Floats
    extra: Floats
    kappa: Floats
    regime: NDArray[np.int8]


@dataclass(frozen=True, eq=False)
class Sample:
    """B loaded loops of one order.

    Attributes
    ----------
    graph : GrainGraph
        In their current state, which is the reference too; kn = 1, sides about 1.
    law : LinearFrictional
        With `kt` (B, 1) and `mu` (B, n): what puts each contact that slides at yield.
    regime : (B, n) array of int8
        Regimes.
    friction, overlap : (B,) array
        Largest |T|/N and mean N/l, over kn.
    reached : (B,) array of bool
        Whether the loop can be loaded so; its operators are left out otherwise.
    """

    graph: GrainGraph
    law: LinearFrictional
    regime: NDArray[np.int8]
    friction: Floats
    overlap: Floats
    reached: NDArray[np.bool_]


def draw_loops(
    rng: np.random.Generator,
    count: int,
    order: int,
    shape: Shape,
    forces: Forces,
    contacts: Contacts,
    ranges: Ranges,
) -> Drawn:
    """Draw loops of one order.

    Parameters
    ----------
    rng : numpy.random.Generator
    count, order : int
        Number of loops B and of their grains n.
    shape : {'regular', 'irregular'}
        Equal sides and angles, or corners moved by a random asymmetry.
    forces : {'assigned', 'balanced'}
        Contact forces drawn one by one, as the surroundings of a loop in a packing allow; or those
        of a loop under uniform symmetric stress, `f_c = f^ - P m_c` (theory note, section 4).
    contacts : {'elastic', 'sliding'}
        All elastic, or a random part sliding, at least one.
    ranges : Ranges
        What is searched.

    Returns
    -------
    Drawn
    """
    asymmetry = rng.uniform(0.05, 1.0, count) if shape == "irregular" else np.zeros(count)
    x = _corners(rng, order, asymmetry, ranges)
    base, extra = (
        _assigned(rng, order, asymmetry, ranges) if forces == "assigned" else _balanced(rng, x)
    )
    regime = np.full((count, order), Regime.ELASTIC, dtype=np.int8)
    if contacts == "sliding":
        slides = rng.random((count, order)) < rng.uniform(0.1, 1.0, (count, 1))
        slides[np.arange(count), rng.integers(order, size=count)] = True
        regime[slides] = Regime.SLIDING
    return Drawn(x, base, extra, rng.uniform(*ranges.kappa, (count, 1)), regime)


def random_levels(rng: np.random.Generator, count: int, ranges: Ranges) -> tuple[Floats, Floats]:
    """(B,) levels of the largest |T|/N and of the mean N/l; the latter even in its logarithm."""
    low, high = (float(np.log(level)) for level in ranges.overlap)
    return rng.uniform(*ranges.friction, count), np.exp(rng.uniform(low, high, count))


def loaded(drawn: Drawn, friction: Floats, overlap: Floats) -> Sample:
    """Load every loop to its level of T/N and N/l.

    The forces are `c (base + s extra)`: s, as small as it can be, puts the contact that comes first
    on its cone, `|T| = friction N`; c sets N/l. Both keep balanced forces balanced.

    Parameters
    ----------
    drawn : Drawn
        B loops.
    friction, overlap : (B,) array
        Levels.

    Returns
    -------
    Sample

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> drawn = draw_loops(rng, 2, 4, "regular", "balanced", "sliding", Ranges())
    >>> sample = loaded(drawn, np.array([0.3, 0.6]), np.array([0.01, 0.02]))
    >>> ratio = np.abs(sample.graph.shear_force) / sample.graph.normal_force
    >>> ratio.max(axis=1).round(12).tolist(), sample.reached.tolist()
    ([0.3, 0.6], [True, True])
    """
    share, reached = _shares(drawn, friction[:, None])
    normal, shear = np.moveaxis(drawn.base + share[:, None, None] * drawn.extra, -1, 0)
    sides = np.roll(drawn.x, -1, axis=1) - drawn.x
    length = np.hypot(sides[..., 0], sides[..., 1])
    scale = (overlap / (normal / length).mean(axis=1))[:, None]
    order = drawn.x.shape[1]
    graph = GrainGraph(
        x=drawn.x,
        radii=np.repeat(0.55 * length.max(axis=1, keepdims=True), order, axis=1),
        contacts=np.column_stack([np.arange(order), np.roll(np.arange(order), -1)]),
        normal_force=scale * normal,
        shear_force=scale * shear,
    )
    law = LinearFrictional(kn=1.0, kt=drawn.kappa, mu=np.abs(shear) / normal)
    return Sample(graph, law, drawn.regime, friction, overlap, reached)


def repeated(drawn: Drawn, levels: int) -> Drawn:
    """The same loops `levels` times, one set after the other."""
    fields = {name: np.tile(a, (levels, *[1] * (a.ndim - 1))) for name, a in vars(drawn).items()}
    return Drawn(**fields)


def _shares(drawn: Drawn, friction: Floats) -> tuple[Floats, NDArray[np.bool_]]:
    """(B,) smallest s that brings a contact to `|T| = friction N`, 0 where none does; whether."""
    N, T = np.moveaxis(drawn.base, -1, 0)
    dN, dT = np.moveaxis(drawn.extra, -1, 0)
    side = np.array([1.0, -1.0])[:, None, None]
    room, rate = friction * N - side * T, side * dT - friction * dN
    share = np.divide(room, rate, out=np.full_like(rate, np.inf), where=rate > 0.0).min(axis=(0, 2))
    # Within the cones from the start, and on one of them later: N stays positive on the way.
    reached = (room > 0.0).all(axis=(0, 2)) & np.isfinite(share)
    return np.where(reached, share, 0.0), reached


def _corners(rng: np.random.Generator, order: int, asymmetry: Floats, ranges: Ranges) -> Floats:
    """(B, n, 2) star-shaped loops in a random orientation, sides about 1."""
    size = (len(asymmetry), order)
    moved = asymmetry[:, None]
    step = 2.0 * np.pi / order
    angle = step * (np.arange(order) + ranges.turn * moved * rng.uniform(-1, 1, size))
    angle = angle + rng.uniform(0.0, 2.0 * np.pi, (len(asymmetry), 1))
    distance = (1.0 + ranges.stretch * moved * rng.uniform(-1, 1, size)) / (2 * np.sin(step / 2))
    return distance[..., None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)


def _assigned(
    rng: np.random.Generator, order: int, asymmetry: Floats, ranges: Ranges
) -> tuple[Floats, Floats]:
    """Forces one by one; T/N of either sign and any size in irregular loops, of one in regular."""
    size = (len(asymmetry), order)
    moved = asymmetry[:, None]
    N = 1.0 + ranges.spread * moved * rng.uniform(-1, 1, size)
    T = N * rng.choice([-1.0, 1.0], size) * (1.0 - moved * rng.uniform(0, 1, size))
    zero = np.zeros(size)
    return np.stack([N, zero], axis=-1), np.stack([zero, T], axis=-1)


def _balanced(rng: np.random.Generator, x: Floats) -> tuple[Floats, Floats]:
    """`-m_c` under a unit pressure, and `f^ - P m_c` with a random f^ and a random deviator P."""
    following = np.roll(x, -1, axis=1)
    side = following - x
    n = side / np.linalg.norm(side, axis=-1, keepdims=True)
    t = np.stack([-n[..., 1], n[..., 0]], axis=-1)
    centre = x.mean(axis=1, keepdims=True)
    m = outward(x, 0.5 * (x + following) - centre)
    a, b = rng.uniform(-1, 1, (2, len(x)))
    P = np.stack([np.stack([a, b], axis=-1), np.stack([b, -a], axis=-1)], axis=-2)
    more = rng.uniform(-0.7, 0.7, (len(x), 1, 2)) - np.einsum("bij,bcj->bci", P, m)
    base, extra = (
        np.stack([(f * n).sum(axis=-1), (f * t).sum(axis=-1)], axis=-1) for f in (-m, more)
    )
    return base, extra
