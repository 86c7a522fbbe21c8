"""The path of a diamond: its states, operators, events and the table of all."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from patterns.diamond import DiamondParameters as LoopParameters
from patterns.diamond import opposite_gaps
from stability import plane_cone, spectrum, statuses, symmetric_spectrum
from stability.cones import PlaneCone
from stability.spectra import operator_norm
from studies.diamond.events import Event, isotropic_events
from studies.diamond.parameters import DiamondParameters
from studies.diamond.states import Operators, States, isotropic_states, operators

Floats = NDArray[np.float64]
# Rows of a stage, but for those that events add.
STEPS = 200


@dataclass(frozen=True, eq=False)
class DiamondPath:
    """A diamond followed along its programme.

    Attributes
    ----------
    parameters : DiamondParameters
        What was asked.
    loop : patterns.diamond.DiamondParameters
        The diamond.
    states : States
        States in path order; every event is one of them.
    operators : Operators
        Tangents there.
    events : list of Event
        In path order.
    marks : dict of str to int
        Rows of the named states, 'I' (det K = 0) and 'A' (end of the confinement), where reached.
    """

    parameters: DiamondParameters
    loop: LoopParameters
    states: States
    operators: Operators
    events: list[Event]
    marks: dict[str, int]


def follow(parameters: DiamondParameters) -> DiamondPath:
    """Follow a diamond under isotropic strain up to A.

    Parameters
    ----------
    parameters : DiamondParameters
        What is asked.

    Returns
    -------
    DiamondPath

    Examples
    --------
    >>> from studies.diamond import DiamondParameters
    >>> from studies.diamond.path import follow
    >>> path = follow(DiamondParameters(table=1))
    >>> {name: round(float(path.states.E1[row]), 6) for name, row in path.marks.items()}
    {'I': 0.166667, 'A': 0.3}
    """
    loop = parameters.loop()
    events = isotropic_events(loop, parameters.contact_on_touch)
    E = _strains(np.array([event.E for event in events]))
    states = isotropic_states(loop, E)
    named = {"det_K_zero": "I", "programme_change": "A"}
    marks = {
        named[event.kind]: int(np.searchsorted(E, event.E))
        for event in events
        if event.kind in named
    }
    return DiamondPath(parameters, loop, states, operators(loop, states), events, marks)


def _strains(events: Floats) -> Floats:
    """Strains from zero to the last event, every event's own among them and no twin beside it."""
    grid = np.linspace(0.0, events[-1], STEPS + 1)
    apart = np.abs(grid[:, None] - events).min(axis=1) > 1e-3 * (grid[1] - grid[0])
    return np.unique(np.concatenate([[0.0], grid[apart], events]))


def closed_cone(K: Floats) -> PlaneCone:
    """Instability cones; one that closes within the tolerance is a single direction.

    Parameters
    ----------
    K : ndarray (..., 2, 2)
        Tangents.

    Returns
    -------
    PlaneCone
        With opening 0 and both edges on the axis where the status is 'ray'.
    """
    cone = plane_cone(K)
    ray = cone.status == "ray"
    return PlaneCone(
        status=cone.status,
        opening=np.where(ray, 0.0, cone.opening),
        axis=cone.axis,
        edges=np.where(ray[..., None], cone.axis[..., None], cone.edges),
    )


def path_table(path: DiamondPath) -> dict[str, NDArray[Any]]:
    """Table of a path, one row a state.

    Parameters
    ----------
    path : DiamondPath
        From `follow`.

    Returns
    -------
    dict of str to array
        `stage, regime`; `E1, E2, alpha_deg, l, N, T, s1, s2`; `K11..K22`, `Kmat11..Kmat22`,
        `Kgeo11..Kgeo22`; `det_K, det_Ks`; `lambda_1, lambda_2`, eigenvalues of Ks ascending;
        `eigenvalue_1_real ..`, those of K; `status` of the second-order work; the cone, angles
        from E1 towards E2; `gap_1, gap_2`, gaps between opposite grains over `l0`.
    """
    states, found = path.states, path.operators
    gap1, gap2 = opposite_gaps(states.E1, states.E2, path.loop.alpha0)
    return {
        "stage": states.stage,
        "regime": states.regime,
        "E1": states.E1,
        "E2": states.E2,
        "alpha_deg": np.degrees(states.alpha),
        "l": states.length,
        "N": states.N,
        "T": states.T,
        "s1": states.s1,
        "s2": states.s2,
        **_components("K", found.K),
        **_components("Kmat", found.material),
        **_components("Kgeo", found.geometric),
        "det_K": found.det_K,
        "det_Ks": found.det_Ks,
        **_spectra(found.K),
        **_cones(found.K),
        "gap_1": gap1,
        "gap_2": gap2,
    }


def _components(name: str, K: Floats) -> dict[str, Floats]:
    return {f"{name}{i + 1}{j + 1}": K[:, i, j] for i in range(2) for j in range(2)}


def _spectra(K: Floats) -> dict[str, NDArray[Any]]:
    values, symmetric = spectrum(K), symmetric_spectrum(K)
    return {
        "lambda_1": symmetric[:, 0],
        "lambda_2": symmetric[:, 1],
        "eigenvalue_1_real": values[:, 0].real,
        "eigenvalue_1_imag": values[:, 0].imag,
        "eigenvalue_2_real": values[:, 1].real,
        "eigenvalue_2_imag": values[:, 1].imag,
        "status": statuses(symmetric[:, 0], operator_norm(K)),
    }


def _cones(K: Floats) -> dict[str, NDArray[Any]]:
    cone = closed_cone(K)
    return {
        "cone_status": cone.status,
        "cone_edge_1_deg": np.degrees(cone.edges[:, 0]),
        "cone_edge_2_deg": np.degrees(cone.edges[:, 1]),
        "cone_axis_deg": np.degrees(cone.axis),
        "cone_opening_deg": np.degrees(cone.opening),
        "unstable_fraction": cone.opening / np.pi,
    }
