"""Which indicator predicts what becomes of a loop, and how far is it from the packing's own answer?

Every structural indicator beside the rate problem, the path and the replay of the packing, over
result folders of `grainloops series --indicators`, one a packing (or, without any, over the three
intervals of the sample in the package). AUC by target and size of the strain step: the mean over
packings with its 95 % interval between packings, and the same with shuffled targets, which has to
be one half. Nothing is fitted; the sign of each indicator was fixed beforehand.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import count
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
from studies.series import skill
from studies.series.run import run_series
from studies.series.tasks import require_about
from studies.style import LIGHT_GREY, LINE_COLOURS, figure_key, new_panels, styled

# The closures are left out: they know the strain that each loop really took.
MECHANICAL = ("packing", "packing_path", "replay", "own_motion", "persistence")
# Known from one snapshot, or from the interval before it: the benchmark is among these.
STRUCTURAL = ("packing_lambda_min", "order", "sliding", "smallest_N", *skill.INDICATORS)
COMPARED = (*MECHANICAL, *STRUCTURAL)
MEANS = ["auc", "low", "high", "shuffled", "shuffled_low", "shuffled_high", "base"]
MEANS += ["above", "above_low", "above_high", "packings", "intervals"]


def sample_series(out: Path, **how: Any) -> Summary:
    """Run the series of the package's sample."""
    cells = sample_path("slow/cells.csv")
    files = sorted(cells.parent.glob("grains_*.parquet"))
    how |= {"cells": cells, "shear_increment": "radii", "workers": 1, "figures": False}
    return run_series(files, out, **how)


def scores(folder: Path, seed: int = 0) -> pd.DataFrame:
    """AUC of each predictor for each target and interval of a series, true and shuffled."""
    rooms = "loops", "increments", "packing"
    parts = [sorted((folder / room).glob("part-*.parquet")) for room in rooms]
    if not parts[-1]:
        expected = "a result folder of `grainloops series --indicators`"
        remedy = "Run this command first, and name its folder."
        raise InputError(str(folder), "no series with its packing", expected, remedy)
    rng, rows = np.random.default_rng(seed), list[dict[str, Any]]()
    for loops, state, earlier in skill.interval_columns(*parts):
        before, after = int(loops["snapshot_before"][0]), int(loops["snapshot_after"][0])
        part = require_about(folder / "increments" / f"part-{before:05d}-{after:05d}.parquet")
        # The larger principal compression of the sample, to one digit: the size of the step.
        H = np.array([part["row"][f"dH{ij}"] for ij in COMPONENTS]).reshape(2, 2)
        step = float(f"{np.linalg.eigvalsh(0.5 * (H + H.T))[-1]:.0e}")
        place = {"packing": folder.name, "step": step, "snapshot_after": after}
        shuffled: dict[str, Any] = {}
        for target, name, score, value, _ in skill.targets(loops, state, earlier):
            if name in COMPARED:
                wrong = shuffled.setdefault(target, rng.permutation(value))
                kinds = [skill.score_skill(score, flags, signed=False) for flags in (value, wrong)]
                row = place | {"target": target, "predictor": name, "shuffled": kinds[1]["auc"]}
                rows.append(row | {key: kinds[0][key] for key in ("base", "coverage", "auc")})
    return pd.DataFrame(rows)


def interval(values: Sequence[float]) -> tuple[float, float, float]:
    """Mean of independent values and its 95 % interval by Student's t; not numbers for one."""
    known = pd.Series(values, dtype=float).dropna()
    mean, half = known.mean(), student.ppf(0.975, len(known) - 1) * known.sem()
    return float(mean), float(mean - half), float(mean + half)


def by_packing(rows: pd.DataFrame) -> pd.DataFrame:
    """Means over the intervals of each packing."""
    groups = rows.groupby(["packing", "step", "target", "predictor"], sort=False)
    return groups[["auc", "shuffled", "base"]].mean().join(groups.size().rename("intervals"))


def compare(rows: pd.DataFrame) -> pd.DataFrame:
    """Means over packings and their intervals, by step, target and predictor.

    `above` is how far the rate problem lies above the predictor, with its own interval: packing by
    packing, so that what they have in common cancels.
    """
    single, keys, means = by_packing(rows), ["step", "target", "predictor"], []
    for (step, target, name), of_packings in single.groupby(keys, sort=False):
        rates = single["auc"].xs((step, target, "packing"), level=(1, 2, 3))
        auc = of_packings["auc"].droplevel([1, 2, 3])
        intervals = *interval(auc), *interval(of_packings["shuffled"])
        means.append([step, target, name, *intervals, of_packings["base"].mean(),
                      *interval((rates - auc).dropna()), auc.notna().sum(),
                      of_packings["intervals"].sum()])  # fmt: skip
    return pd.DataFrame(means, columns=[*keys, *MEANS])


def winners(table: pd.DataFrame) -> list[dict[str, Any]]:
    """The structural predictor of the largest mean AUC by target and step, and what lies above."""
    best = []
    for (target, step), rows in table.groupby(["target", "step"], sort=False):
        aucs = rows.set_index("predictor")["auc"]
        structural = aucs.reindex(STRUCTURAL).dropna()
        if len(structural):
            row = rows[rows["predictor"] == structural.idxmax()].iloc[0]
            best.append({"target": target, "step": step, "best": row["predictor"],
                         **row[["auc", "low", "high", "base", "packings"]],
                         **aucs.reindex(MECHANICAL)})  # fmt: skip
    return best


@styled()
def draw(table: pd.DataFrame) -> Figure:
    """AUC of every predictor with its interval, a panel a target, a colour a step.

    Steps that a single packing has are left out where others have several.
    """
    names = [name for name in COMPARED if name in set(table["predictor"])]
    several = table.groupby("step")["packings"].transform("max") > 1
    table = table[several] if several.any() else table
    steps = sorted(table["step"].unique())
    figure, (panels,) = new_panels(1, len(skill.TARGETS), 5.2, sharex=True, sharey=True)
    apart = np.linspace(-0.35, 0.35, 2 * len(steps) + 1)[1::2]
    for ax, target in zip(panels, skill.TARGETS, strict=True):
        ax.grid(axis="y", color=LIGHT_GREY, linewidth=0.5)
        for step, aside, colour in zip(steps, apart, LINE_COLOURS, strict=False):
            rows = table[(table["target"] == target) & (table["step"] == step)]
            rows, y = rows.set_index("predictor").reindex(names), np.arange(len(names)) + aside
            ax.plot(rows["auc"], y, "o", color=colour, markersize=3, label=f"step of {step:g}")
            ax.hlines(y, rows["low"], rows["high"], color=colour, linewidth=1.0)
            ax.plot(rows["shuffled"], y, "|", color=colour, markersize=3, alpha=0.6)
        ax.axvline(0.5, color="black", linewidth=0.6, zorder=0)
        ax.set(title=skill.TARGETS[target], xlabel="AUC", xlim=(0.25, 1.03))
    panels[0].set_yticks(range(len(names)), labels=[skill.PREDICTORS[name] for name in names])
    panels[0].set_ylim(len(names) - 0.5, -0.5)
    key = "dots: mean and 95 % interval over packings; ticks: targets shuffled"
    figure_key(figure, ncols=max(len(steps), 1), title=key)
    return figure


def main(out: Path, *folders: Path) -> dict[str, Any]:
    """Compare the predictors of the series; write table and figure, and the means by packing."""
    with TemporaryDirectory() as place:
        if not folders:
            folders = (Path(place) / "sample",)
            sample_series(*folders, indicators=True)
        rows = pd.concat(map(scores, folders, count()), ignore_index=True)
    table, means = compare(rows), by_packing(rows).reset_index()
    known = table.dropna(subset="shuffled_low")
    holds = known.eval("shuffled_low <= 0.5 <= shuffled_high")
    numbers = {
        "packings": sorted(set(rows["packing"])),
        "shuffled_mean": float(table["shuffled"].mean()),
        "share_of_shuffled_intervals_with_one_half": float(holds.mean()) if len(known) else None,
        "best_indicators": winners(table),
    }
    return save(out, "indicators", draw(table), numbers, table, by_packing=means)


if __name__ == "__main__":
    run_example(main, "[SERIES_FOLDER ...]")
