"""The study behind `grainloops domain`: table, summary and figure of bifurcation domains."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from patterns.diamond import (
    critical_strain,
    determinant_elastic,
    determinant_sliding,
    opposite_gaps,
)
from patterns.diamond.strain_lines import line_states
from patterns.diamond.tangents import geometric_asymmetry, material_asymmetry
from studies.columns import definitions
from studies.domain.losses import Case, DomainParameters, Losses, first_losses, rows_of
from studies.study import study

UNITS = "dimensionless: forces over kn l0, stresses over kn; angles in degrees"
LOSSES = ("det_Ks_zero", "det_K_zero")
# Opposite grains nearer than this, in reference branches, touch within rounding.
OVERLAP_ATOL = 1e-14


def domain_table(cases: tuple[Case, ...], directions: int) -> pd.DataFrame:
    """Losses of every diamond along its fan, with contacts that stick and with friction."""
    parts = []
    for case in cases:
        for friction in (False, True) if np.isfinite(case.mu) else (False,):
            losses = first_losses(case, directions, friction=friction)
            parts += [loss_table(case, losses, kind) for kind in LOSSES]
    return pd.concat(parts, ignore_index=True)


def loss_table(case: Case, losses: Losses, kind: str) -> pd.DataFrame:
    """One row for each programme with a loss of this kind: its state and determinants."""
    u = getattr(losses, kind)
    found = np.isfinite(u)
    line, sliding = losses.line.take(found), (u == losses.yields)[found]
    state = line_states(line, u[found], case.kappa, losses.mu)
    # (29) to (36); `line.sense` is the sign of T.
    measures = (state.E1, state.E2, state.s1, state.s2, state.alpha)
    sign, mu = np.where(sliding, line.sense, 1.0), case.mu if np.isfinite(case.mu) else 0.0
    elastic, slipping = (
        determinant_elastic(*measures, case.kappa),
        determinant_sliding(*measures, mu, sign),
    )
    det_K = np.where(sliding, slipping, elastic)
    asymmetry = np.where(sliding, material_asymmetry(mu, sign), 0.0) + geometric_asymmetry(
        *measures
    )
    gaps = np.minimum(*opposite_gaps(state.E1, state.E2, case.alpha0))
    columns: dict[str, Any] = {
        **case.described(),
        "contacts": "frictional" if np.isfinite(losses.mu) else "sticking",
        "kind": kind,
        "programme_deg": np.degrees(losses.programme[found]),
        "regime": np.where(sliding, "sliding", "elastic"),
        **{name: getattr(state, name) for name in ("E1", "E2", "s1", "s2", "N", "T")},
        "alpha_deg": np.degrees(state.alpha),
        "det_K": det_K,
        "det_Ks": det_K - (0.5 * asymmetry) ** 2,
        "opposite_overlap": gaps < -OVERLAP_ATOL,
    }
    return pd.DataFrame(columns)


def run_domain(
    parameters: DomainParameters, out: Path, *, force: bool = False, csv: bool = False
) -> dict[str, Any]:
    """Find the bifurcation domains of diamonds, and write the table, summary and figure."""
    with study("domain", out, parameters.described(), UNITS, force=force, csv=csv) as results:
        table = domain_table(parameters.cases(), parameters.directions)
        results.write_tables({"domain": table})
        summary = results.write_summary(domain_summary(table, parameters))
        # matplotlib is loaded only when there is something to draw.
        from studies.domain.figures import domain_figure

        results.save_figures([("domain", domain_figure(table, parameters.cases()))])
    return summary


def domain_summary(table: pd.DataFrame, parameters: DomainParameters) -> dict[str, Any]:
    """Counts and bounds of each diamond's domain."""
    return {
        "directions": parameters.directions,
        "cases": [
            {
                **case.described(),
                "isotropic_strain": float(critical_strain(case.kappa)),
                "contacts": {
                    str(name): _contacts(own)
                    for name, own in rows_of(table, case).groupby("contacts")
                },
            }
            for case in parameters.cases()
        ],
        "definitions": definitions("domain"),
    }


def _contacts(table: pd.DataFrame) -> dict[str, Any]:
    first, last = (table[table.kind == kind].set_index("programme_deg") for kind in LOSSES)
    # Along one programme the strains grow in proportion.
    size = [np.hypot(own.E1, own.E2) for own in (first, last)]
    return {
        "det_Ks_zero": len(first),
        "det_K_zero": len(last),
        "by_yielding": int((first.regime == "sliding").sum()),
        "opposite_overlap": int(first.opposite_overlap.sum()),
        "det_Ks_first": len(first) - int((size[0] >= size[1].reindex(size[0].index)).sum()),
        "s1": [float(first.s1.min()), float(first.s1.max())],
        "s2": [float(first.s2.min()), float(first.s2.max())],
    }
