"""One segment of a path, from an event to the next: regimes and programme are fixed.

Events are where smooth functions of the state change sign; the integrator stops at the first.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from loops.arrays import Floats, Integers
from loops.laws.frictional import Regime
from stability.paths.kernels import QUANTITIES, EventFunctions, answer, follow
from stability.paths.model import PathModel
from stability.paths.segment import EVENT, ROW, SIMULTANEOUS, SINGULAR, TOO_LONG, Steps, System
from stability.paths.state import NO_PAIRS, Mode, pair_overlaps, pairs_in_reach
from stability.paths.state_rates import Answers, StateRates
from stability.programmes import NOTHING, Stage
from stability.spectra import subspace_basis

# An event function has changed its sign once it is beyond zero by more than its rounding.
CROSSING_TOLERANCE = {
    "yield": 1e-13,
    "unloading": 1e-12,
    "opening": 1e-14,
    "closing": 1e-14,
    "det_Ks_zero": 1e-12,
    "det_K_zero": 1e-12,
    "collapse": 0.0,
    "control_limit": 1e-12,
    "stage_end": 0.0,
    "opposite_contact": 1e-14,
}
# Kinds as the kernels number them.
KINDS = list(CROSSING_TOLERANCE)
SPECTRAL = ("det_Ks_zero", "det_K_zero")
# An eigenvalue of K whose imaginary part is below this fraction of |K| is real.
REAL_RTOL = 1e-7


def event_functions(
    model: PathModel, mode: Mode, stage: Stage, start: float, sense: float, size: float,
    subspaces: tuple[str, ...],
) -> EventFunctions:  # fmt: skip
    """Event functions of a segment with these regimes.

    The stage began at the loading parameter `start` and its quantity grows by `sense`; strains are
    of that `size`.
    """
    kinds_of_regime = Regime.ELASTIC, Regime.SLIDING, Regime.OPEN
    sticks, slides, is_open = (mode.regime == one for one in kinds_of_regime)
    programme, none = stage.programme, np.array([-1])
    # Size of the loading parameter per unit of strain.
    driven = np.abs(programme.rate).argmax()
    strain = np.abs(programme.equations(NOTHING, NOTHING)[1][driven]).max()
    weight = max(np.abs(programme.stress[driven]).max() * model.stiffness, strain)
    parameter_unit = float(weight / np.abs(programme.rate[driven]))
    spaces = [subspace_basis(one) for one in subspaces]
    watched: list[tuple[str, Integers]] = [
        ("yield", np.flatnonzero(sticks & model.has_cone)),
        ("unloading", np.flatnonzero(slides & model.has_cone)),
        ("opening", np.flatnonzero(~is_open)),
        ("closing", np.flatnonzero(is_open)),
        *((kind, 4 * k + np.arange(len(one))) for k, one in enumerate(spaces) for kind in SPECTRAL),
        *((kind, none) for kind in ("collapse", "control_limit", "stage_end", "opposite_contact")),
    ]
    kinds = [kind for kind, items in watched for _ in items]
    items = np.concatenate([items for _, items in watched])
    bases = np.zeros((len(spaces), 4, 4))
    for basis, one in zip(bases, spaces, strict=True):
        basis[: len(one)] = one
    tolerance = np.array([[CROSSING_TOLERANCE[kind] for kind in kinds], np.isin(kinds, SPECTRAL)])
    codes = [KINDS.index(kind) for kind in kinds]
    return EventFunctions(
        np.column_stack([codes, items]).astype(np.int64), tolerance * 1.0, bases,
        np.array([len(one) for one in spaces], dtype=np.int64), QUANTITIES[stage.quantity],
        (stage.target, sense, start, size, parameter_unit),
    )  # fmt: skip


def eigenvalue_kind(A: Floats, subspace: str, item: int) -> str:
    """Kind of event where the real part of an eigenvalue of K vanishes: det_K_zero or flutter."""
    basis = subspace_basis(subspace)
    K = basis @ A @ basis.T
    if not np.isfinite(K).all():
        # In a singular state itself the operator is not known, and neither is its spectrum.
        return "det_K_zero"
    values = np.sort(np.linalg.eigvals(K).astype(complex))
    real = abs(values[item].imag) <= REAL_RTOL * np.linalg.norm(K)
    return "det_K_zero" if real else "flutter"


# ---- integration from event to event


@dataclass(frozen=True, eq=False)
class SegmentEnd:
    """End of a segment.

    `here`: The state in the regimes of the segment; `fired`: Kinds
    and items of the events, empty if the integrator gave up; `steps`: Accepted steps; `message`:
    Why the integrator gave up; `pairs` (Q, 2): Pairs of grains that touch, which the items of
    'opposite_contact' count.
    """

    here: StateRates
    fired: list[tuple[str, int]]
    steps: int
    message: str = ""
    pairs: Integers = field(default_factory=lambda: NO_PAIRS)


def follow_segment(
    start: StateRates,
    functions: EventFunctions,
    how: Steps,
    record_row: Callable[[StateRates], None],
    record_branching: Callable[[StateRates], None],
) -> SegmentEnd:
    """Integrate from a state to the first event."""
    from stability.paths.calls import Callback

    answers, size = Answers(start.model, start.mode, start.programme, functions), len(start.y)
    plain = Callback(answers.reply, answers.p.shared[2])
    call = answer() if answers.compiled else plain
    system = System(call, plain, answers.numbers, answers.whole, functions.tolerance)
    begin = np.array(start.y), np.array(start.gauge)
    code, steps, end, last, fired, record = follow()(system, *begin, how)
    if plain.raised is not None:
        raise plain.raised
    for row in record:
        kept = record_row if row[0] == ROW else record_branching
        kept(replace(start, y=row[1 : size + 1], gauge=row[size + 1 :]))
    here = replace(start, y=end, gauge=last)
    if code != EVENT:
        singular = [("singular", -1)] if code == SINGULAR else []
        message = "no step size keeps the error within its tolerance"
        if code == TOO_LONG:
            message = "the limit on the number of steps was reached"
        return SegmentEnd(here, singular, steps, message)
    events = [(KINDS[kind], item) for kind, item in functions.watch[fired].tolist()]
    pairs = NO_PAIRS
    if ("opposite_contact", -1) in events:
        events.remove(("opposite_contact", -1))
        pairs = pairs_in_reach(here.model, here.x)
        overlaps = pair_overlaps(here.model, pairs, here.x)
        least = min(-SIMULTANEOUS, float(overlaps.max(initial=-np.inf)))
        pairs = pairs[overlaps >= least]
        events += [("opposite_contact", k) for k in range(len(pairs))]
    return SegmentEnd(here, events, steps, pairs=pairs)
