"""Where a path is, and how it is followed."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace

import numpy as np

from loops import GrainGraph, InputError
from loops.arrays import Floats
from loops.contact_state import contact_state
from loops.laws.protocol import Regime
from loops.symmetry import PointGroup
from stability.paths.look import Look
from stability.paths.model import PathModel
from stability.paths.monitors import monitors_of
from stability.paths.path import ModelOption
from stability.paths.piece import Task
from stability.paths.record import Record, Searches
from stability.paths.state import Mode, scales, unpack
from stability.paths.symmetry import path_symmetry
from stability.programmes import Programme, Stage

# Steps that a stage takes at least, if it is as long as its start promises.
STEPS = 8
# Of a symmetry that was never given up.
TO_THE_END = "to the end"
# Shear force outside the cone that passes for rounding, over kn times length.
OUTSIDE = 1e-9


@dataclass
class Walk:
    """Where a path is, and how it is followed."""

    model: PathModel
    y: Floats
    mode: Mode
    record: Record
    subspaces: tuple[str, ...]
    on_touch: str
    rtol: float
    atol: float
    max_step: float
    rows: int
    steps_left: int
    programmes: tuple[Programme, ...]
    choice: ModelOption
    periodic: bool
    searches: Searches = field(default_factory=Searches)
    common: PointGroup | None = None
    kept: str = TO_THE_END

    def find_symmetry(self) -> None:
        """Look for the symmetry of the state and of what follows, if the model may be smaller."""
        if self.choice == "auto":
            self.common = self._symmetry(self.programmes)
            self.model = replace(self.model, symmetry=self.common)

    def enter(self, programme: Programme) -> None:
        """Take on the symmetry of a stage: by itself it may keep more than all of them do.

        Fewer freedoms are left to go singular: those of a ring do so together at a threshold.
        """
        if self.choice == "auto" and self.kept == TO_THE_END and len(self.programmes) > 1:
            own = self._symmetry([programme])
            larger = own is not None and own.order > (self.common.order if self.common else 1)
            self.model = replace(self.model, symmetry=own if larger else self.common)

    def _symmetry(self, programmes: Iterable[Programme]) -> PointGroup | None:
        return path_symmetry(self.model, self.y, self.mode, programmes, self.periodic)

    def drop_symmetry(self) -> None:
        """Go on with the full model."""
        self.model = replace(self.model, symmetry=None)
        self.kept = f"given up at parameter {self.parameter:.15g}: no symmetric motion goes on"

    @property
    def parameter(self) -> float:
        """Loading parameter."""
        return unpack(self.model, self.y).parameter

    def look(self, programme: Programme, gauge: Floats) -> Look:
        """The present state."""
        return Look(self.model, unpack(self.model, self.y), self.mode, programme, gauge)

    def row(self, seen: Look) -> None:
        """Record a state."""
        self.record.row(self.model, seen)

    def task(self, stage: Stage, start: float, sense: float, reach: float, strain: float) -> Task:
        """A piece of a stage that should be `reach` long and starts at a strain of that size."""
        size = min(max(reach if np.isfinite(reach) else 1.0, strain), 1.0)
        max_step = min(self.max_step, reach / STEPS)
        atol = self.atol * size * scales(self.model)
        row_step = min(reach, 1.0) / self.rows if self.rows else np.inf
        about = self.model, self.mode, stage
        watch = monitors_of(*about, start, sense, size, self.subspaces)
        return Task(*about, watch, self.rtol, atol, max_step, row_step, size)


def start_mode(model: PathModel, graph: GrainGraph) -> Mode:
    """Regimes of the initial graph."""
    contacts = contact_state(graph)
    regime, side = model.law.regime(contacts), np.sign(contacts.shear_force)
    strength = np.where(regime == Regime.OPEN, 0.0, model.law.strength(contacts))
    wrong = np.abs(contacts.shear_force) > strength + OUTSIDE * model.stiffness * model.length
    if wrong.any():
        c = int(wrong.argmax())
        where, expected = f"shear force of contact {c}", f"at most its strength {strength[c]:.6g}"
        raise InputError(where, f"{graph.shear_force[c]:.6g}", expected, "Correct it, or raise mu.")
    # Without friction a closed contact slides, whichever way.
    frictionless = (model.mu == 0) & (regime != Regime.OPEN)
    return Mode(
        np.where(frictionless, Regime.SLIDING, regime).astype(np.int8),
        np.where(frictionless, 1.0, side),
    )
