"""Time and error of the exact sweep and of `solve_ivp` on some of its paths."""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from patterns.diamond import DrainedEnd, drained_end
from studies.sweep.point_b import Floats, Row, exact_point_b, point_b_by_steps

# Integrator, relative tolerance; the first is what solve_ivp does when nothing is asked.
PER_PATH = {
    "solve_ivp, RK45, default": ("RK45", 1e-3),
    "solve_ivp, DOP853, 1e-8": ("DOP853", 1e-8),
    "solve_ivp, DOP853, 1e-12": ("DOP853", 1e-12),
}
EXACT = "drained_end, all at once"


def compare(
    diamonds: Floats, checked: int, paths: int, seed: int, repeats: int
) -> tuple[DrainedEnd, list[dict[str, Any]]]:
    """Time and error of the whole sweep, and of `solve_ivp` on a few of its paths.

    Parameters
    ----------
    diamonds : ndarray (n, 4)
        From `random_diamonds`.
    checked : int
        Yielding paths drawn for the errors.
    paths : int
        Yielding paths given to `solve_ivp`, the checked ones first.
    seed : int
        Seed of the draw.
    repeats : int
        Timed sweeps; the time is their median.

    Returns
    -------
    end : DrainedEnd
        Ends of all paths.
    rows : list of dict
        `method, paths, seconds, paths_per_second`; of the checked ones `not_found`, and
        `error_median, error_max` of the largest of `E1`, `E2`, `s1`.
    """
    end, seconds = _timed_sweep(diamonds, repeats)
    yielding = np.flatnonzero(end.status == "yield")
    picked = np.random.default_rng(seed).permutation(yielding)[:paths]
    state, sure = end.state, picked[:checked]
    guesses = zip(sure, state.alpha[sure].tolist(), end.direction[sure].astype(int), strict=True)
    exact = np.array([exact_point_b(_row(diamonds[k]), a, int(s)) for k, a, s in guesses])
    ours = np.stack([state.E1, state.E2, state.s1], axis=-1)[sure]
    rows = [_method(EXACT, len(diamonds), seconds, ours, exact)]
    for name, (method, rtol) in PER_PATH.items():
        start = time.perf_counter()
        found = [point_b_by_steps(_row(diamonds[k]), method, rtol) for k in picked]
        elapsed = time.perf_counter() - start
        reached = [(np.nan,) * 3 if B is None else tuple(B) for B in found[: len(sure)]]
        rows.append(_method(name, len(picked), elapsed, np.array(reached), exact))
    return end, rows


def _timed_sweep(diamonds: Floats, repeats: int) -> tuple[DrainedEnd, float]:
    seconds = []
    for _ in range(repeats):
        start = time.perf_counter()
        end = drained_end(*diamonds.T)
        seconds.append(time.perf_counter() - start)
    return end, float(np.median(seconds))


def _row(diamond: Floats) -> Row:
    alpha0, kappa, phi, confinement = diamond.tolist()
    return alpha0, kappa, phi, confinement


def _method(name: str, paths: int, seconds: float, found: Floats, exact: Floats) -> dict[str, Any]:
    errors = np.abs(found - exact).max(axis=-1)
    reached = errors[np.isfinite(errors)]
    return {
        "method": name,
        "paths": paths,
        "seconds": seconds,
        "paths_per_second": paths / seconds,
        "not_found": int(errors.size - reached.size),
        "error_median": float(np.median(reached)),
        "error_max": float(reached.max()),
    }
