"""Tangents of random loops against balls of 260 bits: broken bounds and withheld answers.

Loops of 3 to 60 grains under a closure and a rule of spins drawn for each: plain, flat, stiff, of
sizes up to 1:1000, away from their reference; with contacts that slide, are open, or have a shear
stiffness of 1e-12 to 1e3 of the normal one; loads driven to a pole of the operator, or to where Ks
loses definiteness; rings of equal, alternating or mirrored grains with gear modes. An answer is
withheld if it is not trusted or its bound exceeds a tenth of the operator.
"""

from collections import Counter
from typing import NamedTuple
from unittest.mock import patch

import numpy as np

from loops import (
    GrainGraph,
    LinearFrictional,
    Regime,
    contact_state,
    macroscopic_tangent,
    polygon_area,
)
from stability import judge, restrict, symmetric_spectrum
from tests.oracles.loop_balls import ball_tangent
from tests.oracles.rings import ring

RULES = [(c, s) for c in ("affine", "traction") for s in ("blocked", "affine", "free")]
KINDS = ("plain", "flat", "stiff", "unequal", "all", "gear", "closed")
WITHHELD = 0.1
STEPS = 30


class Loops(NamedTuple):
    """B loops of n grains: x, x0 (B, n, 2), radii, normal, shear, regime (B, n), springs (B,)."""

    x: np.ndarray
    x0: np.ndarray
    radii: np.ndarray
    normal: np.ndarray
    shear: np.ndarray
    regime: np.ndarray
    kn: np.ndarray
    kt: np.ndarray
    mu: np.ndarray
    increment: str


def random_loops(rng, count, n, kind, increment):
    """`Loops` of one kind, forces assigned; radii of the size of their contacts."""
    spread = 10.0 ** rng.uniform(0, 3, count) if kind in ("unequal", "all") else np.full(count, 1.5)
    radii = 0.5 * spread[:, None] ** rng.uniform(-1, 0, (count, n))
    edges = radii + np.roll(radii, -1, axis=1)
    # Corners on an arc: not closed at random, so the last edge takes what is left.
    angles = np.cumsum(edges, axis=1) / edges.sum(axis=1, keepdims=True)
    size = edges.sum(axis=1) / (2 * np.pi)
    x0 = size[:, None, None] * np.stack(
        [np.cos(2 * np.pi * angles), np.sin(2 * np.pi * angles)], axis=-1
    )
    x0 += 0.1 * radii[..., None] * rng.uniform(-1, 1, (count, n, 2))
    flat = np.ones(count)
    if kind in ("flat", "all"):
        flat = 10.0 ** rng.uniform(-6, 0, count)
    turn, tilt = rng.uniform(0, 2 * np.pi, (2, count))
    x0 = rotated(rotated(x0, turn) * np.stack([np.ones(count), flat], axis=-1)[:, None], tilt)
    moved = rng.random(count) < 0.5
    step = np.where(moved, 10.0 ** rng.uniform(-6, -1, count), 0.0) * flat
    x = x0 + step[:, None, None] * radii[..., None] * rng.uniform(-1, 1, (count, n, 2))
    shift = rng.choice([0.0, 2.0**10, 2.0**20, 2.0**30], count) * rng.choice([-1, 1], count)
    x, x0 = (a + np.stack([shift, -0.5 * shift], axis=-1)[:, None] for a in (x, x0))
    length = np.linalg.norm(np.roll(x, -1, axis=1) - x, axis=-1)
    overlap = 10.0 ** rng.uniform(-8 if kind in ("stiff", "all") else -3, -0.5, count)
    normal = overlap[:, None] * length * rng.uniform(0.2, 1.8, (count, n))
    slides = rng.random((count, n)) < rng.choice([0.0, 0.3, 1.0], count)[:, None]
    slides[:, -1] |= slides.any(axis=1)
    share = np.where(
        slides, rng.choice([-1.0, 1.0], (count, n)), rng.uniform(-0.9, 0.9, (count, n))
    )
    return Loops(
        x, x0, radii, normal, share * normal, np.where(slides, 2, 1).astype(np.int8),
        np.ones(count), rng.uniform(0.05, 1.0, count), rng.uniform(0.1, 1.0, count), increment,
    )  # fmt: skip


def closed_loops(rng, count, n, increment):
    """Elastic loops with N of 1e-10 to 1e-2 and the overlaps N/kn, kt of 1e-6 to 1 of kn.

    In even loops of small overlaps load and stiffness of the gear mode are both next to nothing,
    and both decide where a law shares the arms by the point of contact.
    """
    radii = rng.uniform(0.35, 0.65, (count, n))
    normal = 10.0 ** rng.uniform(-10, -2, (count, 1)) * rng.uniform(0.3, 1.7, (count, n))
    edges = radii + np.roll(radii, -1, axis=1) - normal
    # All edges but two in a bow; these close the loop.
    angles = 2 * np.pi * np.arange(n - 2) / n + rng.uniform(-0.3, 0.3, (count, n - 2))
    steps = edges[:, :-2, None] * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    chain = np.concatenate([np.zeros((count, 1, 2)), np.cumsum(steps, axis=1)], axis=1)
    a, b, chord = edges[:, -2], edges[:, -1], -chain[:, -1]
    size = np.linalg.norm(chord, axis=1)
    along = (a**2 - b**2 + size**2) / (2 * size)
    square = a**2 - along**2
    left = np.stack([-chord[:, 1], chord[:, 0]], axis=-1)
    # To the right of the chord that closes the loop: outside.
    last = along[:, None] * chord - np.sqrt(np.maximum(square, 0.0))[:, None] * left
    last = chain[:, -1] + last / size[:, None]
    x = rotated(np.concatenate([chain, last[:, None]], axis=1), rng.uniform(0, 2 * np.pi, count))
    shear = rng.uniform(-0.45, 0.45, (count, n)) * normal * (rng.random((count, 1)) < 0.6)
    loops = Loops(
        x, x, radii, normal, shear, np.ones((count, n), np.int8),
        np.ones(count), 10.0 ** rng.uniform(-6, 0, count), np.full(count, 0.5), increment,
    )  # fmt: skip
    good = (square > 0) & (polygon_area(x) > 0)
    return Loops(*(part if isinstance(part, str) else part[good] for part in loops))


def rotated(x, angle):
    c, s = np.cos(angle), np.sin(angle)
    turn = np.stack([np.stack([c, -s], axis=-1), np.stack([s, c], axis=-1)], axis=-2)
    return x @ np.swapaxes(turn, -1, -2)


def usable(loops):
    """Loops that rounding to their place has left with an area and with branches."""
    branches = np.roll(loops.x, -1, axis=1) - loops.x
    good = (polygon_area(loops.x0) > 0) & branches.any(axis=-1).all(axis=-1)
    good &= (np.roll(loops.x0, -1, axis=1) - loops.x0).any(axis=-1).all(axis=-1)
    return Loops(*(a if isinstance(a, str) else a[good] for a in loops))


def drawn(rng, kind):
    """One loop and its law, the closure and the rule of the spins."""
    n = round(3.0 * 20.0 ** rng.random() ** 2)
    increment = str(rng.choice(["branch", "radii"]))
    if kind == "gear":
        graph = gear_ring(rng, 2 * max(2, n // 2))
        loops = None
    else:
        make = closed_loops if kind == "closed" else random_loops
        loops = (
            make(rng, 1, max(n, 4), increment)
            if kind == "closed"
            else usable(make(rng, 1, n, kind, increment))
        )
        if not len(loops.kn):
            return None
        graph = GrainGraph(
            x=loops.x[0], x0=loops.x0[0], radii=loops.radii[0], contacts=ring(loops.radii.shape[1]),
            normal_force=loops.normal[0], shear_force=loops.shear[0] * loops.mu[0],
        )  # fmt: skip
    count = graph.contact_count
    kt = 10.0 ** rng.uniform(-12, 3, count) if rng.random() < 0.2 else rng.uniform(0.05, 1.0)
    law = LinearFrictional(rng.uniform(0.5, 2.0, count), kt, rng.uniform(0.1, 1.0), increment)
    share = rng.choice([0.0, 0.3, 1.0])
    slides = rng.random(count) < share
    side = np.where(graph.shear_force < 0.0, -1.0, 1.0)
    T = np.where(slides, side * law.mu * graph.normal_force, graph.shear_force)
    opened = rng.random(count) < rng.choice([0.0, 0.0, 1.5 / count])
    regime = np.where(opened, Regime.OPEN, np.where(slides, Regime.SLIDING, Regime.ELASTIC))
    graph = graph.replace(
        normal_force=np.where(opened, 0.0, graph.normal_force),
        shear_force=np.where(opened, 0.0, T), regime=regime,
    )  # fmt: skip
    rule = RULES[rng.integers(len(RULES))]
    driven = rng.choice(["as it comes", "pole", "verge"])
    if driven != "as it comes":
        graph = graph_at(rng, graph, law, rule, str(driven))
    return graph, law, rule


def gear_ring(rng, n):
    """An even ring that turns without shear: equal, alternating or mirrored grains."""
    kind = rng.integers(3)
    radii = np.ones(n)
    if kind == 1:
        radii = np.tile([1.0, rng.uniform(0.3, 1.0)], n // 2)
    elif kind == 2:
        half = rng.uniform(0.4, 1.0, n // 2 + 1)
        radii = np.concatenate([half, half[-2:0:-1]])
    angles = 2 * np.pi * (np.arange(n) + 0.5) / n
    x = n / np.pi * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    if kind != 2:
        x += rng.uniform(-0.2, 0.2, x.shape)
    length = np.linalg.norm(np.roll(x, -1, axis=0) - x, axis=1)
    normal = 10.0 ** rng.uniform(-8, -1) * length * rng.uniform(0.2, 1.8, n)
    return GrainGraph(
        x=x, radii=radii, contacts=ring(n), normal_force=normal,
        shear_force=0.3 * normal * rng.uniform(-1, 1, n),
    )  # fmt: skip


def loaded(graph, load):
    """The loop with its forces times a load."""
    return graph.replace(
        normal_force=load * graph.normal_force, shear_force=load * graph.shear_force,
        regime=graph.regime,
    )  # fmt: skip


def graph_at(rng, graph, law, rule, driven):
    """The loop at a load next to a pole of its operator or a loss of definiteness of Ks."""

    def number(load):
        tangent = macroscopic_tangent(loaded(graph, load), law, rule[0], spins=rule[1])
        values = symmetric_spectrum(restrict(np.nan_to_num(tangent.matrix), "symmetric"))
        with np.errstate(divide="ignore"):
            return 1.0 / values[np.abs(values).argmax()] if driven == "pole" else values[0]

    loads = 10.0 ** np.linspace(-1, 2.5, 12)
    numbers = [number(load) for load in loads]
    for k in range(len(loads) - 1):
        if numbers[k] * numbers[k + 1] < 0.0:
            low, high, first = loads[k], loads[k + 1], numbers[k]
            for _ in range(STEPS):
                middle = 0.5 * (low + high)
                low, high = (middle, high) if number(middle) * first > 0.0 else (low, middle)
            return loaded(graph, low * (1.0 + 10.0 ** rng.uniform(-16, -6) * rng.choice([-1, 1])))
    return graph


def judged(count, seed, kinds=KINDS):
    """Counts of loops, and errors over their bounds, of single loops and of the kernels."""
    rng, total, ratios = np.random.default_rng(seed), Counter(), {"numpy": [], "kernels": []}
    relative = {"numpy": [], "kernels": []}
    while total["loops"] < count:
        found = drawn(rng, kinds[rng.integers(len(kinds))])
        if found is None:
            continue
        graph, law, (closure, spins) = found
        blocks = law.local_stiffness(contact_state(graph), graph.regime)
        by_radii = law.shear_increment == "radii"
        try:
            exact, radius = ball_tangent(graph, blocks, by_radii, closure, spins)
        except ZeroDivisionError:
            total["singular"] += 1
            continue
        size = np.linalg.norm(exact)
        if not radius < 1e-20 * size:
            total["singular"] += 1
            continue
        total["loops"] += 1
        smallest = symmetric_spectrum(restrict(exact, "symmetric"))[0]
        for way in ratios:
            with patch("loops.compiled.COMPILED_FROM", 1 if way == "kernels" else 10**9):
                tangent = macroscopic_tangent(graph, law, closure, spins=spins)
            if not (tangent.trusted and tangent.rounding <= WITHHELD * size):
                total[f"withheld, {way}"] += 1
                continue
            error = np.linalg.norm(tangent.matrix - exact)
            sign = {"stable": 1.0, "unstable": -1.0}.get(judge(tangent, "symmetric").status, 0.0)
            total[f"wrong, {way}"] += sign * smallest < -4 * np.finfo(float).eps * size
            total[f"broken, {way}"] += error > tangent.rounding
            ratios[way].append(error / tangent.rounding)
            relative[way].append(error / size)
    return total, ratios, relative
