"""From diamonds to the table, the summary and the figure of their bifurcation domains."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from patterns.diamond import critical_strain
from studies.domain.parameters import Case, DomainParameters
from studies.domain.table import KINDS, domain_table, rows_of
from studies.output import provenance, result_folder, write_summary, write_table

UNITS = "dimensionless: forces over kn l0, stresses over kn; angles in degrees"


def run_domain(
    parameters: DomainParameters, out: Path, *, force: bool = False, csv: bool = False
) -> dict[str, Any]:
    """Find the bifurcation domains of diamonds, and write the table, summary and figure."""
    with result_folder(out, force=force) as folder:
        made = provenance("domain", parameters.described(), UNITS)
        table = domain_table(parameters.cases(), parameters.directions)
        summary = {**domain_summary(table, parameters), "provenance": made}
        write_table(folder, "domain", dict(table.items()), made, csv=csv)
        write_summary(folder, summary)
        # Drawing is loaded only when there is something to draw.
        from studies.domain.figures import draw_figure

        draw_figure(table, parameters.cases(), folder, made)
    return summary


def domain_summary(table: pd.DataFrame, parameters: DomainParameters) -> dict[str, Any]:
    """Counts and bounds of each diamond's domain."""
    return {
        "directions": parameters.directions,
        "cases": [_case(table, case) for case in parameters.cases()],
        "definitions": {
            "programmes": "straight lines in (E1, E2) from the virgin loop, each at the angle "
            "programme_deg; all that compress it",
            "sticking": "contacts never slide",
            "frictional": "contacts slide at |T| = mu N; both determinants are then negative",
        },
    }


def _case(table: pd.DataFrame, case: Case) -> dict[str, Any]:
    groups = rows_of(table, case).groupby("contacts")
    return {
        **case.described(),
        "isotropic_strain": float(critical_strain(case.kappa)),
        "contacts": {str(name): _contacts(own) for name, own in groups},
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
