"""Record of a path while it is followed: rows, events, what was modelled."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, cast

import numpy as np

from loops.arrays import Flags, Floats, Integers
from loops.laws.frictional import Regime
from loops.symmetry import identity, invariant_fields
from stability.path import CHANGES, Event, EventKind, ModelChoice, ModelOption, Path, PathStatus
from stability.paths.kernels import law_is_given
from stability.paths.model import PathModel
from stability.paths.path_segment import (
    CROSSING_TOLERANCE,
    SPECTRAL,
    SegmentEnd,
    eigenvalue_kind,
)
from stability.paths.regimes import EdgeTrial
from stability.paths.state import Mode, shear_stiffness
from stability.paths.state_rates import StateRates
from stability.regimes import LEFT, OPEN, RIGHT, STICKS, Regimes
from stability.spectra import RTOL, operator_norm, restrict, symmetric_spectrum

# More pairs of grains than these that touch at once are one event.
MANY_PAIRS = 12


@dataclass
class Record:
    """Rows and events of a path."""

    rows: list[dict[str, Any]] = field(default_factory=list)
    events: list[Event] = field(default_factory=list)
    stage: int = 0

    def row(self, model: PathModel, here: StateRates) -> None:
        """Append a row."""
        contacts = here.contacts
        kt = shear_stiffness(model, contacts)
        shear, closed = contacts.shear_force, here.mode.regime != Regime.OPEN
        stored = np.where(closed, model.law.normal_energy(contacts), 0.0)
        self.rows.append(
            {
                "parameter": here.parameter,
                "stage": self.stage,
                "H": here.H,
                "P": here.P,
                "x": here.x,
                "normal_force": contacts.normal_force,
                "shear_force": shear,
                "regime": here.mode.regime,
                "A": here.A,
                "H_rate": here.rates.H,
                "P_rate": here.rates.P,
                "parameter_rate": here.rates.parameter,
                "work": here.y[-4:],
                "normal_energy": float(stored.sum()),
                "tangential_energy": float((shear**2 / (2 * kt)).sum()),
                "imbalance": here.imbalance,
                "condition": here.rates.condition,
            }
        )

    def event(
        self,
        kind: EventKind,
        parameter: float,
        contacts: tuple[int, ...] = (),
        **facts: Any,
    ) -> None:
        """Append an event in the state of the last row, with further facts of `Event`."""
        H, P = (tuple(self.rows[-1][name].tolist()) for name in ("H", "P"))
        place = float(parameter), self.stage, len(self.rows) - 1
        self.events.append(Event(kind, *place, contacts, H=H, P=P, **facts))

    def branching(self, here: StateRates) -> None:
        """Append an event between two rows where other paths branch off; it may have no rates."""
        H, P, index = tuple(here.H.tolist()), tuple(here.P.tolist()), len(self.rows) - 1
        self.events.append(Event("branching", here.parameter, self.stage, index, H=H, P=P))

    def path(
        self,
        model: PathModel,
        status: PathStatus,
        message: str,
        subspace: str,
        chosen: ModelChoice,
    ) -> Path:
        """Path of the rows and events; contacts are open before they were added."""
        count = model.contact_count
        table = {name: [row[name] for row in self.rows] for name in self.rows[0]}
        for name in ("normal_force", "shear_force", "regime"):
            fill = Regime.OPEN if name == "regime" else 0.0
            table[name] = [
                np.pad(value, (0, count - len(value)), constant_values=fill)
                for value in table[name]
            ]
        return Path(
            status=status,
            message=message,
            events=tuple(self.events),
            contacts=model.contacts,
            volume=model.volume,
            subspace=subspace,
            model=chosen,
            **cast(Any, {name: np.array(values) for name, values in table.items()}),
        )


@dataclass
class Searches:
    """Counts of the rate problems of a path."""

    problems: int = 0
    without_choice: int = 0
    tried: int = 0
    combinations: float = 0.0

    def add(self, problem: Regimes[Any]) -> None:
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
    group = model.symmetry or identity(model.grain_count, model.contact_count)
    freedoms = invariant_fields(group.grains, group.maps).shape[-1]
    whole, own = model.unknowns.fields.shape
    spins = "none: blocked" if model.spins == "blocked" else "none: tied to the loop"
    if model.spins == "free":
        independent = invariant_fields(group.grains, group.parity[:, None, None]).shape[-1]
        spins = f"{independent} of {model.grain_count}"
    return ModelChoice(
        choice=choice,
        symmetry="none" if group.order == 1 else f"{group.name} (order {group.order})",
        freedoms=f"{freedoms} of {2 * model.grain_count}",
        spins=spins,
        unknowns=f"{own + 1} of {whole + 1}",
        contact_orbits=f"{len(np.unique(group.contact_orbits))} of {model.contact_count}",
        branch_search=str(searches),
        branch_solves=searches.without_choice + searches.tried,
        kernels="plain" if law_is_given(model) else "compiled",
        kept=kept,
    )


def record_fired(record: Record, end: SegmentEnd, subspaces: tuple[str, ...]) -> None:
    """Record the events of a segment's end; regimes change later, see `record_changes`."""
    parameter = end.here.parameter
    for k, subspace in enumerate(subspaces):
        for kind in SPECTRAL:
            items = [item % 4 for fired, item in end.fired if fired == kind and item // 4 == k]
            kinds = [
                eigenvalue_kind(end.here.A, subspace, item) if kind == "det_K_zero" else kind
                for item in items
            ]
            for each in dict.fromkeys(kinds):
                count = kinds.count(each) if kinds.count(each) > 1 else 0
                record.event(cast(EventKind, each), parameter, count=count, subspace=subspace)
    touched = touched_pairs(end)
    if len(touched) > MANY_PAIRS:
        grains = tuple(touched.ravel().tolist())
        record.event("opposite_contact", parameter, grains, count=len(touched))
    else:
        for pair in touched.tolist():
            record.event("opposite_contact", parameter, tuple(pair))
    if ("control_limit", -1) in end.fired:
        record.event("control_limit", parameter, cause="extremum")
    if ("singular", -1) in end.fired:
        record.event("control_limit", parameter, cause="singular")
    if ("stage_end", -1) in end.fired:
        for change in CHANGES:
            contacts = tuple(item for fired, item in end.fired if fired == change)
            if contacts:
                record.event(change, parameter, contacts, cause="stage_end")


def record_changes(
    record: Record, old: Mode, new: Mode, parameter: float, problem: Regimes[EdgeTrial]
) -> None:
    """Record changes of regime, and whether the rate problem has several solutions."""
    count = len(problem.solutions) if problem.status in ("several", "family") else 0
    was_open, is_open = old.regime == Regime.OPEN, new.regime == Regime.OPEN
    groups: list[tuple[EventKind, Flags]] = [
        ("yield", (new.regime == Regime.SLIDING) & (old.regime == Regime.ELASTIC)),
        ("unloading", (new.regime == Regime.ELASTIC) & (old.regime == Regime.SLIDING)),
        ("opening", is_open & ~was_open),
        ("closing", was_open & ~is_open),
    ]
    for kind, mask in groups:
        if mask.any():
            contacts = tuple(np.flatnonzero(mask).tolist())
            record.event(kind, parameter, contacts, count=count)


def record_start(record: Record, model: PathModel, mode: Mode) -> None:
    """Record the contacts that slide from the start of the path."""
    sliding = np.flatnonzero((mode.regime == Regime.SLIDING) & (model.mu > 0))
    if len(sliding):
        record.event("yield", 0.0, tuple(sliding.tolist()), cause="start")


def record_jumps(
    record: Record, before: Floats, after: Floats, parameter: float, subspaces: tuple[str, ...]
) -> None:
    """Record where eigenvalues or determinants jump over zero as regimes change.

    A tangent that vanishes on one side, as of a loop without load, has no sign there.
    """
    if not (np.isfinite(before).all() and np.isfinite(after).all()):
        return
    for subspace in subspaces:
        K = restrict(np.stack([before, after]), subspace)
        norm = operator_norm(K).max()
        below = (symmetric_spectrum(K) < -RTOL * norm).sum(axis=1)
        if below[0] != below[1]:
            jump = tuple(below.tolist())
            record.event("det_Ks_zero", parameter, jump=jump, subspace=subspace)
        det, least = np.linalg.det(K), CROSSING_TOLERANCE["det_K_zero"] * norm ** K.shape[1]
        if det[0] * det[1] < 0 and np.abs(det).min() > least:
            record.event("det_K_zero", parameter, jump=tuple(det.tolist()), subspace=subspace)


def expected_regimes(end: SegmentEnd) -> dict[int, int]:
    """Regimes expected of the contacts whose events fired: they decide between solutions."""
    sliding = np.where(end.here.contacts.shear_force > 0, LEFT, RIGHT)
    after = {"unloading": STICKS, "opening": OPEN, "closing": STICKS}
    return {
        item: int(after.get(kind, sliding[item])) for kind, item in end.fired if kind in CHANGES
    }


def touched_pairs(end: SegmentEnd) -> Integers:
    """(A, 2) pairs of grains without a contact that have come to touch."""
    rows = [item for kind, item in end.fired if kind == "opposite_contact"]
    return end.pairs[rows]
