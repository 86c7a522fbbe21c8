"""Error against time: a probe's directions by rates, in one solve each, and from event to event.

A held state (Yade, 2000 discs) was strained along 24 directions by forks of the running simulation;
here is every third.
Stress increments against Yade's, and processor time a direction: of the rate problem with a yield
band, of increments with candidates from several shares of their strength, of paths by events.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter

from loops import love_weber_stress
from loops.arrays import Floats
from stability import follow
from stability.packing import rate_problem
from stability.packing.probe import stage_along
from stability.programmes import direction_control
from studies.examples import run_example, save
from studies.examples.probing import convected, increments, state
from studies.style import BLUE, GREEN, TWO_COLUMNS, VERMILION, new_figure, styled

AMPLITUDES = (1e-5, 5e-5)
# Of 24 directions.
EVERY = 3
SHARES = (0.95, 0.9, 0.7, 0.5)
COLOURS = {"rates": BLUE, "increment": VERMILION, "events": GREEN}


def answers(
    amplitudes: Sequence[float], wanted: Floats
) -> Iterator[tuple[str, float, Floats, float]]:
    """Method, amplitude, stress increments (D, 2, 2) over it, and seconds a direction."""
    snapshot, _ = state("before")
    ways = {"rates, band 0.99": 0.99} | {f"increment, from {share:g}": share for share in SHARES}
    for name, band in ways.items():
        began = process_time()
        rates = rate_problem(snapshot.scene, yield_band=band)
        one: Any = rates.increment if name[0] == "i" else rates.solved
        ready = process_time() - began
        for amplitude in amplitudes:
            began = process_time()
            along = [direction_control(amplitude * each, "diagonal", "strain") for each in wanted]
            solved = list(map(one, along))
            spent = ready + process_time() - began
            stress = np.array([getattr(each, "response", each).stress_rate for each in solved])
            yield name, amplitude, stress / amplitude, spent / len(wanted)
    for amplitude in amplitudes:
        began, ends = process_time(), []
        for direction in wanted:
            stage = stage_along(direction, "diagonal", "strain", amplitude)
            path = follow(snapshot, stage, closure="packing")
            ends.append((path.P[-1] - path.P[0]).reshape(2, 2))
        spent = process_time() - began
        yield "events", amplitude, np.array(ends) / amplitude, spent / len(wanted)


def main(out: Path) -> dict[str, Any]:
    """Compare the methods; write a table with a row per method and amplitude, and the figure."""
    snapshot, measured = state("before")
    stress, rows = love_weber_stress(snapshot.graph), []
    theta = np.unique(measured["theta_deg"])[::EVERY]
    wanted = np.column_stack([np.cos(np.radians(theta)), np.sin(np.radians(theta))])
    more = convected(np.array([np.diag(direction) for direction in wanted]), stress)
    for method, amplitude, P, seconds in answers(AMPLITUDES, wanted):
        part = measured[np.isclose(measured["amplitude"], amplitude)]
        part = part[part["theta_deg"].isin(theta)].sort_values("theta_deg")
        actual = increments(part)[1]
        error = np.linalg.norm(P + more - actual, axis=(1, 2))
        error = 100.0 * error / np.linalg.norm(actual, axis=(1, 2))
        rows.append({
            "method": method, "amplitude": amplitude, "median": float(np.median(error)),
            "q90": float(np.quantile(error, 0.9)), "largest": float(error.max()),
            "seconds": seconds,
        })  # fmt: skip
    table = pd.DataFrame(rows)
    return save(out, "probe_increment", draw(table), {"rows": rows}, table)


@styled()
def draw(table: pd.DataFrame) -> Figure:
    """Median error, with a line up to the error of nine in ten directions, over the time."""
    figure = new_figure(TWO_COLUMNS, 2.6)
    panels = figure.subplots(1, len(AMPLITUDES), sharey=True)
    marks = dict(zip(SHARES, "^sDv", strict=True))
    for ax, amplitude in zip(panels, AMPLITUDES, strict=True):
        for row in table[table["amplitude"] == amplitude].itertuples():
            kind, _, share = str(row.method).partition(", ")
            mark = marks.get(float(share[5:])) if kind == "increment" else "o"
            colour = COLOURS[kind]
            ax.plot([row.seconds] * 2, [row.median, row.q90], color=colour, linewidth=1.0)
            ax.plot(
                row.seconds, row.median, mark, color=colour, markersize=4, label=row.method,
                linestyle="none",
            )  # fmt: skip
        ax.set(xscale="log", yscale="log", xlabel="time a direction (s)")
        ax.set_title(f"amplitude {amplitude:g}")
    panels[0].set_ylabel("error of the stress increment (%)")
    for ax in panels:
        ax.xaxis.set_minor_formatter(NullFormatter())
    panels[1].legend(fontsize=6, loc="lower left")
    return figure


if __name__ == "__main__":
    run_example(main)
