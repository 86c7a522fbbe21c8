"""From diamonds to the table, the summary and the figure of their bifurcation domains."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from loops.arrays import Floats
from patterns.diamond import (
    critical_strain,
    determinant_elastic,
    determinant_sliding,
    opposite_gaps,
)
from patterns.diamond.strain_lines import LineStates, line_states
from patterns.diamond.tangents import geometric_asymmetry, material_asymmetry
from studies.columns import definitions
from studies.domain.losses import Losses, first_losses
from studies.domain.parameters import Case, DomainParameters, rows_of
from studies.output import provenance, result_folder, write_results

UNITS = "dimensionless: forces over kn l0, stresses over kn; angles in degrees"
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
        **{name: getattr(state, name) for name in ("E1", "E2", "s1", "s2", "N", "T")},
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


def run_domain(
    parameters: DomainParameters, out: Path, *, force: bool = False, csv: bool = False
) -> dict[str, Any]:
    """Find the bifurcation domains of diamonds, and write the table, summary and figure."""
    with result_folder(out, force=force) as folder:
        made = provenance("domain", parameters.described(), UNITS)
        table = domain_table(parameters.cases(), parameters.directions)
        summary = {**domain_summary(table, parameters), "provenance": made}
        write_results(folder, summary, {"domain": dict(table.items())}, csv=csv)
        # Drawing is loaded only when there is something to draw.
        from studies.domain.figures import domain_figure
        from studies.style import save_figures

        save_figures({"domain": domain_figure(table, parameters.cases())}, folder, made)
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
    first, last = (table[table.kind == kind].set_index("programme_deg") for kind in KINDS)
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
