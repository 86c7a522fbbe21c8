"""March a material point through loading programmes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from loops.arrays import Floats
from loops.errors import InputError, check_type, whole_number
from loops.shown import Shown
from stability.material.blocks import MaterialState
from stability.material.loop_material import LoopMaterial, MaterialResponse
from stability.programmes import Programme, Stage, stages_of

MarchStatus = Literal["finished", "control limit", "loops lost"]
# Newton steps after which a programme has no solution at the end of a step.
MOST_CONTROL_STEPS = 60
# Rounding of a programme's equations: strains, and stresses over the stiffness.
MET = 1e-13
# Isotropic strain tried first where nothing has a stiffness yet.
FIRST = 1e-3
# Largest change of a strain in one Newton step.
LONGEST_STEP = 5e-3


@dataclass(frozen=True, eq=False, repr=False)
class MaterialPath(Shown):
    """Path of one material point, a row a step and one for the start of each stage.

    Attributes
    ----------
    status : {'finished', 'control limit', 'loops lost'}
        The programme was followed to its end; or has no solution from the last row on; or more
        than half of the loops have none.
    stage : (K,) array of int
        Number of the stage.
    H, P : (K, 4) array
        Displacement gradient and nominal stress (force per length), components 11, 12, 21, 22,
        compression positive.
    A : (K, 4, 4) array
        Tangent `P' = A H'`.
    work : (K,) array
        Second-order work of the step that led there, `dP:dH/(|dP||dH|)`; nan where none did.
    regimes : (K, 3) array
        Shares of contacts that stick, slide and are open.
    failed : (K,) array
        Share of the loops without a solution.
    """

    shown = ("status", "H", "P", "work", "failed")
    unitless = ("work",)

    status: MarchStatus
    stage: Any
    H: Floats
    P: Floats
    A: Floats
    work: Floats
    regimes: Floats
    failed: Floats


def march(
    material: LoopMaterial, stages: Sequence[Stage] | Stage, steps: int = 200
) -> MaterialPath:
    """Take one point of a material through stages, each in equal steps.

    Parameters
    ----------
    material : LoopMaterial
        The material.
    stages : Stage or sequence of Stage
        Programmes and the values at which they end: a component that the programme drives, or
        'parameter'.
    steps : int
        Steps of each stage.

    Returns
    -------
    MaterialPath
        Also where the path ends early, see its `status`.

    Raises
    ------
    InputError
        If a stage ends with a quantity that its programme does not drive.

    Examples
    --------
    >>> import numpy as np
    >>> from loops import LinearFrictional
    >>> from patterns import regular_polygon
    >>> from stability import Stage
    >>> from stability.material import LoopMaterial, march, oriented
    >>> law = LinearFrictional(kn=1.0, kt=0.5, mu=np.tan(np.radians(30)))
    >>> material = LoopMaterial(oriented(regular_polygon(3), 12), None, law)
    >>> stages = [Stage("isotropic_stress", "P11", 1e-2), Stage("drained_biaxial", "H11", 0.05)]
    >>> path = march(material, stages, steps=20)
    >>> path.status, round(float(path.P[-1, 0] / path.P[-1, 3]), 3)
    ('finished', 13.236)
    """
    check_type("material", material, LoopMaterial, "Give gl.LoopMaterial(loops, law=law).")
    whole_number("steps", steps, 1)
    stages = stages_of(stages)
    state, H = material.start(1), np.zeros(4)
    response = material.update(np.eye(2)[None], state)
    P, rows = response.stress.reshape(4), []
    status: MarchStatus = "finished"
    for number, stage in enumerate(stages):
        rows.append(_row(number, H, response, np.nan))
        rate = 1.0 if stage.quantity == "parameter" else stage.programme.driven(stage.quantity)
        if not np.isfinite(rate) or rate == 0.0:
            received, programme = stage.quantity, stage.programme.name
            expected = f"a quantity that the programme {programme!r} drives"
            remedy = "End it with a component whose rate the programme gives."
            raise InputError("quantity of a stage", received, expected, remedy)
        span = (stage.target - stage.value(H, P, 0.0)) / rate / steps
        # Spheres that barely touch have no stiffness for the first step to start from.
        speed = np.zeros(4) if np.any(response.tangent) else FIRST * np.eye(2).ravel()
        begin, rates = stage.programme.values(H, P), stage.programme.rate
        for k in range(1, steps + 1):
            wanted = begin + rates * (k * span)
            found, status = _step(material, stage.programme, state, wanted, H + speed)
            if found is None:
                break
            before = H, P
            response, H = found
            P, state = response.stress.reshape(4), response.state
            speed = H - before[0]
            change = P - before[1]
            size = float(np.linalg.norm(change) * np.linalg.norm(speed))
            work = float(change @ speed) / size if size else np.nan
            rows.append(_row(number, H, response, work))
        if status != "finished":
            break
    return MaterialPath(status, *(np.array(column) for column in zip(*rows, strict=True)))


def _row(number: int, H: Floats, response: MaterialResponse, work: float) -> tuple[Any, ...]:
    P, A = response.stress.reshape(4), response.tangent.reshape(4, 4)
    return number, H, P, A, work, response.regimes[0], response.failed[0].mean()


def _step(
    material: LoopMaterial, programme: Programme, state: MaterialState, wanted: Floats,
    guess: Floats,
) -> tuple[tuple[MaterialResponse, Floats] | None, MarchStatus]:  # fmt: skip
    """Return the response and the strain at which what the programme controls is as wanted."""
    end = guess
    for _ in range(MOST_CONTROL_STEPS):
        try:
            response = material.update(np.eye(2)[None] - end.reshape(1, 2, 2), state)
        except InputError:
            return None, "loops lost"
        A, stressed = response.tangent.reshape(4, 4), response.stress.reshape(4)
        stress, strain, _ = programme.equations(end, stressed)
        residual = programme.values(end, stressed) - wanted
        scale = np.abs(stress).sum(axis=1) * max(np.abs(A).max(), np.abs(stressed).max())
        scale += np.abs(strain).sum(axis=1)
        if (np.abs(residual) <= MET * scale).all():
            return (response, end), "finished"
        try:
            step = np.linalg.solve(stress @ A + strain, -residual)
        except np.linalg.LinAlgError:
            return None, "control limit"
        end = end + step * min(1.0, LONGEST_STEP / np.abs(step).max())
    return None, "control limit"
