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
class Sample:
    """B loops of one order.

    Attributes
    ----------
    graph : GrainGraph
        In their current state, which is the reference too; kn = 1, side lengths about 1.
    law : LinearFrictional
        With `kt` (B, 1) and `mu` (B, n): what the contacts that slide need to be at yield.
    regime : (B, n) array of int8
        Regimes.
    friction, overlap, asymmetry : (B,) array
        Largest |T|/N, mean N/l, and 0 (regular) to 1.
    """

    graph: GrainGraph
    law: LinearFrictional
    regime: NDArray[np.int8]
    friction: Floats
    overlap: Floats
    asymmetry: Floats


def sample_loops(
    rng: np.random.Generator,
    count: int,
    order: int,
    shape: Shape,
    forces: Forces,
    contacts: Contacts,
    ranges: Ranges,
    *,
    friction: Floats | None = None,
    overlap: Floats | None = None,
) -> Sample:
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
        of a loop under uniform nominal stress, `f_c = f^ - P m_c` (theory note, section 4).
    contacts : {'elastic', 'sliding'}
        All elastic, or a random part sliding, at least one; their friction is what puts each of
        them at yield.
    ranges : Ranges
        What is searched.
    friction, overlap : (B,) array, optional
        Levels instead of random ones.

    Returns
    -------
    Sample

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> drawn = sample_loops(rng, 5, 4, "irregular", "balanced", "elastic", Ranges())
    >>> drawn.graph.batch_shape, bool((drawn.graph.normal_force > 0).all())
    ((5,), True)
    """
    asymmetry = rng.uniform(0.05, 1.0, count) if shape == "irregular" else np.zeros(count)
    low, high = np.log(ranges.overlap)
    overlap = np.exp(rng.uniform(low, high, count)) if overlap is None else overlap
    friction = rng.uniform(*ranges.friction, count) if friction is None else friction
    x = _corners(rng, order, asymmetry, ranges)
    draw = _assigned if forces == "assigned" else _balanced
    normal, shear = draw(rng, x, asymmetry, ranges)
    sides = np.roll(x, -1, axis=1) - x
    length = np.hypot(sides[..., 0], sides[..., 1])
    normal *= (overlap / (normal / length).mean(axis=1))[:, None]
    # The shape of T stays, its size makes the largest |T|/N what is asked for.
    ratio = shear / normal
    shear = normal * ratio * (friction / np.abs(ratio).max(axis=1))[:, None]
    regime = np.full((count, order), Regime.ELASTIC, dtype=np.int8)
    if contacts == "sliding":
        slides = rng.random((count, order)) < rng.uniform(0.1, 1.0, (count, 1))
        slides[np.arange(count), rng.integers(order, size=count)] = True
        regime[slides] = Regime.SLIDING
    graph = GrainGraph(
        x=x,
        radii=np.repeat(0.55 * length.max(axis=1, keepdims=True), order, axis=1),
        contacts=np.column_stack([np.arange(order), np.roll(np.arange(order), -1)]),
        normal_force=normal,
        shear_force=shear,
    )
    kappa = rng.uniform(*ranges.kappa, (count, 1))
    law = LinearFrictional(kn=1.0, kt=kappa, mu=np.abs(shear) / normal)
    return Sample(graph, law, regime, friction, overlap, asymmetry)


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
    rng: np.random.Generator, x: Floats, asymmetry: Floats, ranges: Ranges
) -> tuple[Floats, Floats]:
    """Forces one by one; T/N of either sign and any size in irregular loops, +-1 in regular."""
    size = x.shape[:2]
    moved = asymmetry[:, None]
    normal = 1.0 + ranges.spread * moved * rng.uniform(-1, 1, size)
    sign = rng.choice([-1.0, 1.0], size)
    return normal, normal * sign * (1.0 - moved * rng.uniform(0, 1, size))


def _balanced(
    rng: np.random.Generator, x: Floats, asymmetry: Floats, ranges: Ranges
) -> tuple[Floats, Floats]:
    """Forces `f^ - P m_c` that balance a uniform stress, all N > 0.

    P is symmetric with a random deviator, `f^` random; both are drawn back towards isotropic
    pressure, under which every contact of these loops is pressed, until they all are.
    """
    count = len(x)
    x = x - x.mean(axis=1, keepdims=True)
    following = np.roll(x, -1, axis=1)
    side = following - x
    n = side / np.linalg.norm(side, axis=-1, keepdims=True)
    t = np.stack([-n[..., 1], n[..., 0]], axis=-1)
    midpoint = outward(x, 0.5 * (x + following))
    deviator = rng.uniform(-1, 1, (2, count))
    dP = np.moveaxis(np.array([[deviator[0], deviator[1]], [deviator[1], -deviator[0]]]), 2, 0)
    extra = rng.uniform(-0.7, 0.7, (count, 1, 2)) - np.einsum("bij,bcj->bci", dP, midpoint)
    pressed = -(midpoint * n).sum(axis=-1)
    change = (extra * n).sum(axis=-1)
    # The largest share of the deviator that leaves every N at a tenth of its pressure or more.
    room = np.where(change < 0.0, 0.9 * pressed / np.where(change < 0.0, -change, 1.0), np.inf)
    share = np.minimum(1.0, room.min(axis=1)) * rng.uniform(0.2, 1.0, count)
    force = -midpoint + share[:, None, None] * extra
    return (force * n).sum(axis=-1), (force * t).sum(axis=-1)
