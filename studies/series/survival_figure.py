"""Which loops survive an interval: by what had been judged of them, and by their order."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from studies.series.fates import ALL, VERDICTS, Table, pooled
from studies.snapshot.figures import TITLES
from studies.snapshot.statistics import GROUPS
from studies.style import BLUE, GREY, VERMILION, new_panels, styled

LOOKS = dict(zip(VERDICTS, ((BLUE, "o"), (VERMILION, "s"), (GREY, "^")), strict=True))


@styled()
def survival_by_verdict(table: Table) -> Figure:
    """Share of the loops that survive, a row a judge: interval by interval, and order by order.

    Bars are Wilson's intervals of 95 %: what so few loops can tell, not what differs from one
    interval to the next.
    """
    present = list(dict.fromkeys(table["judge"]))
    height = 0.6 + 1.5 * len(present)
    figure, panels = new_panels(len(present), 2, height, sharey=True)
    numbers = list(dict.fromkeys(table["snapshot_after"]))
    for judge, (left, right) in zip(present, panels, strict=True):
        for shift, (verdict, look) in zip((-0.12, 0.12, 0.0), LOOKS.items(), strict=True):
            by_interval = {number: _row(table, judge, verdict, number) for number in numbers}
            by_order = {n: pooled(table, judge, verdict, n) for n in range(3, 3 + len(GROUPS))}
            _bars(left, by_interval, shift, look, verdict)
            _bars(right, by_order, shift, look, verdict)
        left.set_xticks(numbers[:: len(numbers) // 12 + 1])
        left.set_xlim(numbers[0] - 0.5, numbers[-1] + 0.5)
        right.set_xticks(range(3, 3 + len(GROUPS)), labels=GROUPS)
        right.set_xlim(2.5, 2.5 + len(GROUPS))
        left.set_ylabel(f"{TITLES[judge]}\nshare that survives")
    figure.legend(*_once(*figure.axes), loc="outside upper center", ncols=3)
    low = min(table["share_low"])
    figure.axes[0].set_ylim(low - 0.05 * (1.0 - low), 1.0 + 0.05 * (1.0 - low))
    left.set_xlabel("interval, by its later snapshot")
    right.set_xlabel("order before, all intervals together")
    return figure


def _row(table: Table, judge: str, verdict: str, number: int) -> dict[str, Any] | None:
    """All orders in one interval."""
    asked = (judge, verdict, ALL, number)
    names = ("judge", "verdict", "order", "snapshot_after")
    for k, key in enumerate(zip(*(table[name] for name in names), strict=True)):
        if key == asked:
            return {name: table[name][k] for name in ("share", "share_low", "share_high")}
    return None


def _bars(
    ax: Axes,
    found: dict[int, dict[str, Any] | None],
    shift: float,
    look: tuple[str, str],
    name: str,
) -> None:
    known = {place: one for place, one in found.items() if one is not None}
    if not known:
        return
    share, low, high = (
        np.array([one[key] for one in known.values()])
        for key in ("share", "share_low", "share_high")
    )
    colour, marker = look
    ax.errorbar(
        np.array(list(known)) + shift, share, (share - low, high - share), fmt=marker,
        color=colour, markersize=3.5, elinewidth=0.9, label=name,
    )  # fmt: skip


def _once(*axes: Axes) -> tuple[list[Any], list[str]]:
    """Handles and labels of what any of the axes shows."""
    shown = {
        label: handle
        for ax in axes
        for handle, label in zip(*ax.get_legend_handles_labels(), strict=True)
    }
    return list(shown.values()), list(shown)
