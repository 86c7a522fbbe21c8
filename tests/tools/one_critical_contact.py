"""Count all solutions of 72 strain directions: `python -m tests.tools.one_critical_contact GRAINS`.

The snapshot is held first; its cell is that of `macro.csv` beside it. One contact at yield is left
out so that the others have one solution for every load, which a scaling of them proves; where no
contact does, nothing is counted. Theory, equation (11.17).
"""

import sys
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.linalg import cholesky, eigh
from scipy.optimize import minimize

from patterns import read_snapshot
from stability.packing.complementarity import solve_from
from stability.packing.regime_regions import RegimeRegions
from stability.packing.response import PackingRates
from stability.packing.solution_branch import trace_branch
from studies.snapshot.held import held_snapshot
from studies.snapshot.in_packing import sample_edge

SMOOTHED, EVALUATIONS, TRIED = 0.01, 60, 3


def scaling(M):
    """`x` for which the smallest eigenvalue of the symmetric part of `e^x M e^-x` is large."""

    def smooth_least(x):
        scaled = np.exp(x)[:, None] * M * np.exp(-x)
        values, V = eigh(scaled + scaled.T)
        share = np.exp((values[0] - values) / SMOOTHED)
        slope = 2.0 * np.sum(V * (scaled @ V - scaled.T @ V) * share, axis=1) / share.sum()
        return SMOOTHED * np.log(share.sum()) - values[0], -slope

    options = {"maxfun": EVALUATIONS}
    found = minimize(smooth_least, np.zeros(len(M)), jac=True, method="L-BFGS-B", options=options)
    return np.exp(found.x)


def is_definite(M):
    """Whether the symmetric part is positive definite."""
    try:
        cholesky(M + M.T)
    except np.linalg.LinAlgError:
        return False
    return True


def critical_contact(M):
    """A contact without which the others have one solution, if one is found; None."""
    scale = scaling(M)
    scaled = scale[:, None] * M / scale
    vector = eigh(scaled + scaled.T, subset_by_index=[0, 0])[1][:, 0]
    for k in np.argsort(-np.abs(vector))[:TRIED]:
        rest = np.arange(len(M)) != k
        block = M[np.ix_(rest, rest)]
        own = scaling(block)
        if is_definite(own[:, None] * block / own):
            return int(k)
    return None


def solutions(q, M, k):
    """Number of solutions, all counted; `k` is the critical contact."""
    rest = np.arange(len(q)) != k
    block, lines = M[np.ix_(rest, rest)], np.column_stack([q[rest], M[rest, k]])
    start = solve_from(q[rest], block, np.zeros(len(block), dtype=bool))
    branch = trace_branch(lines, block, 0.0, start)
    if not branch.closed or branch.winding != 1:
        raise RuntimeError("the branch of the other contacts did not close")
    count = 0
    for (begin, end), slides in zip(branch.angle, branch.sliding, strict=True):
        slip = -np.linalg.solve(block[np.ix_(slides, slides)], lines[slides])
        rate = np.array([q[k], M[k, k]]) + M[k, rest][slides] @ slip
        first = begin % (2.0 * np.pi)
        for turn in (0.0, -2.0 * np.pi):
            low, high = max(first + turn, 0.0), min(first + turn + end - begin, 0.5 * np.pi)
            if high - low > 1e-13:
                a, b = rate @ [np.cos(low), np.sin(low)], rate @ [np.cos(high), np.sin(high)]
                count += (a * b < 0) + (low == 0.0 and a >= 0)
    return count


def main(grains):
    """Print how many directions have how many solutions."""
    path = Path(grains)
    number = int("".join(c for c in path.name if c.isdigit())[:2])
    cells = pd.read_csv(path.with_name("macro.csv")).set_index("snap")
    cell = cells.loc[number, ["h_xx", "h_xy", "h_yx", "h_yy"]].to_numpy(float).reshape(2, 2)
    at_rest, _ = held_snapshot(read_snapshot(path, cell=cell), "strain")
    rates = PackingRates(sample_edge(at_rest, 0.99))
    Q, M = RegimeRegions(rates, "strain", "diagonal", 1).circle
    k = critical_contact(M)
    if k is None:
        print(f"{len(M)} contacts at yield: no single one is enough")
        return
    angles = np.radians(np.arange(0.0, 360.0, 5.0))
    counts = [solutions(Q @ [np.cos(a), np.sin(a)], M, k) for a in angles]
    print(f"{len(M)} contacts at yield, critical {k}; directions by solutions", np.bincount(counts))


if __name__ == "__main__":
    main(*sys.argv[1:])
