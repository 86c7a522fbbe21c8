"""Figures of the commands, drawn from what Python has: `gl.plot.eigenvalues(snapshot)`, ...

Those of several panels are figures of their own, the others draw where `gl.plot.map` does.
"""

from __future__ import annotations

import os

import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from loops import InputError, force_chains
from loops.errors import check_type, short
from loops.scene import Subject
from patterns import Snapshot, planar
from stability.packing import Probe
from studies.evolve import Evolution, event_table
from studies.frames import row_table
from studies.output import Columns
from studies.packing_figures import polar_work, stress_and_volume
from studies.plots import drawn, require_polar, series_table
from studies.series.figures import fates_over_strain, skill_by_predictor, stress_strain
from studies.snapshot.figures import (
    chain_segments,
    eigenvalue_distribution,
    loop_drawer,
    order_bars,
    places_figure,
)
from studies.snapshot.summary import judges, snapshot_summary, unstable_loops
from studies.snapshot.table import group_rows, loop_columns


def plot_eigenvalues(snapshot: Snapshot | Subject) -> Figure:
    """Share of the loops below each smallest eigenvalue of Ks: a panel a closure, a line an order.

    Parameters
    ----------
    snapshot : Snapshot or Scene
        With forces.

    Returns
    -------
    matplotlib.figure.Figure
        A figure of its own, to save by `.savefig("eigenvalues.png")`.

    Raises
    ------
    InputError
        If there are no forces or no loops, or branches cross.

    Examples
    --------
    >>> from patterns import read_snapshot, sample_path
    >>> len(plot_eigenvalues(read_snapshot(sample_path())).axes)
    3
    """
    snapshot = planar(snapshot)
    snapshot.mechanics()
    table = _loops_of(snapshot)
    return eigenvalue_distribution(table, group_rows(table["order"]))


@drawn(*vars(order_bars)["size"])
def plot_orders(snapshot: Snapshot | Subject, ax: Axes | None = None) -> Axes:
    """Share of the loops by order: in number, in area, and of unstable loops cut out (traction).

    Parameters
    ----------
    snapshot : Snapshot or Scene
        Without forces no loop is judged.
    ax : matplotlib.axes.Axes, optional
        Where to draw; if left out pyplot's current axes while they are empty, else a new figure.

    Returns
    -------
    matplotlib.axes.Axes

    Raises
    ------
    InputError
        If there are no loops, or branches cross.

    Examples
    --------
    >>> from patterns import read_snapshot, sample_path
    >>> plot_orders(read_snapshot(sample_path()), ax=Figure().add_subplot()).get_xlabel()
    'loop order (number of grains)'
    """
    snapshot = planar(snapshot)
    return order_bars(snapshot_summary(snapshot, _loops_of(snapshot)), ax=ax)


def plot_chains(snapshot: Snapshot | Subject) -> Figure:
    """Force chains over the loops; smallest eigenvalue of loops beside chains and of all others.

    Parameters
    ----------
    snapshot : Snapshot or Scene
        With forces.

    Returns
    -------
    matplotlib.figure.Figure
        A figure of its own.

    Raises
    ------
    InputError
        If there are no forces or no loops, or branches cross.

    Examples
    --------
    >>> from patterns import read_snapshot, sample_path
    >>> len(plot_chains(read_snapshot(sample_path())).axes)
    2
    """
    snapshot = planar(snapshot)
    snapshot.mechanics()
    table, chains = _loops_of(snapshot), force_chains(snapshot.graph)
    table["chain_contacts"] = chains.on_loops(snapshot.faces)
    unstable = {judge: unstable_loops(table, judge) for judge in judges(table)}
    draw, links = loop_drawer(snapshot), chain_segments(snapshot, chains)
    return places_figure(table, draw, group_rows(table["order"]), unstable, links)


@drawn(*vars(fates_over_strain)["size"])
def plot_fates(evolution: pd.DataFrame | str | os.PathLike[str], ax: Axes | None = None) -> Axes:
    """Shares of the loops of each interval that did not survive it, by fate.

    Parameters
    ----------
    evolution : pandas.DataFrame or path
        Table `evolution` of `grainloops series`, its file, or the result folder.
    ax : matplotlib.axes.Axes, optional
        Where to draw; if left out pyplot's current axes while they are empty, else a new figure.

    Returns
    -------
    matplotlib.axes.Axes

    Raises
    ------
    InputError
        If there is no such file, or a column is missing.

    Examples
    --------
    >>> lost = {"split": [0, 1], "merged": [0, 2], "changed": [0, 0], "died": [0, 0]}
    >>> table = pd.DataFrame({"snapshot": [0, 1], "survived": [0, 97], "born": [0, 3], **lost})
    >>> plot_fates(table, ax=Figure().add_subplot()).get_ylabel()
    'share of the earlier loops (%)'
    """
    needed = ("snapshot", "survived", "born", "split", "merged", "changed", "died")
    return fates_over_strain(series_table(evolution, "evolution", needed), ax=ax)


def plot_stress_strain(found: Evolution | pd.DataFrame | str | os.PathLike[str]) -> Figure:
    """Stresses of a path over its driven strain, or of a series over its strain.

    Parameters
    ----------
    found : Evolution, pandas.DataFrame or path
        What `gl.evolve` returns; or the table `evolution` of `grainloops series`, its file, or the
        result folder.

    Returns
    -------
    matplotlib.figure.Figure
        A figure of its own: of a path stresses and change of area, of a series stresses, `q/p`
        and the shares of unstable loops and sliding contacts.

    Raises
    ------
    InputError
        If there is no such file, or a column is missing.

    Examples
    --------
    >>> plot_stress_strain("series")
    Traceback (most recent call last):
        ...
    loops.errors.InputError: found: got series, expected a file that is there. Give the folder of \
grainloops series, or its table.
    """
    if not isinstance(found, Evolution):
        stresses = (*(f"{of}{ij}" for of in "HS" for ij in ("11", "12", "21", "22")),)
        return stress_strain(series_table(found, "found", (*stresses, "sliding_fraction")))
    tables = {"path": row_table(found.way), "events": event_table(found.way, found.ids)}
    if len(found.ways) > 1:
        tables["replay"] = row_table(found.ways["replay"])
    return stress_and_volume(tables, found.driven)


def plot_skill(table: pd.DataFrame | str | os.PathLike[str]) -> Figure:
    """AUC of every predictor for each target: a dot an interval, and the mean.

    Parameters
    ----------
    table : pandas.DataFrame or path
        What `gl.skill` returns; or the table `skill` of `grainloops series`, its file, or the
        result folder.

    Returns
    -------
    matplotlib.figure.Figure
        A figure of its own.

    Raises
    ------
    InputError
        If there is no such file, or a column is missing.

    Examples
    --------
    >>> row = {"pair": 0, "target": "contact_lost", "base": 0.02, "auc": 0.7}
    >>> table = pd.DataFrame([row | {"predictor": "indicator"}, row | {"predictor": "order"}])
    >>> plot_skill(table).axes[0].get_yticklabels()[0].get_text()
    'the indicator'
    """
    if isinstance(table, pd.DataFrame):
        table = table.rename(columns={"pair": "snapshot_after"})
    needed = ("snapshot_after", "target", "predictor", "base", "auc")
    return skill_by_predictor(series_table(table, "table", needed, "skill.parquet"))


@drawn(*vars(polar_work)["size"])
def plot_polar(found: Probe, ax: Axes | None = None) -> Axes:
    """Normalised second-order work of a probe over its directions, with the cones.

    Parameters
    ----------
    found : Probe
        What `gl.probe` returns; of `gl.sustain` the attribute `rates`.
    ax : matplotlib.axes.Axes, optional
        Polar; if left out pyplot's current axes while they are empty, else a new figure.

    Returns
    -------
    matplotlib.axes.Axes

    Raises
    ------
    InputError
        If it is no probe, or the axes are not polar.

    Examples
    --------
    >>> from patterns import read_snapshot, sample_path
    >>> from studies.probe import probe
    >>> polar = Figure().add_subplot(projection="polar")
    >>> plot_polar(probe(read_snapshot(sample_path()), 4, hold="strain"), ax=polar).name
    'polar'
    """
    check_type("found", found, Probe, "Give what gl.probe returns.")
    return polar_work(found, ax=require_polar(ax))


def _loops_of(snapshot: Snapshot) -> Columns:
    """Table of the loops of a snapshot; `InputError` without any."""
    if not len(snapshot.faces.loops):
        remedy = "Give a snapshot whose contacts close loops."
        raise InputError("snapshot", f"no loops in {short(snapshot)}", "loops", remedy)
    return loop_columns(snapshot)
