"""Which model the diamond's path took: the paper's two freedoms, or all eight as a check."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import numpy as np

from loops import InputError, LinearFrictional
from patterns import diamond
from stability import Path, Stage, programmes
from stability import follow as follow_graph
from studies.diamond.parameters import DiamondParameters
from studies.diamond.path import NAMED, DiamondPath

SMALLEST = {
    "choice": "auto",
    "symmetry": "D2 (order 4)",
    "freedoms": "2 of 8",
    "spins": "none: blocked",
    "unknowns": "none: closed forms",
    "contact_orbits": "1 of 4",
    "branch_search": "skipped: the four contacts yield as one",
    "branch_solves": 0,
    "kernels": "plain",
    "kept": "to the end",
}


def check_model(parameters: DiamondParameters) -> None:
    """Refuse what the full model can't do.

    Parameters
    ----------
    parameters : DiamondParameters
        What is asked.

    Raises
    ------
    InputError
        If the full model is asked to slide by the printed rule.
    """
    if parameters.model == "full" and parameters.sliding == "printed":
        expected = "coulomb: grains free to move slide by Coulomb's law"
        raise InputError("--sliding", "printed with --model full", expected, "Drop one of them.")


def model_summary(path: DiamondPath) -> dict[str, Any]:
    """The model in words; with all freedoms asked for, how far they lie from the closed forms.

    Parameters
    ----------
    path : DiamondPath
        From `follow`; its states are those of the paper's diamond in either case.

    Returns
    -------
    dict
        See `stability.paths.record.ModelChoice`; `check` is null unless the full model was asked
        for: its `status`, `rows`, and `differences`, the largest in E1, E2, s1, s2 at I, A and B.
    """
    if path.parameters.model == "auto":
        return {**SMALLEST, "check": None}
    full = full_path(path)
    check = {
        "status": full.status,
        "rows": len(full),
        "differences": {
            name: _difference(path, full, kind, name)
            for kind, name in NAMED.items()
            if name in path.marks and full.of_kind(kind)  # type: ignore[arg-type]
        },
    }
    return {**asdict(full.model), "check": check}


def full_path(path: DiamondPath) -> Path:
    """The same programme followed by four grains free to move, without any symmetry.

    Parameters
    ----------
    path : DiamondPath
        From `follow`.

    Returns
    -------
    stability.Path
    """
    loop, asked = path.loop, path.parameters
    law = LinearFrictional(kn=1.0, kt=loop.kappa, mu=loop.mu)
    stages = []
    if loop.confinement > 0.0:
        stages.append(Stage(programmes.isotropic_strain(), "H11", loop.confinement))
    end = float(path.states.E1.max())
    if end > loop.confinement:
        stages.append(Stage(programmes.drained_biaxial(), "H11", end))
    return follow_graph(
        diamond(loop.alpha0),
        law,
        stages,
        closure=asked.closure,
        volume=2.0 * np.sin(2.0 * loop.alpha0),
        contact_on_touch=asked.contact_on_touch,
        model="full",
    )


def _difference(path: DiamondPath, full: Path, kind: str, name: str) -> float:
    row, states = path.marks[name], path.states
    event = full.of_kind(kind)[0]  # type: ignore[arg-type]
    ours = np.array([values[row] for values in (states.E1, states.E2, states.s1, states.s2)])
    theirs = np.concatenate([full.H[event.index, [0, 3]], full.P[event.index, [0, 3]]])
    return float(np.abs(ours - theirs).max())
