"""The table of losses: one row a programme, contacts and determinant."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd

from loops.arrays import Floats
from patterns.diamond import determinant_elastic, determinant_sliding, opposite_gaps
from patterns.diamond.strain_lines import LineStates, line_states
from patterns.diamond.tangents import geometric_asymmetry, material_asymmetry
from studies.domain.losses import Losses, first_losses
from studies.domain.parameters import Case

KINDS = ("det_Ks_zero", "det_K_zero")
# Opposite grains nearer than this, in reference branches, touch within rounding.
TOUCHING = 1e-14


def domain_table(cases: tuple[Case, ...], directions: int) -> pd.DataFrame:
    """Losses of every diamond along its fan, with contacts that stick and with friction."""
    parts = []
    for case in cases:
        for friction in (False, True) if np.isfinite(case.mu) else (False,):
            losses = first_losses(case, directions, friction=friction)
            parts += [_rows(case, losses, kind) for kind in KINDS]
    return pd.concat(parts, ignore_index=True)


def rows_of(table: pd.DataFrame, case: Case) -> pd.DataFrame:
    """The rows of one diamond."""
    named = case.described()
    return table[(table[list(named)] == list(named.values())).all(axis=1)]


def _rows(case: Case, losses: Losses, kind: str) -> pd.DataFrame:
    u = getattr(losses, kind)
    found = np.isfinite(u)
    line, sliding = losses.line.take(found), losses.by_yielding(u)[found]
    state = line_states(line, u[found], case.kappa, losses.mu)
    det_K, asymmetry = _determinant_and_asymmetry(case, state, np.where(sliding, line.sense, 0.0))
    gaps = np.minimum(*opposite_gaps(state.E1, state.E2, case.alpha0))
    columns: dict[str, Any] = {
        **case.described(),
        "contacts": "frictional" if np.isfinite(losses.mu) else "sticking",
        "kind": kind,
        "programme_deg": np.degrees(losses.programme[found]),
        "regime": np.where(sliding, "sliding", "elastic"),
        "E1": state.E1,
        "E2": state.E2,
        "s1": state.s1,
        "s2": state.s2,
        "N": state.N,
        "T": state.T,
        "alpha_deg": np.degrees(state.alpha),
        "det_K": det_K,
        "det_Ks": det_K - (0.5 * asymmetry) ** 2,
        "opposite_overlap": gaps < -TOUCHING,
    }
    return pd.DataFrame(columns)


def _determinant_and_asymmetry(
    case: Case, state: LineStates, slides: Floats
) -> tuple[Floats, Floats]:
    """`det K` and `K12 - K21` (29) to (36), `slides` the sign of T of sliding contacts, else 0."""
    measures = (state.E1, state.E2, state.s1, state.s2, state.alpha)
    s, mu = np.where(slides == 0.0, 1.0, slides), case.mu if np.isfinite(case.mu) else 0.0
    elastic = determinant_elastic(*measures, case.kappa)
    sliding = determinant_sliding(*measures, mu, s)
    material = np.where(slides == 0.0, 0.0, material_asymmetry(mu, s))
    det_K = np.where(slides == 0.0, elastic, sliding)
    return det_K, material + geometric_asymmetry(*measures)
