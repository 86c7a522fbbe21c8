"""Figures of the front door: each draws into the axes that it is given, else into pyplot's."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Container
from functools import wraps
from itertools import cycle
from typing import Any, TypeVar, cast

import numpy as np
import pandas as pd
from matplotlib import pyplot
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.projections.polar import PolarAxes
from numpy.typing import ArrayLike
from scipy.interpolate import CubicHermiteSpline, PchipInterpolator

from loops import (
    ContactLaw,
    GrainGraph,
    InputError,
    Regime,
    Scene,
    contact_state,
    force_chains,
    macroscopic_tangent,
)
from loops.arrays import Floats, Integers, Regimes
from loops.closures import Closure, MacroTangent, Spins
from loops.closures.system import with_law
from loops.errors import check_choice, check_type, listed, path_of, short
from loops.graph import graph_of
from loops.scene import Subject
from loops.validation import require_shape
from patterns import Snapshot, planar
from patterns.snapshots.snapshot import SnapshotLoop
from stability import COMPONENTS, Path, directional_work, plane_cone, restrict, symmetric_spectrum
from stability.material import MaterialPath
from stability.packing import HeldPacking, Probe
from studies.domain import LoopDomain, draw_loop_domain, loop_domain
from studies.evolve import Evolution, event_table
from studies.frames import row_table
from studies.output import Columns
from studies.packing_figures import (
    draw_envelope,
    polar_work,
    response_envelope,
    stress_and_volume,
)
from studies.paths.figures import draw_grains, draw_polar, forces_key
from studies.paths.followed import operator_diagram
from studies.results import table_of
from studies.series.figures import fates_over_strain, skill_by_predictor, stress_strain
from studies.snapshot.figures import (
    chain_segments,
    draw_orders,
    draw_rose,
    draw_values,
    eigenvalue_distribution,
    loop_drawer,
    order_bars,
    places_figure,
)
from studies.snapshot.sample import Fabric
from studies.snapshot.summary import snapshot_summary
from studies.snapshot.table import group_rows, loop_columns
from studies.style import (
    BLACK,
    BLUE,
    GREY,
    LINE_COLOURS,
    ONE_COLUMN,
    axes_or_new,
    edge_ticks,
    new_figure,
    outer_legend,
    styled,
)

Plot = TypeVar("Plot", bound=Callable[..., Axes])
DETERMINANT_LABELS = {"det_K": r"$\det K$", "det_Ks": r"$\det K_s$"}


def drawn(
    width: float, height: float, projection: str = "rectilinear", *, over: bool = False
) -> Callable[[Plot], Plot]:
    """A plot in the platform's style, into pyplot's axes unless it is given others.

    Pyplot's current axes serve while they are empty, or hold a plot of the same kind that is drawn
    `over` others; else there is a new figure. It is made before the style is set: the first one
    loads the backend of a notebook, whose settings would be taken back with the style.
    """

    def decorate(draw: Plot) -> Plot:
        @wraps(draw)
        def plot(*given: Any, **how: Any) -> Axes:
            if how.get("ax") is None and not any(isinstance(one, Axes) for one in given):
                figure = pyplot.gcf() if pyplot.get_fignums() else None
                if figure is None or not _is_free(figure, draw.__name__ if over else ""):
                    size = new_figure(width, height).get_size_inches()
                    figure = pyplot.figure(figsize=tuple(size))
                if figure.get_layout_engine() is None:
                    figure.set_layout_engine("constrained")
                with styled():
                    how["ax"] = _current_axes(figure, projection)
                    how["ax"].set_gid(draw.__name__)
            with styled():
                return draw(*given, **how)

        return cast(Plot, plot)

    return decorate


def _is_free(figure: Figure, kind: str) -> bool:
    """Whether the current axes of a figure are empty, or hold a plot of this kind."""
    return not figure.axes or not figure.gca().has_data() or figure.gca().get_gid() == kind


def _current_axes(figure: Figure, projection: str) -> Axes:
    """Current axes of a figure, or others in their place if they are of another projection."""
    place: Any = 111
    if figure.axes:
        if figure.gca().name == projection:
            return figure.gca()
        place = figure.gca().get_subplotspec() or place
        figure.gca().remove()
    return figure.add_subplot(place, projection=projection)


@drawn(4.2, 4.2)
def plot_map(
    snapshot: Snapshot | Subject,
    values: ArrayLike | str | None = None,
    label: str = "",
    ax: Axes | None = None,
) -> Axes:
    """Map of the loops of a snapshot, coloured by a value of each.

    Parameters
    ----------
    snapshot : Snapshot or Scene
    values : (L,) array or str, optional
        One a loop, in the order of the table of loops, or the name of one of its columns; nan stays
        white. By order if left out.
    label : str
        Of the colour bar; the column if left out.
    ax : matplotlib.axes.Axes, optional
        Where to draw; if left out pyplot's current axes while they are empty, else a new figure.

    Returns
    -------
    matplotlib.axes.Axes

    Raises
    ------
    InputError
        If branches cross, or there is not one value per loop.

    Examples
    --------
    >>> from matplotlib.figure import Figure
    >>> from patterns import read_snapshot, sample_path
    >>> ax = plot_map(read_snapshot(sample_path()), ax=Figure().add_subplot())
    >>> len(ax.collections) > 0
    True
    """
    snapshot = planar(snapshot)
    ax, draw = axes_or_new(ax), loop_drawer(snapshot)
    order = snapshot.faces.order[snapshot.faces.loops]
    if values is None or (isinstance(values, str) and values == "order"):
        draw_orders(draw, ax, order)
        return ax
    if isinstance(values, str):
        table, label = loop_columns(snapshot), label or values.replace("_", " ")
        if values not in table:
            expected = "one value a loop, or a column of gl.loop_table(snapshot)"
            raise InputError("values", repr(values), expected, "Look there.")
        values = table[values]
    # Words are shown too, a colour each.
    require_shape("values", np.asarray(values, dtype=object), *order.shape)
    draw_values(draw, ax, np.asarray(values), label)
    return ax


@drawn(ONE_COLUMN, 3.8)
def plot_loop(graph: GrainGraph | SnapshotLoop | Scene, ax: Axes | None = None) -> Axes:
    """Grains of a loop, or of a small graph, with the forces of its contacts and their key.

    Every contact has a line from centre to centre, whose width is in proportion to its force,
    normal and tangential part together. For few grains arrows show the forces from outside that
    hold the contacts in balance.

    Parameters
    ----------
    graph : GrainGraph, SnapshotLoop or Scene
        One state, not periodic; `gl.loop(snapshot, 62)` for example.
    ax : matplotlib.axes.Axes, optional
        Where to draw; if left out pyplot's current axes while they are empty, else a new figure.

    Returns
    -------
    matplotlib.axes.Axes

    Raises
    ------
    InputError
        For a batch of states or a periodic graph.

    Examples
    --------
    >>> from matplotlib.figure import Figure
    >>> from patterns import regular_polygon
    >>> ax = plot_loop(regular_polygon(5, strain=0.1), ax=Figure().add_subplot())
    >>> len(ax.get_legend().get_texts())
    3
    """
    graph = graph_of(graph)
    if graph.batch_shape or graph.cell is not None:
        received = f"batch axes {graph.batch_shape}" if graph.batch_shape else "a periodic graph"
        raise InputError("graph", received, "one state in the plane", "Cut a loop out of it.")
    ax, regime = axes_or_new(ax), graph.regime
    if regime is None:
        regime = np.where(graph.normal_force > 0, Regime.ELASTIC, Regime.OPEN).astype(np.int8)
    largest = float(np.hypot(graph.normal_force, graph.shear_force).max(initial=0.0))
    draw_grains(ax, graph.replace(regime=regime), largest)
    key = forces_key(largest, "force units", regime, graph.grain_count)
    outer_legend(ax, "upper center", (0.5, 0.0), 5.0, handles=key)
    reach = graph.radii.max() + 1.4 * graph.radii.mean()
    (left, bottom), (right, top) = graph.x.min(axis=0) - reach, graph.x.max(axis=0) + reach
    ax.set(xlim=(left, right), ylim=(bottom, top), aspect="equal")
    ax.set(xlabel="$x_1$ (length)", ylabel="$x_2$ (length)")
    return ax


@drawn(2.5, 2.5)
def plot_cone(tangent: MacroTangent | ArrayLike, ax: Axes | None = None) -> Axes:
    """Polar diagram of the normalised second-order work in (11, 22): its cone is shaded.

    The curve is `(2 + w2) (cos alphaE, sin alphaE)`, `tan(alphaE) = E1'/E2'` (Nicot et al. 2016,
    Fig. 11); inside the dashed circle `w2` is negative. The text tells the cone's opening.

    Parameters
    ----------
    tangent : MacroTangent or (4, 4) array
        `P' = A H'`, components (11, 12, 21, 22).
    ax : matplotlib.axes.Axes, optional
        Where to draw; if left out pyplot's current axes while they are empty, else a new figure.

    Returns
    -------
    matplotlib.axes.Axes

    Examples
    --------
    >>> from matplotlib.figure import Figure
    >>> import numpy as np
    >>> tangent = np.diag([1.0, 0.5, 0.5, -1.0])
    >>> plot_cone(tangent, ax=Figure().add_subplot()).texts[0].get_text()
    'cone 90.00°'
    """
    K = restrict(tangent, "diagonal")
    opening = float(np.degrees(plane_cone(K).opening))
    text = f"cone {opening:.2f}°" if opening > 0 else "no cone"
    return draw_polar(operator_diagram(K), ax=ax, name=text)


@drawn(3.0, 3.0)
def plot_envelope(
    graph: GrainGraph | SnapshotLoop | Scene | Probe,
    law: ContactLaw | None = None,
    closure: Closure | None = None,
    spins: Spins = "blocked",
    ax: Axes | None = None,
) -> Axes:
    """Response envelope: stress rates that answer to strain rates of unit size in (11, 22).

    Every direction has the regimes that it activates, as in `directional_work`; of several
    solutions that of the smallest second-order work. Dashed: all closed contacts stick. Vermilion
    where the second-order work is negative.

    Parameters
    ----------
    graph : SnapshotLoop, Scene, GrainGraph or Probe
        One state, `gl.loop(snapshot, 62)` for example; or what `probe` found of a snapshot, drawn
        over its mean `kn` without the other arguments.
    law : ContactLaw
        Law of the contacts of a graph; a loop of a snapshot and a scene have theirs.
    closure : {'affine', 'traction'}
        How the surroundings drive the grains of a graph; it has to be named.
    spins : {'blocked', 'affine', 'free'}
        What the grains' spins do.
    ax : matplotlib.axes.Axes, optional
        Where to draw; if left out pyplot's current axes while they are empty, else a new figure.

    Returns
    -------
    matplotlib.axes.Axes

    Raises
    ------
    InputError
        As `directional_work`.

    Examples
    --------
    >>> from patterns import loop_of_snapshot, read_snapshot, sample_path
    >>> loop = loop_of_snapshot(read_snapshot(sample_path()), 17)
    >>> len(plot_envelope(loop, closure="traction").lines)
    5
    """
    if isinstance(graph, Probe):
        mean_kn = float(np.mean(getattr(graph.system.law, "kn", graph.system.unit)))
        return response_envelope(graph, mean_kn, ax=ax)
    graph, law = with_law(graph, law)
    ax, theta = axes_or_new(ax), np.linspace(0.0, 2.0 * np.pi, 361)
    directions = np.stack([np.cos(theta), np.sin(theta)], axis=1)
    found = directional_work(graph, law, directions, closure=closure, spins=spins)
    closed = law.regime(contact_state(graph)) != Regime.OPEN
    stuck = np.where(closed, Regime.ELASTIC, Regime.OPEN).astype(np.int8)

    def rates(regime: Regimes) -> Floats:
        tangent = macroscopic_tangent(graph, law, closure, spins=spins, regime=regime)
        return np.asarray(directions @ restrict(tangent, "diagonal").T)

    answer = np.full((len(theta), 2), np.nan)
    for regime in np.unique(found.regime[found.status != "none"], axis=0):
        rows = (found.regime == regime).all(axis=1)
        answer[rows] = rates(regime)[rows]
    labels = "$P'_{11}$ (force/length)", "$P'_{22}$ (force/length)"
    draw_envelope(ax, rates(stuck), answer, found.work[:, 0] < 0.0, labels)
    return ax


@drawn(ONE_COLUMN + 0.2, 4.9, "polar")
def plot_rose(snapshot: Snapshot, of: str = "contacts", ax: Axes | None = None) -> Axes:
    """Rose of directions of the contacts or loops of a snapshot, with standard errors.

    Bars are the density of all, an axis in both its directions; points those of strong and weak
    contacts (normal force above and below the mean), with errors as if contacts were independent;
    the line is the second-order series of the fabric tensor.

    Parameters
    ----------
    snapshot : Snapshot
    of : {'contacts', 'branches', 'loops'}
        Normals of the contacts; branch vectors weighted by their length; long axes of the loops,
        weighted by their area.
    ax : matplotlib.projections.polar.PolarAxes, optional
        Where to draw; if left out pyplot's current axes while they are empty, else a new figure.

    Returns
    -------
    matplotlib.projections.polar.PolarAxes

    Raises
    ------
    InputError
        For other directions, axes that are not polar, or if branches cross.

    Examples
    --------
    >>> from matplotlib.figure import Figure
    >>> from patterns import read_snapshot, sample_path
    >>> ax = plot_rose(read_snapshot(sample_path()), ax=Figure().add_subplot(projection="polar"))
    >>> [text.get_text() for text in ax.get_legend().get_texts()][:2]
    ['second order: a = 0.186 ± 0.049, -79.6°', 'all contacts: 819']
    """
    check_choice("of", of, ("contacts", "branches", "loops"))
    return draw_rose(planar(snapshot), of, ax=require_polar(ax))


def require_polar(ax: Axes | None) -> PolarAxes:
    """Return polar axes; `InputError` for others."""
    if not isinstance(ax, PolarAxes):
        expected, remedy = "polar axes", "Make them with projection='polar', or leave ax out."
        raise InputError("ax", type(ax).__name__, expected, remedy)
    return ax


def plot_fabric(found: Fabric, ax: Axes | None = None) -> Axes:
    """Directions of the contacts of a sample."""
    return plot_rose(found.snapshot, ax=ax)


def series_table(
    given: pd.DataFrame | str | os.PathLike[str],
    name: str,
    needed: tuple[str, ...] = (),
    file: str = "evolution.parquet",
) -> pd.DataFrame:
    """A table of a series: as it is given, from its file, or from the result folder."""
    remedy = "Give the folder of grainloops series, or its table."
    if not isinstance(given, pd.DataFrame):
        path = path_of(name, given, remedy)
        path = path / file if path.is_dir() else path
        if not path.is_file():
            raise InputError(name, str(path), "a file that is there", remedy)
        given = pd.read_parquet(path)
    if lacking := [column for column in needed if column not in given]:
        raise InputError(name, f"no column {', '.join(lacking)}", "these columns", remedy)
    return given


@drawn(ONE_COLUMN, 2.8, over=True)
def plot_evolution(
    evolution: pd.DataFrame | str | os.PathLike[str],
    y: str | tuple[str, ...] = "q_over_p",
    x: str = "shear_strain",
    ax: Axes | None = None,
) -> Axes:
    """Columns of a series' `evolution` over one another, with error bars where there are errors.

    Parameters
    ----------
    evolution : pandas.DataFrame or path
        Table `evolution` of `grainloops series`, its file, or the result folder.
    y, x : str
        Columns, several for `y`: `q_over_p`, `p`, `q`, `volume`, `mean_order`,
        `packing_unstable`, ...; `*_error` of a column are its bars.
    ax : matplotlib.axes.Axes, optional
        Where to draw; if left out pyplot's current axes while they are empty, else a new figure.

    Returns
    -------
    matplotlib.axes.Axes

    Raises
    ------
    InputError
        If there is no such file or column.

    Examples
    --------
    >>> from matplotlib.figure import Figure
    >>> table = pd.DataFrame({"shear_strain": [0.0, 1e-3], "mean_order": [4.8, 4.9]})
    >>> plot_evolution(table, "mean_order", ax=Figure().add_subplot()).get_ylabel()
    'mean order'
    """
    table, ax = series_table(evolution, "evolution"), axes_or_new(ax)
    names = _columns(table, x, y, "one of the table evolution")
    for name, colour, marker in zip(names, cycle(LINE_COLOURS), cycle("osD^vP")):
        error = f"{name}_error"
        bars = None if error not in table else table[error].to_numpy(float, na_value=np.nan)
        at, value = (table[key].to_numpy(float, na_value=np.nan) for key in (x, name))
        look: Any = {"fmt": f"{marker}-", "color": colour, "capsize": 2.0}
        ax.errorbar(at, value, bars, label=_shown(name), **look)
    ax.set(xlabel=_shown(x), ylabel=_shown(names[0]) if len(names) == 1 else "")
    if len(names) > 1:
        ax.legend()
    return ax


@drawn(ONE_COLUMN, 4.4)
def plot_domain(
    loop: LoopDomain | SnapshotLoop | Scene,
    closure: Closure | None = None,
    plane: str = "strain",
    ax: Axes | None = None,
    **how: Any,
) -> Axes:
    """Domain of one loop: where straight programmes from its present state end, and by what.

    Parameters
    ----------
    loop : SnapshotLoop, Scene or LoopDomain
        One loop, `gl.loop(snapshot, 62)` for example, or what `gl.loop_domain` found of it.
    closure : {'affine', 'traction'}
        How the surroundings drive the grains; it has to be named unless a domain is given.
    plane : {'strain', 'stress'}
        Plane of the figure.
    ax : matplotlib.axes.Axes, optional
        Where to draw; if left out pyplot's current axes while they are empty, else a new figure.
    **how
        `spins`, `control` and `directions` of `gl.loop_domain`.

    Returns
    -------
    matplotlib.axes.Axes

    Raises
    ------
    InputError
        As `gl.loop_domain`, and for another plane.

    Examples
    --------
    >>> from matplotlib.figure import Figure
    >>> from patterns import loop_of_snapshot, read_snapshot, sample_path
    >>> one = loop_of_snapshot(read_snapshot(sample_path()), 62)
    >>> ax = plot_domain(one, "traction", directions=9, ax=Figure().add_subplot())
    >>> ax.get_legend().get_texts()[-1].get_text()
    'present state, stable'
    """
    check_choice("plane", plane, ("strain", "stress"))
    found = loop if isinstance(loop, LoopDomain) else loop_domain(loop, closure, **how)
    return draw_loop_domain(found, axes_or_new(ax), plane)


def _columns(table: Container[str], x: str, y: Any, expected: str) -> list[str]:
    """The names of columns to draw over another one, checked."""
    names = listed("y", y, str, "Name columns.")
    for name in (x, *names):
        if not (isinstance(name, str) and name in table):
            raise InputError("column", short(name), expected, "Look there.")
    return names


def _shown(column: str) -> str:
    """A column of `evolution` in words, with its unit."""
    words = {"q_over_p": "$q/p$ (–)", "p": "$p$ (force/length)", "q": "$q$ (force/length)"}
    words["shear_strain"] = "shear strain (–)"
    return words.get(column, column.replace("_", " "))


@drawn(ONE_COLUMN, 2.5, over=True)
def plot_path(
    path: Path | MaterialPath,
    x: str = "",
    y: str | tuple[str, ...] = ("P11", "P22"),
    ax: Axes | None = None,
) -> Axes:
    """Columns of a path over one another, its events marked.

    Of a loop the curves from row to row are cubics: those of `H` and `P` have the path's own
    slopes, other columns keep to the range of their rows. No line joins the rows before and after a
    jump. Of a packing the instabilities are marked on the lower edge.

    Parameters
    ----------
    path : Path or MaterialPath
        From `follow`, `replay`, `evolve(...).way`, `march`.
    x, y : str
        Columns of `.table()`; several for `y`. If `x` is left out 'H11' of a loop, else the
        component of `H` that changes most.
    ax : matplotlib.axes.Axes, optional
        Where to draw; if left out pyplot's current axes while they are empty, else a new figure.

    Returns
    -------
    matplotlib.axes.Axes

    Raises
    ------
    InputError
        If there is no such column.

    Examples
    --------
    >>> from loops import LinearFrictional, Scene
    >>> from matplotlib.figure import Figure
    >>> from patterns import regular_polygon
    >>> from stability import Stage, follow, programmes
    >>> stage = Stage(programmes.isotropic_strain(), "H11", 0.2)
    >>> scene = Scene(regular_polygon(5), LinearFrictional(kn=1.0, kt=0.2))
    >>> path = follow(scene, stage, closure="affine")
    >>> [line.get_label() for line in plot_path(path, ax=Figure().add_subplot()).lines][:2]
    ['$P_{11}$', '$P_{22}$']
    """
    check_type("path", path, (Path, MaterialPath), "Give what gl.follow returns.")
    ax, table = axes_or_new(ax), table_of(path)
    loop = path if isinstance(path, Path) and len(path.A) else None
    if x == "":
        x = "H11" if loop else f"H{COMPONENTS[int(np.ptp(path.H, axis=0).argmax())]}"
    names = _columns(table, x, y, "one of path.table()")
    parts = [np.arange(len(table))]
    if loop:
        # Stretches of rows in which no regime and no stage changes.
        jumps = (np.diff(loop.regime, axis=0) != 0).any(axis=1) | (np.diff(loop.stage) != 0)
        parts = np.split(parts[0], np.flatnonzero(jumps) + 1)
    for name, colour in zip(names, cycle(LINE_COLOURS)):
        curve = [cubics(loop, part, (table, x, name)) for part in parts] if loop else [
            table[[x, name]].to_numpy().T]  # fmt: skip
        ax.plot(*np.concatenate(curve, axis=1), color=colour, label=symbol(name))
    if loop:
        named = table["event"].to_numpy()
        for kinds, marker in zip(sorted({*named} - {""}), cycle("osD^vP")):
            at = named == kinds
            look: Any = {"color": BLACK, "markersize": 4.0, "markerfacecolor": "white"}
            ax.plot(
                table[x][at], table[names[0]][at], marker, label=kinds.replace("_", " "), **look
            )
    elif isinstance(path, Path) and (lost := path.of_kind("instability")):
        at = np.interp([event.parameter for event in lost], path.parameter, table[x])
        edge_ticks(ax, at, "instabilities")
    ax.set(xlabel=with_unit(x), ylabel=with_unit(names[0][0] if len(names) > 1 else names[0]))
    ax.legend()
    return ax


@drawn(ONE_COLUMN, 2.6)
def plot_tangents(tangents: MacroTangent, ax: Axes | None = None) -> Axes:
    """Distribution of the smallest eigenvalue of Ks over many tangents; the cone of one."""
    if tangents.matrix.ndim == 2:
        return plot_cone(tangents, ax=ax)
    smallest = symmetric_spectrum(restrict(tangents, "symmetric"))[..., 0]
    known = np.sort(smallest[np.abs(smallest) > tangents.error])
    unknown = smallest.size - len(known)
    said = f"{np.count_nonzero(known < 0)} of {smallest.size} below 0, {unknown} without a sign"
    ax = axes_or_new(ax)
    ax.step(known, np.arange(1, len(known) + 1) / len(known), where="post", color=BLUE, label=said)
    ax.axvline(0.0, color=GREY, linewidth=0.7)
    ax.set(xlabel=r"smallest eigenvalue of $K_s$ (force/length)", ylabel="share of the tangents")
    outer_legend(ax, "lower left", (0.0, 1.0), 0.3)
    return ax


def plot_scene(found: Scene | HeldPacking, ax: Axes | None = None) -> Axes:
    """Loops of a packing by their order; grains and forces of a loop, which ends at nothing."""
    scene = found.scene if isinstance(found, HeldPacking) else found
    return (plot_loop if scene.boundary.kind == "free" else plot_map)(scene, ax=ax)


def cubics(path: Path, part: Integers, columns: tuple[dict[str, Any], str, str]) -> Floats:
    """(2, n) points of a curve through rows, over the length of `H`'s way, and a gap behind it."""
    table, *names = columns
    along = np.cumsum(
        np.linalg.norm(np.diff(path.H[part], axis=0, prepend=path.H[part[:1]]), axis=1)
    )
    part, s = part[(moved := np.diff(along, prepend=-1.0) > 0)], along[moved]
    fine = np.interp(np.linspace(0, len(s) - 1, 12 * len(s)), np.arange(len(s)), s)
    points = []
    for name in names:
        values = np.asarray(table[name], dtype=float)[part]
        if len(s) < 2 or not np.isfinite(values).all():
            drawn = np.interp(fine, s, values)
        elif f"{name}_rate" in table:
            drawn = CubicHermiteSpline(s, values, np.asarray(table[f"{name}_rate"])[part])(fine)
        else:
            drawn = PchipInterpolator(s, values)(fine)
        points.append(np.append(drawn, np.nan))
    return np.stack(points)


def symbol(column: str) -> str:
    """A column as the theory writes it, else its words."""
    component = re.fullmatch(r"([HPNT])_?(\d*)", column)
    if component:
        return f"${component[1]}_{{{component[2]}}}$"
    return DETERMINANT_LABELS.get(column, column.replace("_", " "))


def with_unit(column: str) -> str:
    """A column with its unit."""
    units = {"H": "–", "P": "force/length", "N": "force", "T": "force"}
    unit = units.get(column.split("_")[0].rstrip("12"))
    return f"{symbol(column)} ({unit})" if unit else symbol(column)


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
    return places_figure(table, loop_drawer(snapshot), chain_segments(snapshot, chains))


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
