"""Verdicts on loops with the errors of the file: columns, shares by order, and their figure."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import ArrayLike

from loops import InputError, contact_forces, contact_state
from loops.arrays import Flags, Floats
from loops.errors import short
from loops.validation import real
from patterns import Snapshot
from stability.input_error import InputErrors, eigenvalue_errors
from studies.output import Columns
from studies.snapshot.table import GROUPS, group_rows, share
from studies.style import GREY, ORDER_COLOURS, panel

# Digits up to which a number of a file counts as rounded; beyond it is the machine's.
MOST_DIGITS = 11
# Distance from a whole number of units in the last place, in units.
WHOLE = 1e-3
# Errors of the forces in the figure, and loops of a larger sample for which they are computed.
SHARES = np.geomspace(1e-4, 1.0, 9)
MOST_DRAWN = 2000


def half_unit(values: ArrayLike) -> Floats:
    """Half a unit in the last place of numbers as a file wrote them; zero for those of a machine.

    Numbers have so many digits each, or so many decimals.

    >>> half_unit([1.25, 12.5]).tolist(), half_unit([1.25, 12.75]).tolist()
    ([0.005, 0.05], [0.005, 0.005])
    """
    x = np.abs(np.asarray(values, dtype=float))
    known, found = x > 0.0, np.zeros(x.shape)
    if not known.any():
        return found
    first = np.floor(np.log10(x, where=known, out=np.zeros(x.shape)))
    for digits in range(1, MOST_DIGITS + 1):
        for place in (np.full(x.shape, first[known].max()), first):
            unit = 10.0 ** (place - digits + 1)
            if (np.abs(x / unit - np.rint(x / unit))[known] <= WHOLE).all():
                return np.asarray(0.5 * unit)
    return found


def input_errors(snapshot: Snapshot, input_error: Any) -> InputErrors:
    """Errors of contacts and centres by the digits of the file, or as a share of their forces.

    `input_error` is 'digits', a share of the force, or both that and a share of the stiffness.
    """
    graph, zero = snapshot.graph, np.zeros(snapshot.graph.contact_count)
    state, (i, j) = contact_state(graph), graph.contacts.T
    if input_error == "digits":
        in_file = contact_forces(graph), np.stack([graph.normal_force, graph.shear_force], axis=-1)
        force = np.maximum(*(half_unit(values).sum(axis=1) for values in in_file))
        radius = half_unit(graph.radii)
        return InputErrors(force, force, radius[i] + radius[j], zero, zero, *half_unit(graph.x).T)
    expected = "digits, or shares from 0 to 1 of the forces, and of kn and kt: 0.1,0.05"
    where, remedy = "--input-error", "Write --input-error 0.1."
    try:
        given = input_error.split(",") if isinstance(input_error, str) else input_error
        numbers = [float(one) for one in given] if isinstance(given, list) else given
    except (TypeError, ValueError):
        numbers = input_error
    shares = np.ravel(real(where, numbers, expected=expected, remedy=remedy))
    if len(shares) not in (1, 2) or not ((shares >= 0.0) & (shares <= 1.0)).all():
        raise InputError(where, short(input_error), expected, remedy)
    force_share, stiffness = (*shares, 0.0)[:2]
    force = force_share * np.hypot(graph.normal_force, graph.shear_force)
    overlap = force_share * np.maximum(state.overlap, 0.0)
    still = np.zeros((2, graph.grain_count))
    return InputErrors(force, force, overlap, zero + stiffness, zero + stiffness, *still)


def add_input_errors(
    snapshot: Snapshot, table: Columns, input_error: Any, loops: Flags | None = None
) -> dict[str, Any]:
    """Add `*_input_error` of every closure to the table of loops, not numbers for no `loops` (L,).

    Returns the keys of the summary.
    """
    (law, regime), faces, by_order = snapshot.mechanics(), snapshot.faces, dict[str, Any]()
    errors = input_errors(snapshot, input_error)
    picked = faces.loops if loops is None else faces.loops[loops]
    found = eigenvalue_errors(snapshot.graph, law, regime, faces, errors, picked)
    for closure, one in found.items():
        error = table[f"{closure}_input_error"] = one.error / snapshot.mean_kn
        # Rounding and the input together.
        smallest = np.abs(np.nan_to_num(table[f"{closure}_lambda_min"]))
        certain = smallest > table[f"{closure}_error"] + error
        groups = group_rows(table["order"]).items()
        among = np.ones(len(certain), dtype=bool) if loops is None else loops
        by_order[closure] = {name: share(certain[own][among[own]]) for name, own in groups}
    return {"input_error": str(input_error), "certain_by_order": by_order}


def certain_columns(snapshot: Snapshot, table: Columns) -> Columns:
    """Table of the share of loops whose sign is certain, over the error of the forces.

    By closure and group of orders; of larger samples `MOST_DRAWN` loops.
    """
    rows, drawn = list[Any](), np.zeros(len(table["order"]), dtype=bool)
    drawn[:: -(-len(drawn) // MOST_DRAWN) or 1] = True
    for error in SHARES:
        found = add_input_errors(snapshot, dict(table), error, drawn)["certain_by_order"]
        for closure, groups in found.items():
            rows += [
                (closure, name, error, told["mean"], told["std_error"])
                for name, told in groups.items()
                if told["count"]
            ]
    names = ("closure", "orders", "force_error", "certain_share", "certain_share_error")
    return {name: np.array([row[k] for row in rows]) for k, name in enumerate(names)}


@panel(height=2.8)
def draw_certain(certain: Columns, input_error: str, ax: Axes) -> None:
    """Share of loops whose sign is certain over the error of the forces, by order (traction)."""
    for group, colour in zip(GROUPS, ORDER_COLOURS, strict=True):
        own = (certain["closure"] == "traction") & (certain["orders"] == group)
        if own.any():
            names = ("force_error", "certain_share", "certain_share_error")
            look: Any = {"color": colour, "label": group, "marker": "o", "markersize": 3}
            ax.errorbar(*(certain[name][own] for name in names), **look)
    if input_error != "digits":
        ax.axvline(float(input_error.split(",")[0]), color=GREY, linewidth=0.8, label="as given")
    ax.set(xscale="log", xlabel="error of a contact's force over the force (–)",
           ylabel="share of loops with a certain sign", ylim=(-0.02, 1.02))  # fmt: skip
    ax.legend(title="loop order")
