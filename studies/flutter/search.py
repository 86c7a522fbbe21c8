"""Complex eigenvalues of the operators of sampled loops: where they occur, and how large."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from typing import Any, get_args

import numpy as np
from numpy.typing import NDArray

from loops import assemble_tangent, macroscopic_tangent
from loops.closures import Closure
from stability import (
    flutter_pairs,
    operator_norm,
    restrict,
    spectrum,
    statuses,
    symmetric_spectrum,
)
from studies.flutter.sample import (
    Contacts,
    Forces,
    Ranges,
    Sample,
    Shape,
    draw_loops,
    loaded,
    random_levels,
    repeated,
)

Floats = NDArray[np.float64]

SUBSPACES = ("diagonal", "symmetric", "full")
OPERATORS = (*(f"{c} {s}" for c in ("affine", "traction") for s in SUBSPACES), "grains")
# Entries are taken as known to this: |Im| below 1e-5 |K| never counts, and a triple root that
# rounding splits, by 5e-6, does not either.
UNCERTAINTY = 1e-10


@dataclass(frozen=True, eq=False)
class Flutter:
    """Complex eigenvalues of B operators.

    Attributes
    ----------
    known : (B,) array of bool
        Whether the operator could be computed.
    flutters : (B,) array of bool
        Whether it has a complex pair beyond rounding, `stability.flutter_pairs`.
    ratio : (B,) array
        Largest |Im|/|eigenvalue| of these pairs, 0 without.
    stable : (B,) array of bool
        Whether Ks is positive definite: W2 > 0 in every direction. Never for the grain-level
        operator, which has rigid translations.
    """

    known: NDArray[np.bool_]
    flutters: NDArray[np.bool_]
    ratio: Floats
    stable: NDArray[np.bool_]


def flutter_of(K: Floats) -> Flutter:
    """Complex eigenvalues of operators.

    Parameters
    ----------
    K : (B, m, m) array

    Returns
    -------
    Flutter

    Examples
    --------
    >>> found = flutter_of(np.array([[[1.0, -0.5], [0.5, 1.0]], [[2.0, 0.0], [0.0, 1.0]]]))
    >>> found.flutters.tolist(), found.ratio.round(6).tolist(), found.stable.tolist()
    ([True, False], [0.447214, 0.0], [True, True])
    """
    pairs, values = flutter_pairs(K, UNCERTAINTY), spectrum(K)
    size = np.where(pairs, np.abs(values), 1.0)
    ratio = np.where(pairs, np.abs(np.where(pairs, values, 0.0).imag) / size, 0.0)
    least, norm = symmetric_spectrum(K)[:, 0], operator_norm(K)
    return Flutter(
        known=np.asarray(np.isfinite(K).all(axis=(-2, -1))),
        flutters=np.asarray(pairs.any(axis=-1)),
        ratio=ratio.max(axis=-1),
        stable=statuses(least, norm) == "stable",
    )


def operators_of(sample: Sample) -> Iterator[tuple[str, Floats]]:
    """Named operators of sampled loops, spins blocked: both closures, and the grain-level K.

    Parameters
    ----------
    sample : Sample

    Yields
    ------
    name : str
        One of `OPERATORS`.
    K : (B, m, m) array
        Not symmetrised; NaN where the loop could not be loaded so.
    """
    for closure in get_args(Closure):
        A = _tangent(sample, closure)
        yield from ((f"{closure} {name}", restrict(A, name)) for name in SUBSPACES)
    K = assemble_tangent(sample.graph, sample.law, regime=sample.regime)
    yield "grains", np.where(sample.reached[:, None, None], K, np.nan)


def search(
    orders: tuple[int, ...], loops: int, seed: int, ranges: Ranges
) -> Iterator[dict[str, Any]]:
    """Search every family of loops.

    Parameters
    ----------
    orders : tuple of int
        Orders n.
    loops : int
        Loops drawn in each family.
    seed : int
        Each family draws from its own sequence: the families don't depend on each other.
    ranges : Ranges
        What is searched.

    Yields
    ------
    dict
        One row for each family and operator, see `row_of`.

    Examples
    --------
    >>> rows = list(search((3,), 50, 1, Ranges()))
    >>> len(rows) == 8 * len(OPERATORS)
    True
    """
    for order, shape, forces, contacts in families(orders):
        codes = [_code(name) for name in (shape, forces, contacts)]
        rng = np.random.default_rng([seed, order, *codes])
        drawn = draw_loops(rng, loops, order, shape, forces, contacts, ranges)
        sample = loaded(drawn, *random_levels(rng, loops, ranges))
        for name, K in operators_of(sample):
            row = {"order": order, "shape": shape, "forces": forces, "contacts": contacts}
            yield row | {"operator": name} | row_of(sample, flutter_of(K))


def families(orders: tuple[int, ...]) -> Iterator[tuple[int, Shape, Forces, Contacts]]:
    """Order, shape, forces and contacts of every family."""
    return product(orders, get_args(Shape), get_args(Forces), get_args(Contacts))


def row_of(sample: Sample, found: Flutter) -> dict[str, Any]:
    """Counts and extremes of one operator in one family.

    Parameters
    ----------
    sample : Sample
    found : Flutter

    Returns
    -------
    dict
        `loops`, `known`, `flutter`, `share` (of the known), `flutter_stable` (with W2 > 0 in every
        direction), `largest_ratio` (|Im|/|eigenvalue|), and the smallest `friction`, `overlap` and
        `kappa` at which a pair occurs; NaN where none does.
    """
    hit = found.flutters
    kappa = np.broadcast_to(sample.law.kt[..., 0], hit.shape)

    def least(values: Floats) -> float:
        return float(values[hit].min()) if hit.any() else float("nan")

    known = int(found.known.sum())
    return {
        "loops": len(hit),
        "known": known,
        "flutter": int(hit.sum()),
        "share": float(hit.sum() / max(known, 1)),
        "flutter_stable": int((hit & found.stable).sum()),
        "largest_ratio": float(found.ratio.max()),
        "least_friction": least(sample.friction),
        "least_overlap": least(sample.overlap),
        "least_kappa": least(kappa),
    }


def flutter_map(
    forces: Forces,
    contacts: Contacts,
    friction: Floats,
    overlap: Floats,
    *,
    order: int,
    loops: int,
    seed: int,
    ranges: Ranges,
) -> dict[str, tuple[Floats, Floats]]:
    """Largest ratio and share of flutter on a grid of T/N and N/l.

    The same irregular loops stand in every cell, their forces scaled to its level.

    Parameters
    ----------
    forces, contacts : str
        Family, see `sample_loops`.
    friction, overlap : (F,), (O,) array
        Levels of the largest |T|/N and of the mean N/l.
    order, loops, seed : int
        Order, number of loops, seed.
    ranges : Ranges
        Asymmetry and kt/kn.

    Returns
    -------
    dict of str to (ratio, share)
        By closure, in the symmetric subspace; (O, F) arrays, NaN where no loop can be loaded so.
    """
    rng = np.random.default_rng([seed, order, _code(forces), _code(contacts)])
    drawn = draw_loops(rng, loops, order, "irregular", forces, contacts, ranges)
    level_o, level_f = np.meshgrid(overlap, friction, indexing="ij")
    levels = (np.repeat(level.ravel(), loops) for level in (level_f, level_o))
    sample = loaded(repeated(drawn, level_o.size), *levels)
    maps = {}
    for closure in get_args(Closure):
        found = flutter_of(restrict(_tangent(sample, closure), "symmetric"))
        ratio, flutters, known = (
            values.reshape(*level_o.shape, loops)
            for values in (found.ratio, found.flutters, found.known)
        )
        count = np.where(known.any(axis=-1), known.sum(axis=-1), np.nan)
        maps[closure] = ratio.max(axis=-1) + 0.0 * count, flutters.sum(axis=-1) / count
    return maps


def _tangent(sample: Sample, closure: Closure) -> Floats:
    """(B, 4, 4) macroscopic tangents."""
    A = macroscopic_tangent(sample.graph, sample.law, closure, regime=sample.regime).matrix
    return np.where(sample.reached[:, None, None], A, np.nan)


def _code(name: str) -> int:
    """A number for a family's sequence."""
    return int.from_bytes(name.encode()[:4], "big")
