"""Kinetics of the orders of a series: rates, detailed balance and the steady state."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from loops import OrderKinetics, order_kinetics
from loops.kinetics import FATES, OrderEvents


def kinetics_of(
    events: Sequence[Mapping[str, Any]], strain: Sequence[float | None]
) -> tuple[OrderKinetics | None, str]:
    """Kinetics of the events kept beside the parts, and what time is; none without an event."""
    intervals = [_as_arrays(one) for one in events]
    if not any(len(one.pairs) for one in intervals):
        return None, ""
    steps = np.diff(np.array(strain, dtype=float))
    known = bool((steps > 0).all())
    per = "accumulated shear strain" if known else "interval"
    return order_kinetics(intervals, steps if known else None), per


def _as_arrays(kept: Mapping[str, Any]) -> OrderEvents:
    names = ("before", "after", "pairs", "opened", "closed")
    before, after, pairs, opened, closed = (np.array(kept[n], dtype=np.int64) for n in names)
    fates = {name: int(kept[name]) for name in FATES}
    return OrderEvents(before, after, pairs.reshape(-1, 2), opened, closed, **fates)


def kinetics_tables(kinetics: OrderKinetics) -> dict[str, dict[str, Any]]:
    """`kinetics`, one row a pair of orders, and `kinetics_orders`, one row an order."""
    steady = kinetics.steady()
    order = np.flatnonzero((kinetics.loops > 0) | kinetics.stoichiometry.any(axis=1))
    # The rates say nothing of orders that no event touched.
    touched = kinetics.stoichiometry.any(axis=1)
    orders = {
        "order": order,
        "observed_share": (kinetics.loops / kinetics.loops.sum())[order],
        "steady_share": np.where(touched, steady.share, np.nan)[order],
        "steady_error": np.where(touched, steady.error, np.nan)[order],
    }
    return {"kinetics": kinetics.table(), "kinetics_orders": orders}


def kinetics_summary(kinetics: OrderKinetics, per: str, opened: int, closed: int) -> dict[str, Any]:
    """Counts, how much of what happened they hold, and the tests."""
    balance = kinetics.balance()
    earlier = max(sum(getattr(kinetics, name) for name in FATES), 1)
    return {
        "per": per,
        "openings": int(kinetics.opened.sum()),
        "closings": int(kinetics.closed.sum()),
        "share_of_opened": float(kinetics.opened.sum() / max(opened, 1)),
        "share_of_closed": float(kinetics.closed.sum() / max(closed, 1)),
        **{f"share_{name}": getattr(kinetics, name) / earlier for name in FATES},
        **{name: value for name, value in balance._asdict().items() if name not in ("z", "p")},
    }
