"""The hard cases: verdicts and errors beside 50 digits; paths, and the loops of networks."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from loops import (
    InputError,
    MacroTangent,
    Scene,
    contact_state,
    find_faces,
    macroscopic_tangent,
)
from loops.arrays import Floats
from stability import (
    Path,
    Programme,
    Stage,
    follow,
    judge,
    operator_norm,
    plane_cone,
    programmes,
    restrict,
    symmetric_spectrum,
    unstable_fraction,
)
from stability.directional.branches import edge_contacts
from tests.oracles.hard_cases import CaseState, HardCase
from tests.oracles.loop_balls import DIGITS, ring_rows, rounded, to_mpmath
from tests.oracles.stability_fraction import imhof_in_doubles

CLOSURES, SUBSPACE = ("affine", "traction"), "symmetric"
STATUS_LETTERS = {"stable": "s", "unstable": "u", "undetermined": "?"}
REGIME_LETTERS = "oes"
# An eigenvalue below this fraction of the operator is zero with 50 digits too.
ZERO_50 = 1e-40
# Rolling rings up to this long are solved exactly.
ROLLING = 12
TANGENT_MEASURES = (
    "condition", "bound", "operator_error", "eigenvalue_error", "cone_error", "fraction_error"
)  # fmt: skip
CASE_PROGRAMMES: dict[str, Callable[[], Programme]] = {
    "drained_biaxial": programmes.drained_biaxial,
    "force_control": lambda: programmes.proportional_stress(1.0, 0.0),
    "isotropic_strain": programmes.isotropic_strain,
    "isotropic_extension": lambda: programmes.isotropic_strain(-1.0),
}


class Exact(NamedTuple):
    """Operator, spectrum of Ks and verdict with 50 digits."""

    matrix: Floats
    spectrum: Floats
    letter: str


def tangent_rows(case: HardCase, every: int = 1) -> list[dict[str, Any]]:
    """One row for each value of a hard case and each closure."""
    rows = []
    for k, value in list(enumerate(case.values))[::every]:
        for closure in CLOSURES:
            head = {"case": case.name, "parameter": case.parameter, "value": float(value)}
            row = {**head, "closure": closure, "expected": case.expected[closure][k]}
            rows.append(row | _evaluated(case, value, closure))
    return rows


def read_letters(case: HardCase) -> dict[str, str]:
    """Letters of contact 0 at each value: its regime, and whether the direction decides on it."""
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


def solve(scene: CaseState, closure: Any) -> MacroTangent:
    """Tangent of a scene."""
    return macroscopic_tangent(
        scene.graph, scene.law, closure, spins=scene.spins, regime=scene.regime
    )


def exact_answer(scene: CaseState, closure: str) -> Exact | None:
    """Operator, spectrum of Ks and verdict with 50 digits; None where there is no oracle."""
    import mpmath as mp

    if scene.spins == "free" and scene.graph.grain_count > ROLLING:
        return None
    try:
        rows = ring_rows(scene.graph, scene.law, scene.regime, closure, scene.spins)
    except ZeroDivisionError:
        return None
    matrix = to_mpmath(rows)
    with mp.workdps(DIGITS):
        half = mp.sqrt(mp.mpf(1) / 2)
        basis = mp.matrix([[1, 0, 0, 0], [0, 0, 0, 1], [0, half, half, 0]])
        K = basis * matrix * basis.T
        values = sorted(mp.eigsy((K + K.T) / 2, eigvals_only=True))
        small = ZERO_50 * max(abs(value) for value in values)
        letter = "s" if values[0] > small else "u" if values[0] < -small else "?"
        spectrum = np.array([float(value) for value in values])
    return Exact(rounded(rows), spectrum, letter)


def _built(case: HardCase, value: float) -> CaseState | None:
    try:
        return case.build(value)
    except InputError:
        return None


def _evaluated(case: HardCase, value: float, closure: str) -> dict[str, Any]:
    """Verdict, stated bound and errors against 50 digits; NaN where there is nothing to compare."""
    row: dict[str, Any] = {"answer": "e", "exact": "-", **dict.fromkeys(TANGENT_MEASURES, np.nan)}
    scene = _built(case, value)
    if scene is None:
        return row
    tangent, exact = solve(scene, closure), exact_answer(scene, closure)
    size = float(operator_norm(np.nan_to_num(tangent.matrix)))
    row |= {
        "answer": STATUS_LETTERS[judge(tangent, SUBSPACE).status],
        "exact": "-" if exact is None else exact.letter,
        "condition": float(tangent.condition),
        "bound": float(tangent.error) / size if size > 0.0 else np.nan,
    }
    if exact is None or not tangent.trusted:
        return row
    exact_size = max(float(np.linalg.norm(exact.matrix)), np.finfo(float).tiny)
    spectrum = symmetric_spectrum(restrict(tangent.matrix, SUBSPACE))
    fractions = unstable_fraction(spectrum), imhof_in_doubles(exact.spectrum)
    # The cone of the rounded exact operator is exact.
    found, true = (
        plane_cone(restrict(A, "diagonal")).edges for A in (tangent.matrix, exact.matrix)
    )
    turn = np.abs(found - true)
    return row | {
        "operator_error": float(np.linalg.norm(tangent.matrix - exact.matrix)) / exact_size,
        "eigenvalue_error": float(np.abs(spectrum - exact.spectrum).max()) / exact_size,
        "cone_error": float(np.minimum(turn, np.pi - np.mod(turn, np.pi)).max()),
        "fraction_error": abs(float(fractions[0]) - float(fractions[1])),
    }


def hard_path_rows(case: HardCase) -> list[dict[str, Any]]:
    """One row for each value of a hard path, under the affine closure."""
    rows = []
    for value in case.values:
        path = followed(case.build(value))
        kinds: list[str] = [event.kind for event in path.events]
        rest = iter(kinds)
        met = path.status == case.status and all(kind in rest for kind in case.events)
        error = np.nan
        if met and case.place is not None:
            last = path.of_kind(case.events[-1])[0]  # type: ignore[arg-type]
            error = abs(float(path.H[last.index, 0]) - case.place(value))
        rows.append(
            {
                "case": case.name,
                "parameter": case.parameter,
                "value": float(value),
                "status": path.status,
                "events": " ".join(kinds),
                "expected_met": met,
                "condition": float(np.max(path.condition)),
                "energy_error": float(np.abs(path.energy_error).max()),
                "error": error,
            }
        )
    return rows


def loop_letters(case: HardCase) -> str:
    """Whether the loops of a hard network are found, one letter per value."""
    letters = ""
    for value in case.values:
        try:
            graph = case.build(value).graph
            faces = find_faces(graph)
        except InputError:
            letters += "e"
            continue
        wanted = graph.grain_count - 1
        right = len(faces.loops) == wanted and (faces.order[faces.loops] == 3).all()
        letters += "y" if right else "n"
    return letters


def followed(scene: CaseState, closure: Any = "affine") -> Path:
    """The path of a scene."""
    stages = [Stage(CASE_PROGRAMMES[name](), quantity, end) for name, quantity, end in scene.stages]
    law: Any = scene.law
    return follow(Scene(scene.graph, law), stages, closure=closure, spins=scene.spins)
