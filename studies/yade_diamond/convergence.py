"""Yade's error against Yade's step, on one probe run with three steps."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from patterns.diamond.strain_lines import half_diagonals, line_states, strain_line
from studies.yade_diamond.probes import KAPPA, UNIT, read_table
from studies.yade_diamond.replay import replayed_shear


def convergence_rows(folder: Path) -> list[dict[str, Any]]:
    """Relative errors of Yade's last record, for each number of steps.

    Parameters
    ----------
    folder : Path
        Holds `convergence.csv`: sticking contacts, the paper's increment.

    Returns
    -------
    list of dict
        `steps`; `error_F1, error_F2, error_N, error_T` against the closed form; `replay_T` of
        Yade's rule replayed.

    Examples
    --------
    >>> from patterns import sample_path
    >>> rows = convergence_rows(sample_path("yade_diamond"))
    >>> [(row["steps"], f"{row['error_T']:.1e}") for row in rows]
    [(500, '2.0e-03'), (5000, '2.0e-04'), (50000, '2.0e-05')]
    """
    return [_row(record) for record in read_table(folder / "convergence.csv").to_dict("records")]


def _row(record: dict[str, Any]) -> dict[str, Any]:
    alpha0, E0, steps = np.radians(record["a0_deg"]), record["E0"], int(record["n_probe_steps"])
    line = strain_line(alpha0, E0, E0, np.radians(record["probe_deg"]))
    u = half_diagonals(alpha0, record["E1"], record["E2"]) @ line.direction
    exact = line_states(line, u, KAPPA)
    replayed = replayed_shear(line, float(u - line.start), steps, np.inf, "branch")[-1]
    pairs = {
        "F1": (record["Fx_right"], 2.0 * np.sin(alpha0) * exact.s1),
        "F2": (record["Fy_top"], 2.0 * np.cos(alpha0) * exact.s2),
        "N": (record["Fn_RT"], exact.N),
        "T": (record["Fs_RT"], exact.T),
    }
    errors = {f"error_{name}": float(abs(y / UNIT / x - 1.0)) for name, (y, x) in pairs.items()}
    yade = record["Fs_RT"] / UNIT
    return {"steps": steps, **errors, "replay_T": float(abs(replayed / yade - 1.0))}
