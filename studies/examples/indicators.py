"""Which indicator predicts what becomes of a loop, and how far is it from the packing's own answer?

Every structural indicator beside the rate problem, the path and the replay of the packing, over
result folders of `grainloops series --indicators`, one a packing (or, without any, over the three
intervals of the sample in the package). AUC by target and size of the strain step: the mean over
packings with its 95 % interval between packings, and the same with shuffled targets, which has to
be one half. Nothing is fitted; the sign of each indicator was fixed beforehand.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from scipy.stats import t as student

from loops import InputError
from patterns import sample_path
from stability import COMPONENTS
from studies.examples import run_example, save
from studies.output import Summary
from studies.series.run import run_series
from studies.series.skill import (
    INDICATORS,
    PREDICTORS,
    TARGETS,
    interval_columns,
    score_skill,
    targets,
)
from studies.series.tasks import require_about
from studies.style import LIGHT_GREY, LINE_COLOURS, TWO_COLUMNS, figure_key, new_figure, styled

# The closures are left out: they know the strain that each loop really took.
COMPARED = (
    *("packing", "packing_path", "replay", "own_motion", "persistence"),
    *("packing_lambda_min", "order", "sliding", "smallest_N", *INDICATORS),
)
# What one snapshot tells, or the interval before it: the benchmark is among these.
STRUCTURAL = ("packing_lambda_min", "order", "sliding", "smallest_N", *INDICATORS)
MEAN = (
    *("auc", "low", "high", "shuffled", "shuffled_low", "shuffled_high", "base"),
    *("above", "above_low", "above_high", "packings", "intervals"),
)


def sample_series(out: Path, **how: Any) -> Summary:
    """Run the series of the package's sample."""
    cells = sample_path("slow/cells.csv")
    files = sorted(cells.parent.glob("grains_*.parquet"))
    how |= {"cells": cells, "shear_increment": "radii"}
    return run_series(files, out, workers=1, figures=False, **how)


def scores(folder: Path, seed: int = 0) -> pd.DataFrame:
    """AUC of each predictor for each target and interval of a series, true and shuffled."""
    parts = [
        sorted((folder / name).glob("part-*.parquet"))
        for name in ("loops", "increments", "packing")
    ]
    if not parts[-1]:
        expected = "a result folder of `grainloops series --indicators`"
        remedy = "Run this command first, and name its folder."
        raise InputError(str(folder), "no series with its packing", expected, remedy)
    rng, rows = np.random.default_rng(seed), list[dict[str, Any]]()
    for own, state, earlier in interval_columns(*parts):
        before, after = int(own["snapshot_before"][0]), int(own["snapshot_after"][0])
        row = require_about(folder / "increments" / f"part-{before:05d}-{after:05d}.parquet")["row"]
        # The larger principal compression of the sample, to one digit: the size of the step.
        H = np.array([row[f"dH{ij}"] for ij in COMPONENTS]).reshape(2, 2)
        step = float(f"{np.linalg.eigvalsh(0.5 * (H + H.T))[-1]:.0e}")
        place = {"packing": folder.name, "step": step, "snapshot_after": after}
        shuffled: dict[str, Any] = {}
        for target, name, score, value, _ in targets(own, state, earlier):
            if name in COMPARED:
                wrong = shuffled.setdefault(target, rng.permutation(value))
                found, chance = (score_skill(score, one, signed=False) for one in (value, wrong))
                kept = {key: found[key] for key in ("base", "coverage", "auc")}
                told = {"target": target, "predictor": name, "shuffled": chance["auc"]}
                rows.append({**place, **told, **kept})
    return pd.DataFrame(rows)


def interval(values: Sequence[float]) -> tuple[float, float, float]:
    """Mean of independent values and its 95 % interval by Student's t; not numbers for one."""
    known = pd.Series(values, dtype=float).dropna()
    mean, half = known.mean(), student.ppf(0.975, len(known) - 1) * known.sem()
    return float(mean), float(mean - half), float(mean + half)


def by_packing(rows: pd.DataFrame) -> pd.DataFrame:
    """Means over the intervals of each packing."""
    keys = ["packing", "step", "target", "predictor"]
    groups = rows.groupby(keys, sort=False)
    return groups[["auc", "shuffled", "base"]].mean().join(groups.size().rename("intervals"))


def compare(rows: pd.DataFrame) -> pd.DataFrame:
    """Means over packings and their intervals, by step, target and predictor.

    `above` is how far the rate problem lies above the predictor, with its own interval: packing by
    packing, so that what they have in common cancels.
    """
    single, found = by_packing(rows), []
    for (step, target, name), own in single.groupby(["step", "target", "predictor"], sort=False):
        rates = single["auc"].xs((step, target, "packing"), level=(1, 2, 3))
        auc = own["auc"].droplevel([1, 2, 3])
        values = [*interval(auc), *interval(own["shuffled"]), float(own["base"].mean())]
        values += interval((rates - auc).dropna())
        values += int(auc.notna().sum()), int(own["intervals"].sum())
        place = {"step": step, "target": target, "predictor": name}
        found.append(place | dict(zip(MEAN, values, strict=True)))
    return pd.DataFrame(found)


def winners(table: pd.DataFrame) -> list[dict[str, Any]]:
    """The structural predictor of the largest mean AUC by target and step, and what lies above."""
    found = []
    for (target, step), own in table.groupby(["target", "step"], sort=False):
        rows = own.set_index("predictor")
        aucs = rows.reindex(STRUCTURAL)["auc"].dropna()
        if len(aucs):
            best = {"target": target, "step": step, "best": aucs.idxmax()}
            for key in ("auc", "low", "high", "base", "packings"):
                best[key] = rows.loc[best["best"], key]
            found.append(best | {name: rows["auc"].get(name) for name in COMPARED[:5]})
    return found


@styled()
def draw(table: pd.DataFrame) -> Figure:
    """AUC of every predictor with its interval, a panel a target, a colour a step.

    Steps that a single packing has are left out where others have several.
    """
    names = [name for name in COMPARED if name in set(table["predictor"])]
    several = table.groupby("step")["packings"].transform("max") > 1
    table = table[several] if several.any() else table
    steps = sorted(table["step"].unique())
    figure = new_figure(TWO_COLUMNS, 5.2, fixed=True)
    panels = figure.subplots(1, len(TARGETS), sharex=True, sharey=True)
    apart = 0.7 / max(len(steps), 1)
    for ax, target in zip(panels, TARGETS, strict=True):
        for place in range(0, len(names), 2):
            ax.axhspan(place - 0.5, place + 0.5, color=LIGHT_GREY, alpha=0.35, linewidth=0)
        for k, step in enumerate(steps):
            rows = table[(table["target"] == target) & (table["step"] == step)]
            rows = rows.set_index("predictor").reindex(names)
            y = np.arange(len(names)) + apart * (k - 0.5 * (len(steps) - 1))
            colour, label = LINE_COLOURS[k % len(LINE_COLOURS)], f"step of {step:g}"
            ax.plot(rows["auc"], y, "o", color=colour, markersize=3, label=label)
            ax.hlines(y, rows["low"], rows["high"], color=colour, linewidth=1.0)
            ax.plot(rows["shuffled"], y, "|", color=colour, markersize=3, alpha=0.6)
        ax.axvline(0.5, color="black", linewidth=0.6, zorder=0)
        ax.set(title=TARGETS[target], xlabel="AUC", xlim=(0.25, 1.03))
    panels[0].set_yticks(range(len(names)), labels=[PREDICTORS[name] for name in names])
    panels[0].set_ylim(len(names) - 0.5, -0.5)
    title = "dots: mean and 95 % interval over packings; ticks: targets shuffled"
    figure_key(figure, ncols=max(len(steps), 1), title=title)
    return figure


def main(out: Path, *folders: Path) -> dict[str, Any]:
    """Compare the predictors of the series; write table and figure, and the means by packing."""
    with TemporaryDirectory() as place:
        every = folders or (Path(place) / "sample",)
        if not folders:
            sample_series(*every, indicators=True)
        rows = pd.concat([scores(one, seed) for seed, one in enumerate(every)], ignore_index=True)
    table = compare(rows)
    known = table[table["shuffled_low"].notna()]
    holds = (known["shuffled_low"] <= 0.5) & (known["shuffled_high"] >= 0.5)
    numbers = {
        "packings": sorted(set(rows["packing"])),
        "shuffled_mean": float(table["shuffled"].mean()),
        "share_of_shuffled_intervals_with_one_half": float(holds.mean()) if len(known) else None,
        "best_indicators": winners(table),
    }
    own = by_packing(rows).reset_index()
    return save(out, "indicators", draw(table), numbers, table, by_packing=own)


if __name__ == "__main__":
    run_example(main, "[SERIES_FOLDER ...]")
