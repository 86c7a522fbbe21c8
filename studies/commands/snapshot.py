"""`grainloops snapshot`."""

from __future__ import annotations

import ctypes
import os
from contextlib import suppress
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from studies.commands.common import (
    Answer,
    NoFigures,
    OneReading,
    Writing,
    answer,
    clock,
    out_or,
    shown,
)

M_ARENA_MAX = -8  # of malloc.h
JUDGES = {
    "affine": "affine closure, spins blocked",
    "traction": "traction closure, spins blocked",
    "traction_free": "traction closure, spins free",
    "packing": "in its packing, spins free",
}


def _snapshot_lines(summary: dict[str, Any]) -> list[str]:
    orders = "  ".join(f"{n}: {count}" for n, count in _grouped(summary["orders"]).items())
    lines = [
        f"{summary['grains']} grains, {summary['contacts']} contacts; mean contacts per grain "
        f"{summary['coordination']:.3f}, excluding {summary['dangling_grains']} grains with fewer "
        "than two",
        f"{summary['loops']} loops, mean order {shown(summary['mean_order'])} ({orders})",
        f"Euler's formula {'holds' if summary['euler_ok'] else 'FAILS'}",
    ]
    if "sliding_fraction" in summary:
        lines.append(f"{100 * summary['sliding_fraction']:.1f} % of the contacts slide")
    if "unstable_by_order" in summary:
        lines += _verdicts(summary)
    return lines + [f"note: {note}" for note in summary["notes"]]


def _verdicts(summary: dict[str, Any]) -> list[str]:
    """Shares of unstable loops, with what each assumes."""
    from studies.columns import definitions

    assumed = definitions("assumptions")
    lines = ["unstable loops by order:"]
    for judge in summary["unstable_by_order"]:
        name = JUDGES[judge]
        text = "  ".join(
            f"{group}: {_percent(share['mean'])}"
            for group, share in summary["unstable_by_order"][judge].items()
        )
        unknown = summary["untrusted_loops"][judge]
        lines.append(f"  {name:<32} {text}" + (f"  ({unknown} undetermined)" if unknown else ""))
    lines += [f"spins {case}: {assumed[f'spins_{case}']}" for case in ("blocked", "free")]
    if "in_packing" not in summary:
        return [*lines, assumed["cut_out"]]
    return [
        *lines,
        f"in its packing: {assumed['in_packing'].format(**summary['in_packing'])}",
        *_around(summary),
    ]


def _around(summary: dict[str, Any]) -> list[str]:
    """Lines on the surroundings of the loops and the stated error."""
    parts = "  ".join(
        f"{group}: {shown(share['median'] if share['count'] else None)}"
        for group, share in summary["surroundings_share"].items()
    )
    positive = summary["surroundings_positive"]["all"]["mean"]
    error = summary["packing_error"]
    known = (
        f"stated errors of the operators: median {error['median']:.1g}" if error["count"] else ""
    )
    return [
        f"surroundings' share of a loop's stiffness, median by order: {parts} "
        "(without loops undetermined when cut out)",
        f"loops whose surroundings have positive stiffness in all directions: "
        f"{_percent(positive)} ({known})",
    ]


def _percent(share: float) -> str:
    return "-" if share != share else f"{100 * share:.3g} %"


def _grouped(orders: dict[str, int]) -> dict[str, int]:
    """Loops by order, those of the last one and beyond together."""
    from studies.snapshot.statistics import LAST_ORDER

    counts: dict[str, int] = {}
    for n, count in orders.items():
        group = n if int(n) < LAST_ORDER else f"{LAST_ORDER}+"
        counts[group] = counts.get(group, 0) + count
    return counts


def snapshot(
    path: Annotated[Path, Parameter(help="File of the snapshot, or of its grains.")],
    /,
    *,
    writing: Writing | None = None,
    in_packing: Annotated[
        str | None,
        Parameter(
            metavar="auto|whole|blocks",
            help="Judge the loops in their packing too: the whole packing at once, blocks of it "
            "(less memory, larger errors), or auto (by the number of grains).",
        ),
    ] = None,
    no_figures: NoFigures = False,
    paraview: Annotated[
        bool, Parameter(name="--vtk", help="Write loops.vtp for ParaView.")
    ] = False,
    reading: OneReading | None = None,
) -> Answer:
    """Find the loops of a DEM snapshot and judge the stability of each."""
    writing, reading = writing or Writing(), reading or OneReading()
    out = out_or(writing.out, "snapshot", path)
    # The cores have threads of their own; numpy, loaded after this, would add as many.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    with clock("grainloops snapshot"):
        _share_memory()
        from studies.snapshot import run_snapshot

        summary = run_snapshot(
            path,
            out,
            in_packing=in_packing,
            figures=not no_figures,
            paraview=paraview,
            **writing.files(),
            **reading.how(),
        )
    return answer(writing.json, out, _snapshot_lines(summary))


def _share_memory() -> None:
    """Let threads take memory from one place (glibc); each would keep what it freed."""
    with suppress(OSError, AttributeError, TypeError):
        ctypes.CDLL(None).mallopt(M_ARENA_MAX, 1)
