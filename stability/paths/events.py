"""From event functions to the events of a path."""

from __future__ import annotations

from typing import cast

import numpy as np

from loops.arrays import Flags, Floats, Integers
from loops.laws.protocol import Regime
from stability.paths.edge import EdgeTrial
from stability.paths.model import PathModel
from stability.paths.monitors import SPECTRAL, eigenvalue_kind
from stability.paths.path import EventKind
from stability.paths.piece import PieceEnd
from stability.paths.record import Record
from stability.paths.state import Mode
from stability.rate_problem import ELASTIC, LEFT, OPEN, RIGHT, Choice, RateProblem
from stability.spectra import RTOL, operator_norm, symmetric_spectrum
from stability.subspaces import restrict

CHANGES: tuple[EventKind, ...] = ("yield", "unloading", "opening", "closing")
SINGULAR = "the controlled system is singular"
# More pairs of grains than these that touch at once are one event.
MANY_PAIRS = 12


def record_fired(record: Record, end: PieceEnd, subspaces: tuple[str, ...]) -> None:
    """Record the events that do not depend on what the contacts do next."""
    parameter = end.seen.state.parameter
    for k, subspace in enumerate(subspaces):
        for kind in SPECTRAL:
            items = [item % 4 for fired, item in end.fired if fired == kind and item // 4 == k]
            kinds = [
                eigenvalue_kind(end.seen.A, subspace, item) if kind == "det_K_zero" else kind
                for item in items
            ]
            for each in dict.fromkeys(kinds):
                count = kinds.count(each)
                detail = f"{count} eigenvalues at once" if count > 1 else ""
                record.event(cast(EventKind, each), parameter, detail=detail, subspace=subspace)
    touched = touched_pairs(end)
    if len(touched) > MANY_PAIRS:
        detail = f"{len(touched)} pairs of grains at once"
        record.event("opposite_contact", parameter, tuple(touched.ravel().tolist()), detail)
    else:
        for pair in touched.tolist():
            record.event("opposite_contact", parameter, tuple(pair))
    if ("control_limit", -1) in end.fired:
        detail = "the loading parameter has an extremum"
        record.event("control_limit", parameter, detail=detail)
    if ("singular", -1) in end.fired:
        record.event("control_limit", parameter, detail=SINGULAR)
    if ("stage_end", -1) in end.fired:
        for change in CHANGES:
            contacts = tuple(item for fired, item in end.fired if fired == change)
            if contacts:
                record.event(change, parameter, contacts, "at the end of the stage")


def record_changes(
    record: Record, old: Mode, new: Mode, parameter: float, problem: RateProblem[EdgeTrial]
) -> None:
    """Record changes of regime, and what is worth saying about the rate problem."""
    detail = ""
    if problem.status == "several":
        detail = f"the rate problem has {len(problem.solutions)} solutions"
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
            record.event(kind, parameter, contacts, detail)


def record_start(record: Record, model: PathModel, mode: Mode) -> None:
    """Record the contacts that slide from the start of the path."""
    sliding = np.flatnonzero((mode.regime == Regime.SLIDING) & (model.mu > 0))
    if len(sliding):
        record.event("yield", 0.0, tuple(sliding.tolist()), "from the start")


def record_jumps(
    record: Record, before: Floats, after: Floats, parameter: float, subspaces: tuple[str, ...]
) -> None:
    """Record the zeros that the determinants jump over where regimes change."""
    if not (np.isfinite(before).all() and np.isfinite(after).all()):
        return
    for subspace in subspaces:
        K = restrict(np.stack([before, after]), subspace)
        below = (symmetric_spectrum(K) < -RTOL * operator_norm(K)[:, None]).sum(axis=1)
        if below[0] != below[1]:
            detail = f"jump: {below[0]} to {below[1]} negative eigenvalues"
            record.event("det_Ks_zero", parameter, detail=detail, subspace=subspace)
        det = np.linalg.det(K)
        if det[0] * det[1] < 0:
            detail = f"jump: from {det[0]:.3g} to {det[1]:.3g}"
            record.event("det_K_zero", parameter, detail=detail, subspace=subspace)


def hints_of(end: PieceEnd) -> dict[int, Choice]:
    """Regimes that contacts would take if nothing else changed: they break ties."""
    side = np.sign(end.seen.contacts.shear_force)
    after = {
        "yield": lambda c: LEFT if side[c] > 0 else RIGHT,
        "unloading": lambda c: ELASTIC,
        "opening": lambda c: OPEN,
        "closing": lambda c: ELASTIC,
    }
    return {item: after[kind](item) for kind, item in end.fired if kind in after}


def touched_pairs(end: PieceEnd) -> Integers:
    """(A, 2) pairs of grains without a contact that have come to touch."""
    rows = [item for kind, item in end.fired if kind == "opposite_contact"]
    return end.pairs[rows]
