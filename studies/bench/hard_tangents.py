"""The hard cases that end in a tangent: verdicts and errors beside 50 digits."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from loops import InputError, MacroTangent, contact_state, macroscopic_tangent
from loops.arrays import Floats
from patterns.hard_cases import HardCase, Scene
from stability import (
    imhof_fraction,
    judge,
    operator_norm,
    plane_cone,
    restrict,
    subspace_basis,
    symmetric_spectrum,
    unstable_fraction,
)
from stability.directional.edge import edge_contacts
from studies.bench.oracles import tangent_50
from studies.fifty_digits import DIGITS, as_array

CLOSURES, SUBSPACE = ("affine", "traction"), "symmetric"
STATUS_LETTERS = {"stable": "s", "unstable": "u", "undetermined": "?"}
REGIME_LETTERS = "oes"
# An eigenvalue below this fraction of the operator is zero with 50 digits too.
ZERO_50 = 1e-40


class Exact(NamedTuple):
    """What 50 digits say."""

    matrix: Floats
    spectrum: Floats
    letter: str


def tangent_rows(case: HardCase, every: int = 1) -> list[dict[str, Any]]:
    """Every value of a hard case under both closures, one row each."""
    rows = []
    for k, value in list(enumerate(case.values))[::every]:
        for closure in CLOSURES:
            head = {"case": case.name, "parameter": case.parameter, "value": float(value)}
            row = {**head, "closure": closure, "expected": case.expected[closure][k]}
            rows.append(row | _evaluated(case, value, closure))
    return rows


def read_letters(case: HardCase) -> dict[str, str]:
    """What the states say of contact 0: its regime, and whether the direction decides on it."""
    regime, edge = "", ""
    for value in case.values:
        scene = _built(case, value)
        if scene is None:
            regime, edge = regime + "e", edge + "e"
            continue
        regime += REGIME_LETTERS[int(scene.law.regime(contact_state(scene.graph))[0])]
        at: Any = edge_contacts(scene.graph, scene.law)
        edge += "y" if bool(at.at_yield[0]) else "n"
    return {"regime": regime, "edge": edge}


def solve(scene: Scene, closure: Any) -> MacroTangent:
    """Tangent of a scene."""
    return macroscopic_tangent(
        scene.graph, scene.law, closure, spins=scene.spins, regime=scene.regime
    )


def exact_answer(scene: Scene, closure: str) -> Exact | None:
    """Operator, spectrum of Ks and verdict with 50 digits; None where there is no oracle."""
    import mpmath as mp

    try:
        matrix = tangent_50(scene, closure)
    except ZeroDivisionError:
        return None
    if matrix is None:
        return None
    with mp.workdps(DIGITS):
        basis = _basis_50()
        K = basis * matrix * basis.T
        values = sorted(mp.eigsy((K + K.T) / 2, eigvals_only=True))
        small = ZERO_50 * max(abs(value) for value in values)
        letter = "s" if values[0] > small else "u" if values[0] < -small else "?"
        spectrum = np.array([float(value) for value in values])
    return Exact(as_array(matrix), spectrum, letter)


def _built(case: HardCase, value: float) -> Scene | None:
    try:
        return case.build(value)
    except InputError:
        return None


def _evaluated(case: HardCase, value: float, closure: str) -> dict[str, Any]:
    scene = _built(case, value)
    if scene is None:
        return {"answer": "e", "exact": "-", **dict.fromkeys(MEASURES, np.nan)}
    tangent = solve(scene, closure)
    answer = STATUS_LETTERS[judge(tangent, SUBSPACE).status]
    exact = exact_answer(scene, closure)
    size = float(operator_norm(np.nan_to_num(tangent.matrix)))
    stated = {
        "condition": float(tangent.condition),
        "bound": float(tangent.error) / size if size > 0.0 else np.nan,
    }
    if exact is None or not tangent.trusted:
        letter = "-" if exact is None else exact.letter
        return {"answer": answer, "exact": letter} | dict.fromkeys(MEASURES, np.nan) | stated
    return {"answer": answer, "exact": exact.letter, **stated, **_errors(case, tangent, exact)}


MEASURES = (
    "condition",
    "bound",
    "operator_error",
    "eigenvalue_error",
    "cone_error",
    "fraction_error",
)


def _errors(case: HardCase, tangent: MacroTangent, exact: Exact) -> dict[str, float]:
    size = max(float(np.linalg.norm(exact.matrix)), np.finfo(float).tiny)
    spectrum = symmetric_spectrum(restrict(tangent.matrix, SUBSPACE))
    return {
        "operator_error": float(np.linalg.norm(tangent.matrix - exact.matrix)) / size,
        "eigenvalue_error": float(np.abs(spectrum - exact.spectrum).max()) / size,
        "cone_error": _cone_error(tangent.matrix, exact.matrix),
        "fraction_error": abs(
            float(unstable_fraction(spectrum)) - float(imhof_fraction(exact.spectrum))
        ),
    }


def _cone_error(matrix: Floats, exact: Floats) -> float:
    """Largest difference of the cone's edges; the cone of the rounded exact operator is exact."""
    found, true = (plane_cone(restrict(A, "diagonal")).edges for A in (matrix, exact))
    gap = np.abs(found - true)
    return float(np.minimum(gap, np.pi - np.mod(gap, np.pi)).max())


def _basis_50() -> Any:
    import mpmath as mp

    # Entries are 0, 1 and sqrt(1/2), whose double is not enough.
    basis = subspace_basis(SUBSPACE)
    return mp.matrix([[mp.sqrt(mp.mpf(round(2 * v * v)) / 2) for v in row] for row in basis])
