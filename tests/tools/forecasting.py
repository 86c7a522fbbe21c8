"""How often forecasts of loops came true: the table that `studies.forecast` reads, and its page's.

`python -m tests.tools.forecasting measure DATA KEPT` follows every interval of the series of
`SERIES` that is in the folders DATA as a forecast would, from the earlier snapshot and the driven
strain alone, and keeps a table of its loops in KEPT. `python -m tests.tools.forecasting table KEPT`
writes `studies/forecast.json` from them, and prints how good each predictor is, each series told by
all others.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from datetime import date
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import cyclopts
import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from loops import InputError
from loops.arrays import Floats
from loops.in_place import loops_in_place
from patterns import Snapshot, read_snapshot
from patterns.snapshots.cells import cell_reader
from studies import __version__
from studies.evolve import Programmed, followed
from studies.forecast import (
    CALIBRATION,
    DEFAULTS,
    KINDS,
    REACHES,
    WAYS,
    Calibration,
    calibration,
    forecast_reach,
    parts_of,
    places,
)
from studies.forecast_figures import KIND_WORDS, reliability
from studies.series.evolution import loop_increments, sample_strain, track_loops
from studies.series.packing import DEFAULT_RATE, Rate, facts
from studies.series.skill import actual_values, score_skill
from studies.snapshot.in_packing import balance_notes, place_columns
from studies.style import LIGHT_GREY, LINE_COLOURS, drawn_file, new_panels, styled

Row = dict[str, Any]
SOFTEST = "packing_lambda_min"
# Trivial predictors, by their column; persistence is another column for each kind.
TRIVIAL = {
    "order alone": "order",
    "softest eigenvalue in its packing": SOFTEST,
    "smallest normal force": "smallest_N",
}
QUANTILES = 8
DRAWN = ("path and replay", "path alone", "replay alone", "persistence", *TRIVIAL)


class Series(NamedTuple):
    """Snapshots of one sample: their folder, the pattern of their names, pairs to forecast."""

    folder: str
    files: str
    pairs: tuple[tuple[int, int], ...]
    law: str | None = None
    cells: bool = False


def steps(*numbers: range) -> tuple[tuple[int, int], ...]:
    """Pairs of snapshots that follow each other in each of these ranges."""
    return tuple(pair for some in numbers for pair in pairwise(some))


WALLED = (*steps(range(2, 13)), *steps(range(12, 18)), (2, 7), (7, 12), (12, 17))
SERIES = (
    Series("yade-slow", "grains_{:02d}.parquet",
           (*steps(range(2, 23)), *steps(range(22, 33)), (32, 33), (22, 27), (27, 32)),
           cells=True),
    Series("yade-periodic-15", "grains_{:02d}.parquet",
           (*steps(range(2, 13)), *steps(range(12, 18)), (2, 7), (7, 12), (12, 17)), cells=True),
    Series("yade-walls-linear", "grains_{:02d}.csv.gz", WALLED),
    Series("yade-walls-rough2", "grains_{:02d}.parquet", WALLED),
    Series("yade-walls-hertz", "grains_{:02d}.csv.gz", WALLED, law="hertz"),
    Series("yade-small", "grains_{:02d}.csv.gz", ((9, 10), (10, 11))),
)  # fmt: skip


def read(data: Path, series: Series, number: int) -> Snapshot:
    """One snapshot of a series."""
    path = data / series.folder / series.files.format(number)
    how: Row = {"shear_increment": "radii"} | ({"law": series.law} if series.law else {})
    if series.cells:
        cell = cell_reader(data / series.folder / "macro.csv")(path, None)
        how["cell"] = np.reshape(cell, (2, 2))
    return read_snapshot(path, **how)


def measured(data: Path, series: Series, pair: tuple[int, int]) -> pd.DataFrame:
    """One row a loop: what a forecast says of it, what trivial predictors do, what came true."""
    before, after = (read(data, series, number) for number in pair)
    balance_notes(before)
    strain, source = sample_strain(before, after)
    assert source in ("cell", "walls")
    asked = Programmed(to=float(strain[1, 1]), programme="biaxial", axis=2, **DEFAULTS)
    rate = Rate(DEFAULT_RATE, "as given", {"inertial_number": DEFAULT_RATE})
    found = followed(before, asked, rate)
    fates = track_loops(before, after)
    own, state = loop_increments(before, after, fates), facts(before, fates)
    actual = actual_values(own | {"nonaffinity": np.ones(len(own["w2"]))}, state)
    table = pd.DataFrame({"loop": state["loop"], "order": state["order"]})
    for kind, target in KINDS.items():
        value = actual[target]
        table[kind] = np.where(np.isfinite(value) & (value != 0), value < 0, np.nan)
    for name, way in WAYS.items():
        told = places(found, way)
        for kind in KINDS:
            table[f"{name}_{kind}"] = getattr(told, kind)
    lost, past = (np.full(len(table), np.nan) for _ in range(2))
    if (data / series.folder / series.files.format(2 * pair[0] - pair[1])).is_file():
        earlier = read(data, series, 2 * pair[0] - pair[1])
        tracked = track_loops(earlier, before)
        rows = loop_increments(earlier, before, tracked)
        past[rows["loop_after"]] = -rows["w2"]
        lost = np.isnan(past).astype(float)
    table["past_unstable"], table["past_lost"], table["past_opens"] = past, lost, lost
    table[SOFTEST] = -place_columns(loops_in_place(before.scene), before.mean_kn)[SOFTEST]
    table["smallest_N"] = -state["smallest_N"]
    table["order"] = table["order"].astype(float)
    ends = {f"{name}_status": found.ways[way].status for name, way in WAYS.items()}
    reach = forecast_reach(before.scene, asked.to, asked.driven)
    return table.assign(
        series=series.folder, before=pair[0], after=pair[1], strain=asked.to, reach=reach, **ends
    )


def measure(data: list[Path], kept: Path, only: str = "") -> None:
    """Forecast every interval that is in the folders and not kept yet."""
    kept.mkdir(parents=True, exist_ok=True)
    for series in (one for one in SERIES if only in one.folder):
        for pair in series.pairs:
            file = kept / f"{series.folder}-{pair[0]:02d}-{pair[1]:02d}.parquet"
            names = [series.files.format(number) for number in pair]
            there = [d for d in data if all((d / series.folder / n).is_file() for n in names)]
            if file.exists() or not there:
                continue
            try:
                table = measured(there[0], series, pair)
            except InputError as error:
                print(f"{file.stem}: {error}", flush=True)
                continue
            table.to_parquet(file)
            row = table.iloc[0]
            print(f"{file.stem}: reach {row.reach:.3g}, path {row.path_status}", flush=True)


def level_of(reach: Floats) -> Floats:
    """Class of a reach."""
    return np.digitize(reach, REACHES) - 1


def counted(loops: pd.DataFrame) -> pd.DataFrame:
    """Rows of the calibration."""
    loops = loops.assign(level=level_of(loops["reach"].to_numpy()))
    mean = loops.groupby(["series", "level"])["reach"].transform("mean")
    tables = []
    for kind in KINDS:
        known = loops[kind].notna()
        rows = pd.DataFrame(
            {
                "series": loops["series"], "level": loops["level"], "reach": mean.round(4),
                "kind": kind,
                **{way: parts_of(loops[f"{way}_{kind}"].to_numpy()) for way in WAYS},
                "true": loops[kind],
            }
        )[known]  # fmt: skip
        keys = ["series", "level", "reach", "kind", *WAYS]
        sums = rows.groupby(keys)["true"].agg(["size", "sum"]).reset_index()
        tables.append(sums.rename(columns={"size": "loops", "sum": "true"}))
    whole = pd.concat(tables, ignore_index=True)
    return whole.astype({"true": int, "loops": int})


def predictions(loops: pd.DataFrame, kind: str) -> Iterator[tuple[str, Floats, Floats]]:
    """Name, score and probability (told by all other series) of every predictor of a kind."""
    level = level_of(loops["reach"].to_numpy())
    known = Calibration(counted(loops), {})
    base = np.full(len(loops), np.nan)
    told = {way: np.full(len(loops), np.nan) for way in ("both", *WAYS)}
    place = {way: loops[f"{way}_{kind}"].to_numpy() for way in WAYS}
    nothing = np.full(len(loops), np.nan)
    for series in loops["series"].unique():
        others = known.without(series)
        for number in np.unique(level[loops["series"] == series]):
            rows = np.flatnonzero((loops["series"] == series) & (level == number))
            reach = float(loops["reach"].to_numpy()[rows].mean())
            if number not in others.table["level"].unique():
                continue
            for way in told:
                asked = [place[one] if way in (one, "both") else nothing for one in WAYS]
                # A path that did not reach its end has no answer: the replay's is taken.
                lacks = np.isnan(asked[0][rows])
                for some in (rows[lacks], rows[~lacks]):
                    ways = [one[some] for one in asked]
                    if len(some) and not np.isnan(ways).all():
                        said, rate = others.probability(kind, *ways, reach)
                        told[way][some], base[some] = said, rate
    yield "base rate", base, base
    for way, name in (
        ("both", "path and replay"),
        ("path", "path alone"),
        ("replay", "replay alone"),
    ):
        yield name, told[way], told[way]
    for name, column in {"persistence": f"past_{kind}", **TRIVIAL}.items():
        score = loops[column].to_numpy(float)
        yield name, score, by_quantile(loops, kind, score, level)


def by_quantile(loops: pd.DataFrame, kind: str, score: Floats, level: Floats) -> Floats:
    """Probability of a score by the frequencies in its quantiles, told by all other series."""
    out, true = np.full(len(loops), np.nan), loops[kind].to_numpy(float)
    series = loops["series"].to_numpy()
    for name in np.unique(series):
        for number in np.unique(level[series == name]):
            own, others = ((series == name) == here for here in (True, False))
            others = others & (level == number) & np.isfinite(true)
            rows = np.flatnonzero(own & (level == number))
            if not others.any():
                continue
            base = true[others].mean()
            known = others & np.isfinite(score)
            if not known.any():
                out[rows] = base
                continue
            edges = np.unique(np.quantile(score[known], np.linspace(0, 1, QUANTILES + 1)[1:-1]))
            cell = np.digitize(score, edges)
            size = np.bincount(cell[known], minlength=len(edges) + 1)
            hits = np.bincount(cell[known], true[known], minlength=len(edges) + 1)
            share = (hits + base) / (size + 1)
            out[rows] = np.where(np.isfinite(score[rows]), share[cell[rows]], base)
    return out


def scores(loops: pd.DataFrame) -> pd.DataFrame:
    """One row a kind, class of reach and predictor: AUC, Brier score, and skill over the base."""
    rows, level = [], level_of(loops["reach"].to_numpy())
    for kind in KINDS:
        value = np.where(loops[kind].isna(), np.nan, np.where(loops[kind] == 1.0, -1.0, 1.0))
        reference = None
        for name, score, probability in predictions(loops, kind):
            if reference is None:
                reference = probability
            for number in np.unique(level):
                of = (level == number) & np.isfinite(value) & np.isfinite(reference)
                of &= np.isfinite(probability)
                if not of.any():
                    continue
                true = value[of] < 0
                brier, at_base = (
                    float(np.mean((p[of] - true) ** 2)) for p in (probability, reference)
                )
                skill = score_skill(score[of], value[of], signed=False)
                rows.append({"kind": kind, "level": int(number), "predictor": name,
                             "loops": int(of.sum()), "base": float(true.mean()),
                             "auc": skill["auc"], "brier": brier,
                             "brier_skill": 1 - brier / at_base})  # fmt: skip
    return pd.DataFrame(rows)


def table(kept: Path, out: Path | None = None) -> None:
    """Write the calibration from what was kept, and print the scores; `out`: also as CSV."""
    loops = pd.concat([pd.read_parquet(file) for file in sorted(kept.glob("*.parquet"))])
    loops = loops.reset_index(drop=True)
    inside = (loops["reach"] >= REACHES[0]) & (loops["reach"] < REACHES[-1])
    loops = loops[inside].reset_index(drop=True)
    rows = counted(loops)
    intervals = loops.groupby("series").apply(
        lambda own: len(own[["before", "after"]].drop_duplicates()), include_groups=False
    )
    made = {
        "made_by": "python -m tests.tools.forecasting, on series that Yade made",
        "version": __version__,
        "date": date.today().isoformat(),
        "programme": "biaxial compression along axis 2 to the driven strain of the interval",
        "replay": f"from rest, inertial number {DEFAULT_RATE:g}, damping 0.3",
        "rows": DEFAULTS["rows"],
        "series": {str(name): int(count) for name, count in intervals.items()},
        "loops": len(loops),
    }
    lines = ",\n".join(json.dumps(row) for row in rows.to_numpy().tolist())
    head = json.dumps({"made": made, "columns": [*rows.columns]}, indent=1)
    CALIBRATION.write_text(f'{head[:-2]},\n "rows": [\n{lines}\n]\n}}\n', encoding="utf-8")
    calibration.cache_clear()
    told = scores(loops)
    print(told.round(4).to_string())
    if out is not None:
        told.round(5).to_csv(out, index=False)


def mean_reaches(known: Calibration) -> pd.Series[float]:
    """Mean reach of each class."""
    return known.table.groupby("level")["reach"].mean()


@styled()
def figure_of(told: pd.DataFrame, known: Calibration) -> Figure:
    """Reliability of what each series is told by all others; ranking skill over the reach."""
    figure, (panels,) = new_panels(1, 4, 2.9, width_ratios=(1.4, 1, 1, 1))
    reliability(known, ax=panels[0])
    reach = mean_reaches(known)
    for ax, kind in zip(panels[1:], KINDS, strict=True):
        rows = told[(told["kind"] == kind) & told["predictor"].isin(DRAWN)]
        groups = rows.groupby("predictor", sort=False)
        for (name, own), colour in zip(groups, LINE_COLOURS, strict=False):
            ax.semilogx(
                own["level"].map(reach), own["auc"], "o-", color=colour, label=name, markersize=3
            )
        ax.axhline(0.5, color=LIGHT_GREY, linewidth=0.8, zorder=0)
        ax.set(title=KIND_WORDS[kind], xlabel="strain over $p/k_n$ (–)", ylim=(0.4, 1.02))
    panels[1].set_ylabel("AUC (0.5: chance)")
    handles = panels[1].get_legend_handles_labels()
    figure.legend(*handles, loc="outside lower center", ncols=3)
    return figure


def page(scored: Path) -> None:
    """Print the tables of the page from the scores."""
    told, reach = pd.read_csv(scored), mean_reaches(calibration())
    own = calibration().table
    print("| series | intervals | reach |\n|---|---|---|")
    for name, count in calibration().provenance["series"].items():
        reaches = sorted(own[own["series"] == name]["reach"].unique())
        print(f"| `{name}` | {count} | {', '.join(f'{one:.2g}' for one in reaches)} |")
    for kind in KINDS:
        print(f"\n{kind}\n\n| reach | predictor | loops | base rate | AUC | Brier skill |")
        print("|---|---|---|---|---|---|")
        for row in told[(told["kind"] == kind) & (told["predictor"] != "base rate")].itertuples():
            print(f"| {reach[row.level]:.2g} | {row.predictor} | {row.loops} | {row.base:.4f} | "
                  f"{row.auc:.3f} | {row.brier_skill:.3f} |")  # fmt: skip


def figure(scored: Path, out: Path) -> None:
    """Draw the figure of the page from the scores."""
    drawn = figure_of(pd.read_csv(scored), calibration())
    file = drawn_file(drawn, out.stem, calibration().provenance)()
    out.with_suffix(".png").write_bytes(file)


if __name__ == "__main__":
    app = cyclopts.App()
    app.command(measure)
    app.command(table)
    app.command(figure)
    app.command(page)
    app()
