"""Loops on the verge of stability against 32 digits: wrong signs, broken bounds.

Random loops of 3 to 12 grains: plain, flat (1 to 1e-6), stiff (N/l to 1e-8), of sizes 1:1000, away
from their reference, partly sliding, at offsets up to 2^30. A parameter (load, kappa or friction)
is driven to where the smallest eigenvalue of Ks vanishes, then moved off by 1e-16 to 1e-6 of
itself. Verdicts come from the stated error alone, without the customary 1e-12 of the norm.
"""

from collections import Counter

import numpy as np

from loops import (
    GrainGraph,
    LinearFrictional,
    contact_state,
    macroscopic_tangent,
    polygon_area,
)
from stability import operator_norm, restrict, statuses, symmetric_spectrum
from tests.oracles.exact_loops import Loops, exact_tangent, positive_definite
from tests.oracles.rings import ring

KINDS = ("plain", "flat", "stiff", "unequal", "all")
RULES = [(c, s) for c in ("affine", "traction") for s in ("blocked", "affine", "free")]
PARAMETERS = ("load", "kappa", "mu")
STEPS = 18
# Rounding of the three eigenvalues themselves.
EIGENVALUES = 4 * np.finfo(float).eps


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


def with_parameter(loops, name, value):
    """Loops at values (B,) of the parameter; shear forces are shares of mu N."""
    load = value if name == "load" else np.ones(len(value))
    mu = value if name == "mu" else loops.mu
    normal = load[:, None] * loops.normal
    return loops._replace(
        normal=normal,
        shear=mu[:, None] * load[:, None] * loops.shear,
        mu=mu,
        kt=loops.kn * value if name == "kappa" else loops.kt,
    )


def with_spread(rng, loops):
    """Loops with kt of each contact from 1e-8 to 1e3 of kn, shear forces shares of mu N."""
    loops = with_parameter(loops, "load", np.ones(len(loops.kn)))
    return loops._replace(kt=10.0 ** rng.uniform(-8, 3, loops.radii.shape))


def tangent(loops, closure, spins):
    graph = GrainGraph(
        x=loops.x, x0=loops.x0, radii=loops.radii, contacts=ring(loops.radii.shape[1]),
        normal_force=loops.normal, shear_force=loops.shear, regime=loops.regime,
    )  # fmt: skip
    kt = loops.kt if loops.kt.ndim == 2 else loops.kt[:, None]
    law = LinearFrictional(loops.kn[:, None], kt, loops.mu[:, None], loops.increment)
    return macroscopic_tangent(graph, law, closure, spins=spins)


def smallest(loops, closure, spins):
    return np.nan_to_num(
        symmetric_spectrum(restrict(tangent(loops, closure, spins).matrix, "symmetric"))[:, 0]
    )


def on_the_verge(rng, loops, closure, spins):
    """Loops with a sign change along a parameter, at the change but for a small step."""
    name = rng.choice(PARAMETERS)
    grid = {"load": 10.0 ** np.linspace(-1, 2.5, 8), "kappa": 10.0 ** np.linspace(-8, 0.5, 8),
            "mu": np.linspace(0.05, 2.0, 8)}[name]  # fmt: skip
    count = len(loops.kn)
    values = np.stack(
        [smallest(with_parameter(loops, name, np.full(count, g)), closure, spins) for g in grid]
    )
    change = (values[1:] > 0) != (values[:-1] > 0)
    kept = np.flatnonzero(change.any(axis=0))
    if len(kept) == 0:
        return None
    first = change[:, kept].argmax(axis=0)
    low, high = grid[first], grid[first + 1]
    left, right = values[first, kept], values[first + 1, kept]
    loops = Loops(*(a if isinstance(a, str) else a[kept] for a in loops))
    # False position after Illinois, halving every fourth time.
    for step in range(STEPS):
        slope = np.where(right == left, 1.0, right - left)
        middle = high - right * (high - low) / slope
        middle = 0.5 * (low + high) if step % 4 == 3 else middle
        value = smallest(with_parameter(loops, name, middle), closure, spins)
        crossed = (value > 0) != (right > 0)
        low, left = np.where(crossed, high, low), np.where(crossed, right, 0.5 * left)
        high, right = middle, value
    off = 10.0 ** rng.uniform(-16, -6, len(kept)) * rng.choice([-1.0, 1.0], len(kept))
    return with_parameter(loops, name, middle * (1.0 + off))


def counted(loops, closure, spins):
    """Counts and ratios of one batch."""
    found = tangent(loops, closure, spins)
    exact = exact_tangent(loops, closure, spins)
    error = np.linalg.norm((found.matrix - exact.hi) - exact.lo, axis=(1, 2))
    for k in np.flatnonzero(found.trusted & (error > found.rounding)):
        # Next to a gear mode pairs of doubles have no digits left: balls have.
        error[k] = np.linalg.norm(found.matrix[k] - in_balls(loops, k, closure, spins))
    stable = positive_definite(exact)
    k = restrict(found.matrix, "symmetric")
    status = statuses(
        symmetric_spectrum(np.nan_to_num(k))[:, 0], operator_norm(np.nan_to_num(k)), EIGENVALUES,
        error=found.rounding,
    )  # fmt: skip
    wrong = ((status == "stable") & ~stable) | ((status == "unstable") & stable)
    trusted = found.trusted
    return {
        "loops": len(stable),
        "untrusted": int((~trusted).sum()),
        "undetermined": int((status == "undetermined").sum()),
        "wrong signs": int(wrong.sum()),
        "broken bounds": int((error[trusted] > found.rounding[trusted]).sum()),
    }, (error / found.rounding)[trusted]


def in_balls(loops, k, closure, spins):
    """Tangent of one of the loops by 260 bits."""
    from tests.oracles.loop_balls import ball_tangent

    x, x0, radii, normal, shear, regime, kn, kt, mu = (part[k] for part in loops[:9])
    graph = GrainGraph(
        x=x, x0=x0, radii=radii, contacts=ring(len(radii)), normal_force=normal,
        shear_force=shear, regime=regime,
    )  # fmt: skip
    law = LinearFrictional(kn, kt, mu, loops.increment)
    blocks = law.local_stiffness(contact_state(graph), graph.regime)
    return ball_tangent(graph, blocks, loops.increment == "radii", closure, spins)[0]


def usable(loops):
    """Loops that rounding to their place has left with an area and with branches."""
    branches = np.roll(loops.x, -1, axis=1) - loops.x
    good = (polygon_area(loops.x0) > 0) & branches.any(axis=-1).all(axis=-1)
    good &= (np.roll(loops.x0, -1, axis=1) - loops.x0).any(axis=-1).all(axis=-1)
    return Loops(*(a if isinstance(a, str) else a[good] for a in loops))


def run(count, seed, verge, orders):
    """Yield (kind, closure, spins), counts and ratios; `verge` False takes loops as they come."""
    rng = np.random.default_rng(seed)
    for kind in KINDS:
        for closure, spins in RULES:
            total, ratio = Counter(), []
            for order in orders:
                share = max(count // (len(KINDS) * len(RULES) * len(orders)), 1)
                increment = rng.choice(["branch", "radii"])
                loops = usable(random_loops(rng, share, order, kind, str(increment)))
                if verge:
                    loops = on_the_verge(rng, loops, closure, spins)
                else:
                    loops = with_parameter(loops, "load", np.ones(len(loops.kn)))
                if loops is not None:
                    numbers, parts = counted(loops, closure, spins)
                    total.update(numbers)
                    ratio.append(parts)
            yield (kind, closure, spins), total, np.concatenate([np.zeros(0), *ratio])
