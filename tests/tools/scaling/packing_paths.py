"""Paths of packings by events, beside their replay and a DEM code: skill, probes, rates, growth.

`python -m tests.tools.scaling.packing_paths WHAT --out DIR [--collection DIR]`, where WHAT is

- `skill`: AUC of every predictor over the strain of a step (Yade's slow compression, `yade-slow` of
  the collection of DEM samples);
- `steps`: path, by both ways past an instability, over every step of 2e-5 to 5e-4 of `yade-slow`:
  skill for W2 < 0, contacts closed and opened of Yade's, events, unstable contacts;
- `probes`: a path against replays at three rates and against Yade, over the amplitude;
- `rates`: replays at four rates, against path and Yade;
- `growth`: time of an event and of a replay, and memory, over the number of grains;
- `past`: both ways past an instability, against slow replays that keep the load of the start, over
  steps of 1e-4 and of 2e-5 of `yade-slow` and over probes along the softest direction;
- `series`: skill over every interval of every series of `tests.tools.forecasting` that is in the
  collection (its scripts make them): path by both ways past an instability, replays at the rate of
  the sample from rest and with the velocities of the files, the grains' own motion, the rate
  problem, persistence;
- `forecasts`: axial stress over the next four or six snapshots of these series, from one;
- `bonded`: the sample `bonded` of the project, discs with bonds that break: stress, contacts lost
  and skill of the path with `dynamic` and of a replay, interval by interval.

Times are the processor's.
"""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated, Any

import cyclopts
import numpy as np
import pandas as pd
from cyclopts import Parameter
from matplotlib.figure import Figure
from matplotlib.ticker import NullLocator

from loops import GrainGraph, InputError, LinearFrictional, Scene, find_faces
from loops.arrays import Floats
from patterns import Snapshot, read_snapshot, sample_path
from stability import Programme, Stage, follow
from stability.packing import loop_changes, replay
from studies.evolve import run_evolve
from studies.examples.probing import STRESS, state
from studies.output import provenance, result_folder, write_table
from studies.reading import rows_by_number
from studies.series.evolution import loop_increments, sample_strain, track_loops
from studies.series.loading import stress_of
from studies.series.packing import Following, interval_rate, packing_predictions
from studies.series.run import run_series
from studies.series.skill import PREDICTORS, mean_skill, score_skill
from studies.style import LINE_COLOURS, TWO_COLUMNS, new_figure, save_figure, styled
from tests.tools.forecasting import SERIES, Series, read
from tests.tools.scaling.in_place import replicated
from tests.tools.scaling.measure import MB, _peak, _reset_peak, _timed

followed = partial(follow, closure="packing")
Rows = list[dict[str, Any]]
# Strain of a step, and series of snapshots of yade-slow that are so far apart: from 2 to 22 they
# are so by 2e-5, to 32 by 1e-4. Those of the last overlap.
STEPS: dict[float, tuple[Sequence[int], ...]] = {
    2e-5: (range(2, 23),),
    1e-4: ((*range(2, 22, 5), *range(22, 33)),),
    2e-4: ((*range(2, 22, 10), *range(22, 33, 2)),),
    5e-4: tuple((2 + 5 * k, 23 + k, 28 + k) for k in range(5)),
}
# Steps that both ways past an instability are followed over.
BOTH_WAYS = (2e-5, 1e-4)
SHOWN = ("replay", "packing_path", "packing", "persistence", "traction_free", "order")
TARGETS = {
    "W2_negative": "$W_2 < 0$",
    "nonaffine": "least affine tenth",
    "contact_lost": "contact lost",
    "topology": "topology changed",
}
# Inertial numbers: Yade's probes were made at 2e-6.
PROBED, RATES = (2e-5, 2e-6, 2e-7), (2e-5, 2e-6, 2e-7, 2e-8)
TIMES = (1, 2, 4)
# Shear forces of the copies are less by up to so much: copies that agree would act as one.
NOISE = 0.01
# Snapshots of yade-slow before the steps of 1e-4 and of 2e-5; degrees of the softest direction;
# inertial number of the replays that the ways past an instability are held against.
BEFORE, SOFTEST, SLOW = (*range(22, 30), 12, 18, 20), 150.0, 2.5e-7
# Paths of `series`: both ways past an instability; without the load that balances the start.
PATHS: dict[str, dict[str, Any]] = {
    "viscous": {"past": "viscous"},
    "dynamic": {"past": "dynamic"},
    "let_go": {"past": "viscous", "load_kept": 0.0},
}
# Starts of forecasts and the snapshots they go on for: steps of 2e-5, then of 1e-4.
STARTS = {
    "yade-slow": ((2, 6), (6, 6), (10, 6), (15, 6), (22, 4), (25, 4), (28, 4)),
    "yade-small": (),
    "others": ((3, 6), (6, 6), (12, 4), (13, 4)),
}
# Fall of the stress, over its first value, that counts as a drop.
DROP = 1e-4
UNITS = "seconds of the processor, MB = 2^20 bytes, strain, shares"


def by_step(collection: Path) -> Iterator[dict[str, Any]]:
    """AUC of each predictor for each target, means over the steps weighted by loops."""
    for step, series in STEPS.items():
        table = pd.concat([_predicted(collection, numbers) for numbers in series])
        steps = sum(len(numbers) - 1 for numbers in series)
        for target in TARGETS:
            for name, row in mean_skill(table, target).items():
                numbers_of = {key: row.get(key) for key in ("auc", "auc_min", "auc_max", "base")}
                place = {"step": step, "steps": steps, "target": target, "predictor": name}
                yield place | numbers_of | {"loops": row["loops"]}


def _predicted(collection: Path, numbers: Sequence[int]) -> pd.DataFrame:
    """`skill.parquet` of a series of snapshots."""
    with TemporaryDirectory() as folder:
        run_series(
            [collection / f"yade-slow/grains_{number:02d}.parquet" for number in numbers],
            Path(folder) / "out", cells=collection / "yade-slow/macro.csv", workers=1,
            shear_increment="radii", in_packing="events", figures=False,
        )  # fmt: skip
        return pd.read_parquet(Path(folder) / "out/skill.parquet")


def by_single_step(collection: Path) -> Iterator[dict[str, Any]]:
    """What the path foretells of each step, by both ways past an instability."""
    cells = rows_by_number(collection / "yade-slow/macro.csv")
    for step, series in STEPS.items():
        for number, after in [pair for numbers in series for pair in pairwise(numbers)]:
            one, two = (_slow(collection, cells, k) for k in (number, after))
            graph, law = one.graph, one.mechanics()[0]
            was, now = _contacts(graph), _contacts(two.graph)
            row: dict[str, Any] = {"step": step, "before": number, "after": after}
            row |= {"opened": len(was - now), "closed": len(now - was)}
            for past in ("viscous", "dynamic") if step in BOTH_WAYS else ("viscous",):
                how = {"instabilities": 1000, "past": past}
                path, spent = _spent(
                    followed, Scene(graph, law), strained(_strain(one, two)), **how
                )
                end, unstable = path.states[-1], path.of_kind("instability")
                work = loop_changes(graph, end, one.faces).normalised_work
                carries = _contacts(end.graph())
                yield row | {
                    "past": past,
                    "status": path.status,
                    **{key: _skill(one, two, work)[key] for key in ("auc", "rank_correlation")},
                    "opened_too": len((was - now) & (was - carries)),
                    "closed_too": len((now - was) & (carries - was)),
                    "events": len(path.events),
                    "instabilities": len(unstable),
                    "unstable": len({event.contacts for event in unstable}),
                    "cpu_seconds": spent,
                }


@styled()
def skill_figure(rows: Rows) -> Figure:
    """AUC over the strain of a step, a panel a target."""
    table = pd.DataFrame(rows)
    figure = new_figure(TWO_COLUMNS, 2.8)
    panels = figure.subplots(1, len(TARGETS), sharey=True)
    for ax, (target, title) in zip(panels, TARGETS.items(), strict=True):
        for name, colour, mark in zip(SHOWN, LINE_COLOURS, "os^vDP", strict=False):
            own = table[(table.target == target) & (table.predictor == name)]
            look = {"color": colour, "label": PREDICTORS[name], "markersize": 3}
            ax.semilogx(own.step, own.auc, f"{mark}-", **look)
        ax.axhline(0.5, color="0.7", linewidth=0.8)
        ax.set(title=title, xlabel="axial strain of a step")
        ax.set_xticks(list(STEPS), [f"{step:.0e}".replace("e-0", "e-") for step in STEPS])
        ax.xaxis.set_minor_locator(NullLocator())
    panels[0].set_ylabel("AUC")
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return figure


def strained(H: Floats, parameter: float = 1.0) -> Stage:
    """A displacement gradient prescribed."""
    given = Programme("strain", np.zeros((4, 4)), np.eye(4), np.ravel(H))
    return Stage(given, "parameter", parameter)


def probed(name: str) -> Iterator[dict[str, Any]]:
    """Stress increments along every other of Yade's directions, by path, replays, Yade; errors."""
    snapshot, measured = state(name)
    law = one_spring(snapshot)
    amplitudes = np.sort(measured["amplitude"].unique())
    for theta, rows in list(measured.sort_values("amplitude").groupby("theta_deg"))[::2]:
        # Axial strains are counted from the start of the probe.
        direction = np.diag([np.cos(np.radians(theta)), np.sin(np.radians(theta))])
        stages = [strained(direction, step) for step in np.diff(amplitudes, prepend=0.0)]
        path, spent = _spent(followed, Scene(snapshot.graph, law), stages, instabilities=1000)
        if path.status != "finished":
            continue
        stress = np.array([one.stress for one in path.states])
        moves = {"path": stress[1:] - stress[0]}
        moves["yade"] = rows[STRESS].to_numpy(float).reshape(-1, 2, 2)
        for rate in PROBED:
            stresses = replayed(snapshot.graph, law, direction, amplitudes, rate)
            moves[f"replay {rate:g}"] = stresses - stress[0]
        for k, amplitude in enumerate(amplitudes):
            size = np.linalg.norm(moves["path"][k])
            for other in list(moves)[1:]:
                error = np.linalg.norm(moves["path"][k] - moves[other][k])
                error /= np.linalg.norm(moves[other][k])
                yield {
                    "state": name, "theta_deg": theta, "amplitude": amplitude, "against": other,
                    "error": error, "increment": size, "events": len(path.events),
                    "cpu_seconds": spent,
                }  # fmt: skip


def replayed(
    graph: GrainGraph, law: LinearFrictional, direction: Floats, amplitudes: Floats, rate: float
) -> Floats:
    """Stresses at the amplitudes of one replay from rest."""
    first, stresses = np.array(graph.cell), []
    pace, going = 0.0, dict[str, Any]()
    for amplitude, before in zip(amplitudes, [0.0, *amplitudes[:-1]], strict=True):
        after = (np.eye(2) - amplitude * direction) @ first
        H = np.eye(2) - after @ np.linalg.inv(np.array(graph.cell))
        # The rate is that of the strain, whatever the pressure has become.
        if not going:
            end = replay(Scene(graph, law), H, inertial_number=rate)
            pace = end.duration / amplitude
        else:
            end = replay(Scene(graph, law), H, duration=pace * (amplitude - before), **going)
        graph, going = end.state.graph(), {"velocity": end.velocity, "spin": end.spin}
        stresses.append(end.state.stress)
    return np.array(stresses)


@styled()
def probes_figure(rows: Rows) -> Figure:
    """Errors over the amplitude: median and 90 % of the directions."""
    table = pd.DataFrame(rows)
    names = {"yade": "Yade, 2e-6"} | {f"replay {rate:g}": f"replay, {rate:g}" for rate in PROBED}
    states = list(table.state.unique())
    figure = new_figure(TWO_COLUMNS, 3.0)
    panels = figure.subplots(1, len(states), sharey=True, squeeze=False)[0]
    for ax, where in zip(panels, states, strict=True):
        for (against, label), colour in zip(names.items(), LINE_COLOURS, strict=False):
            own = table[(table.state == where) & (table.against == against)]
            error = 100 * own.groupby("amplitude")["error"].quantile([0.5, 0.9]).unstack()
            ax.loglog(error.index, error[0.5], "o-", color=colour, label=label, markersize=3)
            ax.loglog(error.index, error[0.9], ":", color=colour)
        ax.set(title=f"{where} the peak", xlabel="amplitude of the probe")
    panels[0].set_ylabel("path against it: error of the\nstress increment (%), dotted: 90 %")
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=4)
    return figure


def by_rate(collection: Path) -> Iterator[dict[str, Any]]:
    """Replays to 2e-5 from rest, at four rates, against the path.

    From a state that was held before, and over a step of the compression, against Yade as well.
    """
    cells = rows_by_number(collection / "yade-slow/macro.csv")
    one, two = (_slow(collection, cells, k) for k in (6, 7))
    held = state("before")[0]
    for name, start, end, H in (
        ("held", held, None, 2e-5 * np.diag([-0.6, 0.8])),
        ("in motion", one, two, _strain(one, two)),
    ):
        graph, law, faces = start.graph, start.mechanics()[0], find_faces(start.graph)
        path = followed(Scene(graph, law), strained(H), instabilities=1000)
        before, after = (path.states[k].forces[: graph.contact_count] for k in (0, -1))
        told = loop_changes(graph, path.states[-1], faces).normalised_work
        row = {"state": name, "unbalanced_before": path.states[0].unbalanced}
        row["events"] = len(path.events)
        yield row | {"rate": 0.0, "auc": _auc(start, end, told)}
        for rate in RATES:
            found, spent = _spent(replay, Scene(graph, law), H, inertial_number=rate)
            forces = found.state.forces[: graph.contact_count]
            work = loop_changes(graph, found.state, faces).normalised_work
            known = np.isfinite(work) & np.isfinite(told)
            yield row | {
                "rate": rate,
                "steps": found.steps,
                "cpu_seconds": spent,
                "unbalanced": found.state.unbalanced,
                "from_path": np.linalg.norm(forces - after) / np.linalg.norm(after - before),
                "signs_of_path": float(np.mean((work < 0)[known] == (told < 0)[known])),
                "auc": _auc(start, end, work),
            }


@styled()
def rates_figure(rows: Rows) -> Figure:
    """Distance from the path over the rate, and skill at predicting Yade."""
    table = pd.DataFrame(rows)
    figure = new_figure(TWO_COLUMNS, 2.6)
    left, right = figure.subplots(1, 2)
    words = {"held": "from a state at rest", "in motion": "a step of the compression"}
    for (name, own), colour in zip(table.groupby("state"), LINE_COLOURS, strict=False):
        moving, still = own[own.rate > 0], own[own.rate == 0]
        left.loglog(moving.rate, moving.from_path, "o-", color=colour, label=words[name])
        if own.auc.notna().all():
            right.semilogx(moving.rate, moving.auc, "o-", color=colour)
            right.axhline(still.auc.iloc[0], color=colour, linestyle="--", linewidth=0.8)
    left.set(
        xlabel="inertial number of the replay",
        ylabel="forces: distance from the path\nover what the path changes",
    )
    right.set(xlabel=left.get_xlabel(), ylabel="AUC for Yade's $W_2 < 0$\n(dashed: path)")
    left.legend()
    return figure


def one_spring(snapshot: Snapshot) -> LinearFrictional:
    """One spring for all contacts, those to come too."""
    own = snapshot.mechanics()[0]
    kn, kt, mu = (float(np.median(k)) for k in (own.kn, own.kt, own.mu))
    return LinearFrictional(kn, kt, mu, "radii")


def grown(times: int) -> dict[str, Any]:
    """Time and memory of a path of some 300 events, and of 1000 steps of a replay, at one size."""
    graph, law = replicated(times, sliding=False)
    rng = np.random.default_rng(1)
    less = 1.0 - NOISE * rng.random(graph.contact_count)
    graph = graph.replace(shear_force=graph.shear_force * less, regime=None)
    H = 1e-5 / times**2 * np.diag([-1.33, 1.0]) / np.hypot(1.33, 1.0)
    # Loads what is compiled.
    small = replicated(1, sliding=False)
    replay(
        Scene(*small), 1e-3 * H, duration=10.0, time_step=1.0, mass=small[1].kn[0] * np.ones(2000)
    )
    followed(Scene(*small), strained(1e-2 * H))
    row: dict[str, Any] = {"grains": graph.grain_count, "contacts": graph.contact_count}
    mass = np.full(graph.grain_count, float(law.kn[0]))
    for name, steps in (("replay", 200), ("longer replay", 1200)):
        before = _reset_peak()
        how = {"duration": steps * 0.3, "time_step": 0.3, "mass": mass}
        _, row[f"{name} seconds"] = _spent(replay, Scene(graph, law), H, **how)
        row["replay_mb"] = (_peak() - before) / MB
    row["step_ms"] = row.pop("longer replay seconds") - row.pop("replay seconds")
    before = _reset_peak()
    path, spent = _spent(followed, Scene(graph, law), strained(H), instabilities=10**6)
    unstable = len({event.contacts for event in path.of_kind("instability")})
    return row | {
        "path_mb": (_peak() - before) / MB, "path_seconds": spent, "events": len(path.events),
        "event_ms": 1e3 * spent / max(len(path.events), 1), "intervals": path.intervals,
        "unstable": unstable, "status": path.status,
    }  # fmt: skip


def growth() -> Iterator[dict[str, Any]]:
    """Each size in a process of its own."""
    for times in TIMES:
        with multiprocessing.get_context("spawn").Pool(1) as pool:
            yield pool.apply(grown, (times,))


@styled()
def growth_figure(rows: Rows) -> Figure:
    """Times and memory over the number of grains."""
    table = pd.DataFrame(rows)
    figure = new_figure(TWO_COLUMNS, 2.6)
    times, memory = figure.subplots(1, 2)
    shown = {"event_ms": "path: an event", "step_ms": "replay: a step"}
    for (name, label), colour in zip(shown.items(), LINE_COLOURS, strict=False):
        times.loglog(table.grains, table[name], "o-", color=colour, label=label)
    for name, colour in zip(("path", "replay"), LINE_COLOURS, strict=False):
        memory.loglog(table.grains, table[f"{name}_mb"], "o-", color=colour, label=name)
    times.set(xlabel="number of grains", ylabel="processor time (ms)")
    memory.set(xlabel="number of grains", ylabel="memory (MB)")
    for ax in (times, memory):
        ax.set_xticks(table.grains, [f"{count:,}" for count in table.grains])
        ax.xaxis.set_minor_locator(NullLocator())
        ax.legend()
    return figure


def by_way(collection: Path) -> Iterator[dict[str, Any]]:
    """Both ways past an instability, against slow replays that keep the load of the start."""
    cells = rows_by_number(collection / "yade-slow/macro.csv")
    for number in BEFORE:
        one, two = (_slow(collection, cells, k) for k in (number, number + 1))
        yield from _ways(str(number), one, two, one.mechanics()[0], _strain(one, two))
    for name in ("before", "after"):
        held = state(name)[0]
        angle = np.radians(SOFTEST)
        yield from _ways(
            f"probe {name} the peak",
            held,
            None,
            one_spring(held),
            5e-5 * np.diag([np.cos(angle), np.sin(angle)]),
        )


def _ways(
    name: str, one: Snapshot, two: Snapshot | None, law: LinearFrictional, H: Floats
) -> Iterator[dict[str, Any]]:
    graph, faces = one.graph, find_faces(one.graph)
    slow, spent = _spent(replay, Scene(graph, law), H, inertial_number=SLOW, balanced=True)
    told = loop_changes(graph, slow.state, faces).normalised_work
    row = {"start": name, "strain": float(np.linalg.norm(H)), "replay_seconds": spent}
    row["replay_auc"] = _auc(one, two, told)
    carry = _contacts(graph)
    lost = set() if two is None else carry - _contacts(two.graph)
    lost_slowly = carry - _contacts(slow.state.graph())
    row |= {"opened": len(lost), "replay_opened": len(lost_slowly)}
    row["replay_opened_too"] = len(lost & lost_slowly)
    for past in ("viscous", "dynamic"):
        path, spent = _spent(
            followed, Scene(graph, law), strained(H), instabilities=1000, past=past
        )
        first, last, wanted = (
            end.forces[: graph.contact_count] for end in (*path.states, slow.state)
        )
        work = loop_changes(graph, path.states[-1], faces).normalised_work
        known = np.isfinite(work) & np.isfinite(told)
        unstable, opened = path.of_kind("instability"), carry - _contacts(path.states[-1].graph())
        yield row | {
            "past": past,
            "status": path.status,
            "opened_too": len(lost & opened),
            "opened_with_replay": len(lost_slowly & opened),
            "from_replay": np.linalg.norm(last - wanted) / np.linalg.norm(wanted - first),
            "signs_of_replay": float(np.mean((work < 0)[known] == (told < 0)[known])),
            "auc": _auc(one, two, work),
            "instabilities": len(unstable),
            "unstable": len({event.contacts for event in unstable}),
            "released": path.work[-1, 3] / path.work[-1, 0],
            "events": len(path.events),
            "cpu_seconds": spent,
        }


def by_series(collection: Path) -> Iterator[dict[str, Any]]:
    """AUC for W2 < 0 of every interval of every series, from the strain of the sample alone.

    Replays take the time of the interval, from rest and with the velocities of the file; `spread`
    is the distance of two from rest, with a damping of 0.1 and 0.6, over what the interval changes.
    """
    for series in SERIES:
        if (collection / series.folder).is_dir():
            for pair in series.pairs:
                yield {"series": series.folder} | _of_interval(collection, series, pair)


def _of_interval(collection: Path, series: Series, pair: tuple[int, int]) -> dict[str, Any]:
    macro = pd.read_csv(collection / series.folder / "macro.csv").set_index("snap")
    one, two = (read(collection, series, number) for number in pair)
    scene, (H, _) = one.scene, sample_strain(one, two)
    rate = interval_rate(one, two, H, macro.time[list(pair)].tolist(), Following()).options
    rest = {"duration": rate["duration"], "mass": rate["mass"]}
    row: dict[str, Any] = {"before": pair[0], "after": pair[1], "strain": H[1, 1]}
    row |= {"step": float(f"{H[1, 1]:.0e}"), "unbalanced": macro.unbalanced[pair[0]]}
    ends = {
        "replay_rest": replay(scene, H, **rest).state,
        "replay_moving": replay(scene, H, **rate).state,
    }
    for way, how in PATHS.items():
        path = followed(scene, strained(H), instabilities=1000, **how)
        row |= {f"{way}_status": path.status, f"{way}_events": len(path.events)}
        row[f"{way}_unstable"] = len({event.contacts for event in path.of_kind("instability")})
        if path.status == "finished":
            ends[way] = path.states[-1]
    for name, end in ends.items():
        row[name] = _auc(one, two, loop_changes(scene.graph, end, one.faces).normalised_work)
        row[f"{name}_stress"] = end.stress[1, 1]
    row["stress"] = stress_of(two)[1, 1]
    little, much = (replay(scene, H, **rest, damping=d).state.forces for d in (0.1, 0.6))
    own = scene.graph.contact_count
    changed = np.linalg.norm(little[:own] - path.states[0].forces[:own])
    row["spread"] = np.linalg.norm(little[:own] - much[:own]) / changed
    column, why, _ = packing_predictions(one, two, track_loops(one, two), 0.99)
    row |= {"rate_problem": why["packing_status"]}
    for name, source in {"own_motion": "own_w2", "packing": "packing_w2"}.items():
        row[name] = _auc(one, two, np.asarray(column[source]))
    earlier, past_work = 2 * pair[0] - pair[1], np.full(len(one.faces.loops), np.nan)
    if (collection / series.folder / series.files.format(earlier)).is_file():
        zero = read(collection, series, earlier)
        table = loop_increments(zero, one, track_loops(zero, one))
        past_work[table["loop_after"]] = table["w2"]
        row["persistence"] = _auc(one, two, past_work)
    scored = _skill(one, two, np.zeros(len(past_work)))
    return row | {"loops": scored["loops"], "base": scored["base"]}


def by_start(collection: Path) -> Iterator[dict[str, Any]]:
    """Forecasts of the axial stress over several snapshots, by path, replay and trivial ways.

    A drop is a fall between two snapshots by more than `DROP` of the stress; `lead` is the strain
    from the start to the last drop that was told. The trend is a line through two snapshots.
    """
    for series in SERIES:
        if (collection / series.folder).is_dir():
            for start, count in STARTS.get(series.folder, STARTS["others"]):
                row = {"series": series.folder, "start": start, "snapshots": count}
                yield row | _forecast(collection, series, range(start, start + count + 1))


def _forecast(collection: Path, series: Series, numbers: range) -> dict[str, Any]:
    folder = collection / series.folder
    one, two = (read(collection, series, number) for number in (numbers[0] - 1, numbers[0]))
    first, end = stress_of(two)[1, 1], read(collection, series, numbers[-1])
    to = float(sample_strain(two, end)[0][1, 1])
    law = {"law": series.law} if series.law else {}
    with TemporaryDirectory() as out:
        summary = run_evolve(
            [folder / series.files.format(number) for number in numbers], Path(out) / "out",
            cells=folder / "macro.csv" if series.cells else None, times=folder / "macro.csv",
            by="both", programme="biaxial", axis=2, to=to, instabilities=1000,
            shear_increment="radii", figures=False, **law,
        )  # fmt: skip
        told = pd.read_parquet(Path(out) / "out/forecast.parquet")
    slope = (first - stress_of(one)[1, 1]) / sample_strain(one, two)[0][1, 1]
    told["stress_trend"] = first + slope * told.driven
    fell = {
        way: np.diff([first, *told[f"stress_{way}"]]) < -DROP * first
        for way in ("dem", "events", "replay", "trend")
    }
    row: dict[str, Any] = {"strain": to, "drops": int(fell["dem"].sum())}
    row["status"] = summary["status"]
    for name, way in {"path": "events", "replay": "replay", "trend": "trend"}.items():
        found = fell["dem"] & fell[way]
        row |= {name: int(found.sum()), f"false_{name}": int((fell[way] & ~fell["dem"]).sum())}
        row[f"lead_{name}"] = float(told.driven[found].max())
        row[f"error_{name}"] = _rms(told[f"stress_{way}"] - told.stress_dem)
    return row | {"error_persistence": _rms(told.stress_persistence - told.stress_dem)}


def _rms(error: Any) -> float:
    return float(np.sqrt(np.mean(np.square(error))))


def of_bonds(folder: Path) -> Iterator[dict[str, Any]]:
    """Yade's bonded discs against path and replay, each interval from Yade's own snapshot.

    `through_11`, `through_22` is the stress of the path that goes on from the first snapshot.
    """
    states = [read_snapshot(folder / f"grains_{k:02d}.csv.gz") for k in range(1, 7)]
    first, before, strain = states[0], None, 0.0
    yield {"interval": 0, "strain": 0.0, "status": "start"} | _of_stress("yade", stress_of(first))
    for k, (one, two) in enumerate(pairwise(states), 1):
        graph, law, H = one.graph, one.mechanics()[0], _strain(one, two)
        path = followed(Scene(graph, law), strained(H), instabilities=1000, past="dynamic")
        again = replay(Scene(graph, law), H, inertial_number=1e-5, mass=one.mass, damping=0.2)
        whole = _strain(first, two)
        through = followed(
            Scene(first.graph, first.law), strained(whole), instabilities=1000, past="dynamic"
        )
        strain = whole[1, 1]
        row: dict[str, Any] = {"interval": k, "strain": strain, "status": path.status}
        row |= _of_stress("yade", stress_of(two)) | _of_stress("through", through.states[-1].stress)
        was, now = _contacts(graph), _contacts(two.graph)
        torn = [event for event in path.of_kind("opening") if event.cause == "pulls_off"]
        row |= {"events": len(path.events), "pulled_off": len(torn), "lost": len(was - now)}
        row["slid"] = sum(event.kind == "yield" for event in path.events)
        for name, end in (("path", path.states[-1]), ("replay", again.state)):
            left = stress_of(two) - end.stress
            row[f"{name}_error"] = np.linalg.norm(left) / np.linalg.norm(
                stress_of(two) - stress_of(one)
            )
            row[f"{name}_of_stress"] = np.linalg.norm(left) / np.linalg.norm(stress_of(two))
            lost = was - _contacts(end.graph())
            row[f"{name}_lost"], row[f"{name}_lost_too"] = len(lost), len(lost & (was - now))
            row[f"{name}_auc"] = _auc(one, two, loop_changes(graph, end, one.faces).normalised_work)
        if before is not None:
            row["persistence_auc"] = _auc(one, two, before)
        table = loop_increments(one, two, track_loops(one, two))
        before = np.full(len(two.faces.loops), np.nan)
        before[table["loop_after"]] = table["w2"]
        yield row


@styled()
def bonded_figure(rows: Rows) -> Figure:
    """Stress over the strain, and what an interval is off by."""
    figure = new_figure(TWO_COLUMNS, 2.6)
    left, right = figure.subplots(1, 2)
    strain = [row["strain"] for row in rows]
    for component, colour in zip(("11", "22"), LINE_COLOURS, strict=False):
        yade = [row[f"yade_{component}"] for row in rows]
        left.plot(strain, yade, "o", color=colour, label=f"$\\sigma_{{{component}}}$, Yade")
        path = [yade[0], *(row[f"through_{component}"] for row in rows[1:])]
        left.plot(strain, path, "-", color=colour, label=f"$\\sigma_{{{component}}}$, path")
    left.set(xlabel="axial strain since the first snapshot", ylabel="stress (N/m)")
    left.legend()
    for name, colour, mark in zip(("path", "replay"), LINE_COLOURS, "os", strict=False):
        errors = [row[f"{name}_error"] for row in rows[1:]]
        right.semilogy(range(1, len(rows)), errors, mark, color=colour, label=name)
    right.set(xlabel="interval", ylabel="error over the change of stress")
    right.set_xticks(range(1, len(rows)))
    right.legend()
    return figure


def _of_stress(name: str, stress: Floats) -> dict[str, float]:
    return {f"{name}_11": float(stress[0, 0]), f"{name}_22": float(stress[1, 1])}


def _contacts(graph: GrainGraph) -> set[tuple[int, ...]]:
    """Contacts as pairs of grains with the image of the second one, in one order."""
    assert graph.images is not None
    found = set()
    for (i, j), image in zip(graph.contacts.tolist(), graph.images.tolist(), strict=True):
        found.add((i, j, *image) if i < j else (j, i, *(-k for k in image)))
    return found


def _spent(work: Callable[..., Any], *given: Any, **options: Any) -> tuple[Any, float]:
    found: list[Any] = []
    _, cpu = _timed(lambda: found.append(work(*given, **options)))
    return found[0], cpu


def _slow(collection: Path, cells: dict[int, Any], number: int) -> Snapshot:
    path = collection / f"yade-slow/grains_{number:02d}.parquet"
    return read_snapshot(path, cell=np.reshape(cells[number], (2, 2)), shear_increment="radii")


def _strain(one: Snapshot, two: Snapshot) -> Floats:
    return np.eye(2) - np.array(two.graph.cell) @ np.linalg.inv(np.array(one.graph.cell))


def _auc(one: Snapshot, two: Snapshot | None, work: Floats) -> float:
    return float("nan") if two is None else float(_skill(one, two, work)["auc"])


def _skill(one: Snapshot, two: Snapshot, work: Floats) -> dict[str, Any]:
    """Skill of the work told for W2 < 0 between two snapshots."""
    table = loop_increments(one, two, track_loops(one, two))
    actual = np.full(len(work), np.nan)
    actual[table["loop_before"]] = table["w2"]
    return score_skill(-work, actual, signed=True)


STUDIES: dict[str, tuple[Callable[[Path], Any], Callable[[Rows], Figure] | None]] = {
    "skill": (by_step, skill_figure),
    "steps": (by_single_step, None),
    "probes": (lambda _: probed("before"), probes_figure),
    "rates": (by_rate, rates_figure),
    "growth": (lambda _: growth(), growth_figure),
    "past": (by_way, None),
    "series": (by_series, None),
    "forecasts": (by_start, None),
    "bonded": (lambda _: of_bonds(sample_path("bonded")), bonded_figure),
}


def main(
    what: Annotated[str, Parameter(help=f"{', '.join(STUDIES)}.")],
    out: Annotated[Path, Parameter(help="Result folder.")],
    collection: Annotated[Path, Parameter(help="The DEM samples.")] = Path("dem"),
    force: Annotated[bool, Parameter(negative=(), help="Replace results.")] = False,
) -> None:
    """Measure; write the table and the figure, if there is one."""
    if what not in STUDIES:
        raise InputError("WHAT", repr(what), f"one of {', '.join(STUDIES)}", "Name one of them.")
    measure, draw = STUDIES[what]
    with result_folder(out, force=force) as folder:
        rows: Rows = []
        for row in measure(collection):
            print(row, flush=True)
            rows.append(row)
        made = provenance("packing-paths study", {"what": what}, UNITS)
        table = pd.DataFrame(rows)
        write_table(folder, what, {name: table[name].to_numpy() for name in table}, made, csv=True)
        if draw is not None:
            save_figure(draw(rows), folder, f"packing-paths-{what}", made)


if __name__ == "__main__":
    cyclopts.run(main)
