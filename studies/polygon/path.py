"""A polygon's path with the losses of stability of every subspace."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from loops import InputError
from stability import Event, Path, follow
from stability.programmes import isotropic_strain
from studies.polygon.parameters import SUBSPACES, PolygonParameters

Floats = NDArray[np.float64]

# Longest steps to try, the first one that of `follow`.
LONGEST_STEPS = (0.05, 0.043, 0.037, 0.031)
# Below this strain the loop is singular as it stands, and no step helps.
UNLOADED = 1e-6
ISOTROPIC = isotropic_strain().name
# A path of so many steps is given up, and said to be lost.
MOST_STEPS = 2000
SPECTRAL = ("det_Ks_zero", "det_K_zero", "flutter")


@dataclass(frozen=True, eq=False)
class PolygonPath:
    """A path, followed once a subspace: the states are the same, the spectral events are not.

    Attributes
    ----------
    parameters : PolygonParameters
        What was asked.
    paths : dict of str to Path
        By subspace; 'diagonal' is the one that is tabled.
    """

    parameters: PolygonParameters
    paths: dict[str, Path]

    @property
    def path(self) -> Path:
        """The tabled path."""
        return self.paths["diagonal"]

    @property
    def stage_names(self) -> list[str]:
        """Name of every stage."""
        first = ["confinement"] if self.parameters.confine > 0.0 else []
        return [*first, self.parameters.programme]

    @property
    def loading(self) -> NDArray[np.int64]:
        """Rows of the programme that follows the confinement."""
        return np.flatnonzero(self.path.stage == len(self.stage_names) - 1)

    @property
    def marks(self) -> dict[str, int]:
        """Rows of A, the confined state, and of the end."""
        confined = np.flatnonzero(self.path.stage == 0)
        at_A = {"A": int(confined[-1])} if len(self.stage_names) > 1 and len(confined) else {}
        return {**at_A, "end": len(self.path) - 1}


def follow_polygon(
    parameters: PolygonParameters, subspaces: tuple[str, ...] = SUBSPACES
) -> PolygonPath:
    """Confine a polygon and load it.

    Parameters
    ----------
    parameters : PolygonParameters
        Loop and programme.
    subspaces : tuple of str
        Where spectra are watched; 'diagonal' among them.

    Returns
    -------
    PolygonPath

    Examples
    --------
    >>> from studies.polygon import PolygonParameters
    >>> found = follow_polygon(PolygonParameters(4, confine=0.2, end=0.25))
    >>> [(event["kind"], event["subspace"]) for event in found_events(found)][:3]
    [('det_Ks_zero', 'diagonal'), ('det_K_zero', 'diagonal'), ('det_Ks_zero', 'symmetric')]
    """
    paths = {subspace: _followed(parameters, subspace) for subspace in subspaces}
    return PolygonPath(parameters, paths)


def _followed(parameters: PolygonParameters, subspace: str) -> Path:
    """The path; where it sticks at a singular state under isotropic strain, with other steps.

    At the threshold the relaxed grains' balance is singular on the whole, and a step that lands
    there finds no direction, or no event; one across it does.
    """
    best: Path | None = None
    for longest in LONGEST_STEPS:
        path = _attempt(parameters, subspace, longest)
        if path is None:
            continue
        best = path
        stage = parameters.stages()[int(path.stage[-1])]
        elsewhere = stage.programme.name != ISOTROPIC or path.H[-1, 0] < UNLOADED
        if path.status != "control_limit" or elsewhere:
            break
    if best is None:
        raise InputError(
            "the path",
            "a loss of stability that can't be located",
            "a path whose events can be told apart",
            "Change --confine or --end.",
        )
    return best


def _attempt(parameters: PolygonParameters, subspace: str, longest: float) -> Path | None:
    try:
        return follow(
            parameters.loop(),
            parameters.law(),
            parameters.stages(),
            closure=parameters.closure,
            spins=parameters.spins,
            subspace=subspace,
            max_step=longest,
            max_steps=MOST_STEPS,
            model=parameters.model,
        )
    except InputError:
        raise
    except ValueError:
        # The root search of an event met an operator that is not a number.
        return None


def determinants(path: Path) -> tuple[Floats, Floats]:
    """Determinants of K and of Ks; NaN where the tangent is not known.

    Parameters
    ----------
    path : Path
        Its rows.

    Returns
    -------
    det_K, det_Ks : (R,) array
    """
    with np.errstate(invalid="ignore"):
        return path.det_K, path.det_Ks


def found_events(found: PolygonPath) -> list[dict[str, Any]]:
    """Events in the order of the path; spectral ones name their subspace.

    Parameters
    ----------
    found : PolygonPath
        From `follow_polygon`.

    Returns
    -------
    list of dict
        `kind, subspace, E1, E2, s1, s2, stage, parameter, contacts, detail`; `subspace` is null
        where the event depends on none.
    """
    names = found.stage_names
    listed = [
        described(path, event, subspace if event.kind in SPECTRAL else None, names)
        for subspace, path in found.paths.items()
        for event in path.events
        if event.kind in SPECTRAL or subspace == "diagonal"
    ]
    # Sorting is stable: at one parameter the path's own order stays, up to rounding.
    return sorted(listed, key=lambda event: round(event["parameter"], 9))


def described(path: Path, event: Event, subspace: str | None, names: list[str]) -> dict[str, Any]:
    """An event as plain values.

    Parameters
    ----------
    path : Path
        Its path.
    event : Event
        Which.
    subspace : str or None
        Where the spectrum was taken.
    names : list of str
        Names of the stages.

    Returns
    -------
    dict
        See `found_events`.
    """
    row = event.index
    return {
        "kind": event.kind,
        "subspace": subspace,
        "E1": float(path.H[row, 0]),
        "E2": float(path.H[row, 3]),
        "s1": float(path.P[row, 0]),
        "s2": float(path.P[row, 3]),
        "stage": names[event.stage],
        "parameter": event.parameter,
        "contacts": list(event.contacts),
        "detail": event.detail,
    }
