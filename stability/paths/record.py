"""Rows and events of a path while it is followed."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from loops.laws.protocol import Regime
from stability.paths.choice import ModelChoice
from stability.paths.look import Look, imbalance
from stability.paths.model import PathModel
from stability.paths.motion import shear_stiffness
from stability.paths.path import Event, EventKind, Path, PathStatus

Floats = NDArray[np.float64]


@dataclass
class Record:
    """Collects rows and events, and makes a `Path` of them."""

    rows: list[dict[str, object]] = field(default_factory=list)
    events: list[Event] = field(default_factory=list)
    stage: int = 0

    def row(self, model: PathModel, seen: Look) -> None:
        """Append a row."""
        contacts = seen.contacts
        kt = shear_stiffness(model, contacts)
        shear, closed = contacts.shear_force, seen.mode.regime != Regime.OPEN
        stored = np.where(closed, model.law.normal_energy(contacts), 0.0)
        self.rows.append(
            {
                "parameter": seen.state.parameter,
                "stage": self.stage,
                "H": seen.H,
                "P": seen.P,
                "x": seen.x,
                "normal_force": contacts.normal_force,
                "shear_force": shear,
                "regime": seen.mode.regime,
                "A": seen.A,
                "H_rate": seen.rates.H,
                "P_rate": seen.rates.P,
                "parameter_rate": seen.rates.parameter,
                "work": seen.state.work,
                "normal_energy": float(stored.sum()),
                "tangential_energy": float((shear**2 / (2 * kt)).sum()),
                "imbalance": imbalance(model, contacts, seen.P),
                "condition": seen.rates.condition,
            }
        )

    def event(
        self,
        kind: EventKind,
        parameter: float,
        contacts: tuple[int, ...] = (),
        detail: str = "",
        subspace: str = "",
    ) -> None:
        """Append an event at the last row."""
        index = max(len(self.rows) - 1, 0)
        self.events.append(
            Event(kind, float(parameter), self.stage, index, contacts, detail, subspace)
        )

    def path(
        self,
        model: PathModel,
        status: PathStatus,
        message: str,
        subspace: str,
        chosen: ModelChoice,
    ) -> Path:
        """The path so far; contacts added on the way are padded as open."""
        count = model.contact_count
        table = {name: [row[name] for row in self.rows] for name in self.rows[0]}
        for name in ("normal_force", "shear_force", "regime"):
            fill = Regime.OPEN if name == "regime" else 0.0
            table[name] = [_padded(np.asarray(value), count, fill) for value in table[name]]
        return Path(
            status=status,
            message=message,
            events=tuple(self.events),
            contacts=model.contacts,
            volume=model.volume,
            subspace=subspace,
            model=chosen,
            **{name: np.array(values) for name, values in table.items()},
        )


def _padded(values: NDArray[np.generic], count: int, fill: float) -> NDArray[np.generic]:
    return np.pad(values, (0, count - len(values)), constant_values=fill)
