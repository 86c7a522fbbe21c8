"""Verdicts on loops with the errors of the file: columns, shares by order, and their figure."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import ArrayLike

from loops import InputError, contact_forces, contact_state
from loops.arrays import Flags, Floats, Integers
from loops.closures import Closure
from loops.errors import short
from loops.validation import real
from patterns import Snapshot
from stability.input_error import ContactErrors, eigenvalue_errors
from studies.output import Columns
from studies.snapshot.summary import group_rows
from studies.snapshot.table import GROUPS, share
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


def contact_errors(snapshot: Snapshot, input_error: Any) -> ContactErrors:
    """Errors of the contacts by the digits of the file, or as a share of their forces.

    `input_error` is 'digits', a share of the force, or both that and a share of the stiffness.
    """
    graph, zero = snapshot.graph, np.zeros(snapshot.graph.contact_count)
    state, (i, j) = contact_state(graph), graph.contacts.T
    if input_error == "digits":
        in_file = contact_forces(graph), np.stack([graph.normal_force, graph.shear_force], axis=-1)
        force = np.maximum(*(half_unit(values).sum(axis=1) for values in in_file))
        moved = half_unit(graph.x).sum(axis=1)
        away, radius = moved[i] + moved[j], half_unit(graph.radii)
        return ContactErrors(force, force, away + radius[i] + radius[j], zero, away / state.length)
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
    return ContactErrors(force, force, overlap, zero + stiffness, zero)


def add_input_errors(
    snapshot: Snapshot, table: Columns, input_error: Any
) -> tuple[dict[str, Any], Columns]:
    """Add `*_input_error` of both closures to the table of loops.

    Returns keys of the summary, and the table `certain`: by closure and group of orders the share
    of loops whose sign is certain, over the error of the forces as a share of them; of larger
    samples `MOST_DRAWN` loops.
    """
    kn, (law, regime), faces = snapshot.mean_kn, snapshot.mechanics(), snapshot.faces
    by_order, rows, groups = dict[str, Any](), list[Any](), group_rows(table["order"])

    def errors(given: Any, loops: Integers) -> dict[Closure, Floats]:
        own = contact_errors(snapshot, given)
        found = eigenvalue_errors(snapshot.graph, law, regime, faces, own, loops)
        return {closure: one.error / kn for closure, one in found.items()}

    for closure, error in errors(input_error, faces.loops).items():
        table[f"{closure}_input_error"] = error
        certain = certain_signs(table, closure, error)
        by_order[closure] = {name: share(certain[own]) for name, own in groups.items()}
    drawn = np.zeros(len(faces.loops), dtype=bool)
    drawn[:: -(-len(drawn) // MOST_DRAWN) or 1] = True
    for force_error in SHARES:
        for closure, error in errors(force_error, faces.loops[drawn]).items():
            certain = certain_signs(table, closure, error)
            for name, own in groups.items():
                if drawn[own].any():
                    told = share(certain[own][drawn[own]])
                    rows.append((closure, name, force_error, told["mean"], told["std_error"]))
    names = ("closure", "orders", "force_error", "certain_share", "certain_share_error")
    columns = {name: np.array([row[k] for row in rows]) for k, name in enumerate(names)}
    return {"input_error": str(input_error), "certain_by_order": by_order}, columns


def certain_signs(table: Columns, closure: str, input_error: Floats) -> Flags:
    """Loops whose smallest eigenvalue has a sign beyond the errors of rounding and of the input."""
    smallest = np.nan_to_num(table[f"{closure}_lambda_min"])
    return np.asarray(np.abs(smallest) > table[f"{closure}_error"] + input_error)


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
