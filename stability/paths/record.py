"""Rows and events of a path while it is followed."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from loops.laws.protocol import Regime
from loops.symmetry import invariant_fields
from stability.paths.look import Look
from stability.paths.model import PathModel
from stability.paths.path import (
    Event,
    EventKind,
    ModelChoice,
    ModelOption,
    Path,
    PathStatus,
)
from stability.paths.rates import shear_stiffness
from stability.paths.symmetry import symmetry_or_identity
from stability.paths.unknowns import Kind
from stability.rate_problem import RateProblem


@dataclass
class Record:
    """Collects rows and events, and makes a `Path` of them."""

    rows: list[dict[str, Any]] = field(default_factory=list)
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
                "imbalance": seen.imbalance,
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
        """Append an event in the state of the last row."""
        H, P = (tuple(self.rows[-1][name].tolist()) for name in ("H", "P"))
        index = len(self.rows) - 1
        self.events.append(
            Event(kind, float(parameter), self.stage, index, contacts, detail, subspace, H, P)
        )

    def branching(self, seen: Look) -> None:
        """Append a place between two rows where other paths branch off: it may have no rates."""
        H, P, index = tuple(seen.H.tolist()), tuple(seen.P.tolist()), len(self.rows) - 1
        detail = f"other paths branch off at H11 = {H[0]:.15g}, H22 = {H[3]:.15g}"
        self.events.append(
            Event("branching", seen.state.parameter, self.stage, index, detail=detail, H=H, P=P)
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


@dataclass
class Searches:
    """Counts of the rate problems of a path."""

    problems: int = 0
    without_choice: int = 0
    tried: int = 0
    combinations: float = 0.0

    def add(self, problem: RateProblem[Any]) -> None:
        """Count one rate problem."""
        self.problems += 1
        if problem.combinations == 1:
            self.without_choice += 1
        else:
            self.tried += problem.tried
            self.combinations += problem.combinations

    def __str__(self) -> str:
        searched = self.problems - self.without_choice
        return (
            f"skipped in {self.without_choice} of {self.problems} rate problems; "
            f"{self.tried} of {self.combinations:.6g} combinations tried in the other {searched}"
        )


def model_choice(
    model: PathModel, choice: ModelOption, searches: Searches, kept: str
) -> ModelChoice:
    """Describe the model of a path."""
    group = symmetry_or_identity(model)
    freedoms = invariant_fields(group.grains, group.maps).shape[-1]
    kind: Kind = "affine"
    if model.closure == "traction":
        kind = "ring" if model.is_plain_ring else "saddle"
    sets = model.unknowns[kind]
    return ModelChoice(
        choice=choice,
        symmetry="none" if group.order == 1 else f"{group.name} (order {group.order})",
        freedoms=f"{freedoms} of {2 * model.grain_count}",
        spins=_spins(model),
        unknowns=f"{sets.rates.count + 1} of {sets.everything.count + 1}",
        contact_orbits=f"{len(np.unique(group.contact_orbits))} of {model.contact_count}",
        branch_search=str(searches),
        branch_solves=searches.without_choice + searches.tried,
        kernels="plain",
        kept=kept,
    )


def _spins(model: PathModel) -> str:
    if model.spins != "free":
        return "none: blocked" if model.spins == "blocked" else "none: tied to the loop"
    group = symmetry_or_identity(model)
    fields = invariant_fields(group.grains, group.parity[:, None, None])
    return f"{fields.shape[-1]} of {model.grain_count}"
