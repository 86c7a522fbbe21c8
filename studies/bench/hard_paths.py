"""The hard cases that end in a path or in the loops of a network."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from loops import InputError, find_faces
from patterns.hard_cases import HardCase, Scene
from stability import Path, Programme, Stage, follow, programmes

PROGRAMMES: dict[str, Callable[[], Programme]] = {
    "drained_biaxial": programmes.drained_biaxial,
    "force_control": lambda: programmes.proportional_stress(1.0, 0.0),
    "isotropic_strain": programmes.isotropic_strain,
    "isotropic_extension": lambda: programmes.isotropic_strain(-1.0),
}


def path_rows(case: HardCase) -> list[dict[str, Any]]:
    """Every value of a hard path under the affine closure, one row each."""
    return [_path_row(case, value) for value in case.values]


def loop_letters(case: HardCase) -> str:
    """Whether the loops of a hard network are found, one letter a value."""
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


def followed(scene: Scene, closure: Any = "affine") -> Path:
    """The path of a scene."""
    stages = [Stage(_programme(name), quantity, end) for name, quantity, end in scene.stages]
    law: Any = scene.law
    return follow(scene.graph, law, stages, closure=closure, spins=scene.spins)


def _programme(name: str) -> Programme:
    return PROGRAMMES[name]()


def _path_row(case: HardCase, value: float) -> dict[str, Any]:
    path = followed(case.build(value))
    kinds = [event.kind for event in path.events]
    met = path.status == case.status and _in_order(case.events, kinds)
    row = {
        "case": case.name,
        "parameter": case.parameter,
        "value": float(value),
        "status": path.status,
        "events": " ".join(kinds),
        "expected_met": met,
        "condition": float(np.max(path.condition)),
        "energy_error": float(np.abs(path.energy_error).max()),
    }
    return row | {"error": _place_error(case, value, path) if met else np.nan}


def _in_order(wanted: tuple[str, ...], met: list[Any]) -> bool:
    rest = iter(met)
    return all(kind in rest for kind in wanted)


def _place_error(case: HardCase, value: float, path: Path) -> float:
    if case.place is None:
        return np.nan
    event = path.of_kind(case.events[-1])[0]  # type: ignore[arg-type]
    return abs(float(path.H[event.index, 0]) - case.place(value))
