"""Polar data of the second-order work at the named states of a path."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from patterns.diamond import DiamondParameters as LoopParameters
from stability import RTOL, PolarDiagram, normalised_second_order_work, polar_diagram
from stability.spectra import operator_norm
from studies.diamond.operators import operators
from studies.diamond.parameters import Sliding
from studies.diamond.path import DiamondPath, beyond_yield
from studies.diamond.pieces import normal_and_shear_rates
from studies.diamond.states import States

Floats = NDArray[np.float64]
DIRECTIONS = 720
RADIUS = 2.0


def settled_diagram(K: Floats) -> PolarDiagram:
    """Polar diagrams with `w2 = 0` along directions that K annuls within the tolerance.

    Where det K vanishes, round-off alone decides the sign of w2 in the kernel of K.

    Parameters
    ----------
    K : ndarray (..., 2, 2)
        Tangents.

    Returns
    -------
    PolarDiagram
        Of `DIRECTIONS` directions and radius 2.

    Examples
    --------
    >>> import numpy as np
    >>> from studies.diamond.polar import settled_diagram
    >>> diagram = settled_diagram(np.array([[1.0 + 2e-16, 1.0], [1.0, 1.0]]))
    >>> float(diagram.work.min())
    0.0
    """
    diagram = polar_diagram(K, r=RADIUS, directions=DIRECTIONS)
    stress = np.einsum("...ij,nj->...ni", K, diagram.direction)
    annulled = np.linalg.norm(stress, axis=-1) <= RTOL * operator_norm(K)[..., None]
    return _with_work(diagram, np.where(annulled, 0.0, diagram.work))


def activated_slip(
    loop: LoopParameters, at_yield: States, sliding: Sliding, direction: Floats
) -> Floats:
    """Slip that each strain direction activates in contacts that stand at yield.

    The contacts slide where elastic rates would leave Coulomb's cone, else they stick.

    Parameters
    ----------
    loop : patterns.diamond.DiamondParameters
        The diamond.
    at_yield : States
        One state, `|T| = mu N`.
    sliding : {'coulomb', 'printed'}
        Rule of sliding contacts.
    direction : ndarray (n, 2)
        Strain rates `(E1', E2')`.

    Returns
    -------
    ndarray (n,)
        Slip sign of each direction (see `States`), 0 where the contacts stick.
    """
    states = at_yield.take(np.zeros(len(direction), dtype=np.intp))
    normal, arc = normal_and_shear_rates(loop, states, direction[:, 0], direction[:, 1])
    s = np.sign(states.T)
    slides = s * loop.kappa * arc > loop.mu * normal
    rule = s if sliding == "coulomb" else np.sign(normal) * np.sign(arc)
    return np.where(slides, rule, 0.0)


def yield_diagram(path: DiamondPath) -> tuple[PolarDiagram, Floats]:
    """Polar diagram at B, every direction with the regime it activates.

    Parameters
    ----------
    path : DiamondPath
        From `follow`, with B.

    Returns
    -------
    diagram : PolarDiagram
        Of `DIRECTIONS` directions and radius 2.
    slip : ndarray (DIRECTIONS,)
        From `activated_slip`.
    """
    row = path.marks["B"]
    at_B, elastic = path.states.take([row]), path.operators.K[row]
    diagram = polar_diagram(elastic, r=RADIUS, directions=DIRECTIONS)
    slip = activated_slip(path.loop, at_B, path.parameters.sliding, diagram.direction)
    work = diagram.work.copy()
    for sign in (-1.0, 1.0):
        chosen = slip == sign
        if chosen.any():
            K = operators(path.loop, _sliding(at_B, sign)).K[0]
            work[chosen] = normalised_second_order_work(K, diagram.direction[chosen])
    return _with_work(diagram, work), slip


def polar_table(path: DiamondPath) -> dict[str, Any]:
    """Normalised second-order work in every direction at the named states (45).

    Parameters
    ----------
    path : DiamondPath
        From `follow`.

    Returns
    -------
    dict of str to array
        `state`; `alphaE_deg`, `tan(alphaE) = E1'/E2'`; `w2`; `x, y`, the points of the polar
        diagram, `(2 + w2) (cos alphaE, sin alphaE)`; `regime` that the direction activates.
    """
    names = list(path.marks)
    diagrams = [state_diagram(path, name) for name in names]
    points = np.concatenate([diagram.points for diagram in diagrams] or [np.zeros((0, 2))])
    angles = [np.degrees(diagram.angle) for diagram in diagrams]
    slip = yield_diagram(path)[1] if "B" in names else np.zeros(DIRECTIONS)
    regimes = [np.where(slip if name == "B" else 0.0, "sliding", "elastic") for name in names]
    regimes = [np.broadcast_to(regime, DIRECTIONS) for regime in regimes]
    return {
        "state": np.repeat(np.array(names, dtype=str), DIRECTIONS),
        "alphaE_deg": np.concatenate([*angles, np.zeros(0)]),
        "w2": np.concatenate([*(diagram.work for diagram in diagrams), np.zeros(0)]),
        "x": points[:, 0],
        "y": points[:, 1],
        "regime": np.concatenate([*regimes, np.zeros(0, dtype=str)]),
    }


def state_diagram(path: DiamondPath, name: str) -> PolarDiagram:
    """Polar diagram at a named state.

    Parameters
    ----------
    path : DiamondPath
        From `follow`.
    name : {'I', 'A', 'B'}
        Which state.

    Returns
    -------
    PolarDiagram
    """
    if name == "B":
        return yield_diagram(path)[0]
    return settled_diagram(path.operators.K[path.marks[name]])


def diagram_beyond_yield(path: DiamondPath) -> PolarDiagram | None:
    """Polar diagram at B with sliding contacts in all directions, as beyond B.

    Parameters
    ----------
    path : DiamondPath
        From `follow`.

    Returns
    -------
    PolarDiagram or None
        None where the path has no B.
    """
    states = beyond_yield(path)
    return None if states is None else settled_diagram(operators(path.loop, states).K[0])


def _sliding(state: States, sign: float) -> States:
    return replace(state, slip=np.array([sign]))


def _with_work(diagram: PolarDiagram, work: Floats) -> PolarDiagram:
    outward = np.stack([np.cos(diagram.angle), np.sin(diagram.angle)], axis=-1)
    points = (RADIUS + work)[..., None] * outward
    return PolarDiagram(diagram.angle, diagram.direction, work, points)
