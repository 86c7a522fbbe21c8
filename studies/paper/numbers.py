"""The numbers of the page, from runs of the diamond study under both tables."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from stability import spectrum, symmetric_spectrum
from studies.diamond.added_contact import added_summary
from studies.diamond.operators import operators
from studies.diamond.parameters import DiamondParameters
from studies.diamond.path import DiamondPath, beyond_yield, follow
from studies.diamond.path_dependence import path_dependence_table
from studies.diamond.sliding_rules import rules_summary
from studies.diamond.table import path_table
from studies.diamond.verification import slope_at_A, verification
from studies.paper.equations import equation_residuals
from studies.paper.tangent_equations import appendix_one

Rows = dict[str, NDArray[Any]]
# E1, E2, s1 at B to 20 digits: quadrature of the exact path in 50-digit arithmetic.
POINT_B = {
    1: ("0.40973434897033423289", "0.164934999828385506", "0.25400990008305293503"),
    2: ("0.41619122318013548716", "-0.072382919123994869769", "0.31215593602737202138"),
}
STATE_VALUES = ("E1", "E2", "alpha_deg", "N", "T", "s1", "s2", "det_K", "det_Ks")


def collect() -> dict[str, Any]:
    """Every number of the page.

    Returns
    -------
    dict
        `equations`, largest differences by equation numbers; `appendix_one`; `tables`, by table
        number; `path_dependence`.
    """
    return {
        "equations": equation_residuals(),
        "appendix_one": appendix_one(),
        "tables": {table: table_numbers(table) for table in POINT_B},
        "path_dependence": _path_dependence(),
    }


def table_numbers(table: int) -> dict[str, Any]:
    """Numbers of one table of the paper.

    Parameters
    ----------
    table : {1, 2}
        Which.

    Returns
    -------
    dict
        `states` I, A, B and `beyond` B; `point_B_difference` from the 20-digit values;
        `verification`; `slopes`, of the axial stress; `eigenvalue_gap`, of K and Ks before and
        after B; `loading`, w2 along the path; `rules`; `added`.
    """
    path = follow(DiamondParameters(table=table))
    rows = path_table(path)
    found = verification(path)
    return {
        "states": {name: _state(rows, row) for name, row in path.marks.items()},
        "beyond": _beyond(path),
        "point_B_difference": _difference_at_B(rows, path.marks["B"], table),
        "verification": found,
        "slopes": _slopes(path),
        "eigenvalue_gap": _eigenvalue_gaps(path),
        "loading": _loading(path, rows),
        "opening": _openings(path, rows),
        "events": _event_strains(path),
        "rules": rules_summary(path.parameters),
        "added": {**added_summary(path.parameters), **_added_states(table)},
    }


def _state(rows: Rows, row: int) -> dict[str, float]:
    return {key: float(rows[key][row]) for key in STATE_VALUES}


def _beyond(path: DiamondPath) -> dict[str, float]:
    """Determinants at B with sliding contacts."""
    states = beyond_yield(path)
    assert states is not None
    found = operators(path.loop, states)
    return {"det_K": float(found.det_K[0]), "det_Ks": float(found.det_Ks[0])}


def _difference_at_B(rows: Rows, row: int, table: int) -> float:
    found = [float(rows[key][row]) for key in ("E1", "E2", "s1")]
    return max(abs(a - float(b)) for a, b in zip(found, POINT_B[table], strict=True))


def _slopes(path: DiamondPath) -> dict[str, float]:
    """`ds1/dE1` by (33) after A, before and after B, and the largest of all beyond A."""
    at_A = slope_at_A(path)
    assert at_A is not None
    K = path.operators.K
    with np.errstate(divide="ignore"):
        slope = path.operators.det_K / K[:, 1, 1]
    drained, row = path.states.stage == "drained", path.marks["B"]
    return {
        "at_A": at_A["closed_form"],
        "at_A_differences": at_A["differences"],
        "at_A_difference": at_A["difference"],
        "before_B": float(slope[row]),
        "after_B": float(slope[row + 1]),
        "largest": float(slope[drained].max()),
    }


def _eigenvalue_gaps(path: DiamondPath) -> dict[str, float]:
    """Largest distance of the eigenvalues of K from those of Ks, elastic and sliding."""
    K = path.operators.K
    gap = np.abs(np.sort(spectrum(K).real, axis=1) - symmetric_spectrum(K)).max(axis=1)
    slides = path.states.slip != 0.0
    return {"elastic": float(gap[~slides].max()), "sliding": float(gap[slides].max())}


def _loading(path: DiamondPath, rows: Rows) -> dict[str, float]:
    """Normalised second-order work along the path: isotropic at A, and the largest drained."""
    drained = path.states.stage == "drained"
    work = rows["w2_loading"]
    return {
        "least_isotropic": float(work[~drained].min()),
        "largest_drained": float(work[drained].max()),
    }


def _openings(path: DiamondPath, rows: Rows) -> dict[str, float]:
    """Opening of the instability cone at A, at B and beyond, degrees."""
    opening, row = rows["cone_opening_deg"], path.marks["B"]
    return {
        "A": float(opening[path.marks["A"]]),
        "B": float(opening[row]),
        "beyond": float(opening[row + 1]),
    }


def _event_strains(path: DiamondPath) -> list[tuple[str, float]]:
    return [(event.kind, float(path.states.E1[event.row])) for event in path.events]


def _added_states(table: int) -> dict[str, Any]:
    path = follow(DiamondParameters(table=table, contact_on_touch="add"))
    symmetric = symmetric_spectrum(path.operators.K)
    drained = path.states.stage == "drained"
    s1 = path.states.s1
    return {
        "events": _event_strains(path),
        "least_eigenvalue_drained": float(symmetric[drained, 0].min()),
        "s1_at_A": float(s1[path.marks["A"]]),
        "s1_end": float(s1[-1]),
        "E1_end": float(path.states.E1[-1]),
    }


def _path_dependence() -> dict[str, float]:
    table = path_dependence_table(follow(DiamondParameters(table=1)).loop)
    first, second = table["shear_then_compress"], table["compress_then_shear"]
    return {
        "compression": float(table["compression"][0]),
        "first": float(first[-1]),
        "second": float(second[-1]),
        "ratio": float(first[-1] / second[-1]),
    }
