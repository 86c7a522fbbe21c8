"""Domain of one loop in its present state: where programmes in all directions end, and by what."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure

from loops import (
    ContactLaw,
    GrainGraph,
    InputError,
    contact_state,
    macroscopic_tangent,
    nominal_stress,
)
from loops.arrays import Flags, Floats, one_blas_thread, true_runs
from loops.closures import Closure, Spins
from loops.closures.system import named_closure
from loops.errors import check_choice, whole_number
from loops.laws.frictional import linear_springs
from loops.scene import Scene, Subject, scene_of
from loops.shown import Shown
from stability import judge, normalised_second_order_work, restrict
from stability.paths.domain import LIMITS, Control, Fan, FanLimits
from studies.clock import Progress, paced
from studies.output import words
from studies.style import (
    BLACK,
    BLUE,
    GREEN,
    GREY,
    LIGHT_GREY,
    ONE_COLUMN,
    ORANGE,
    VERMILION,
    new_panels,
    outer_legend,
    styled,
)

# End of the programmes over the mean overlap: the range of the figure, in which contacts near
# opening and yield are seen.
REACH_OVERLAPS = 5.0
# What may end a programme, with colour, line and words; the first that is met counts.
ENDS: dict[str, tuple[str, str, str]] = {
    "start": (VERMILION, "-", "unstable before it begins"),
    "det_Ks_zero": (VERMILION, "-", r"$\det K_s = 0$"),
    "det_K_zero": (BLACK, "-", r"$\det K = 0$"),
    "limit": (ORANGE, "-", "the programme has no continuation"),
    "opening": (BLUE, "--", "a contact opens"),
    "end": (GREY, ":", "end of the range"),
}
# Programmes if none are asked for: of blocked spins and linear springs, and of others.
MANY, FEW = 361, 61
# The strain at the end of programmes jumps if its step is so many times that around, and more than
# this share of the largest one.
JUMP, LEAST_JUMP = 5.0, 0.02
RAYS = 24  # programmes that are drawn as lines
FINE = 1440  # directions of strain in which the work of an unstable state is looked at
IDENTITY = np.eye(2)


@dataclass(frozen=True, eq=False, repr=False)
class LoopDomain(Shown):
    """Ends of the programmes that leave the present state of a loop in all directions.

    Attributes
    ----------
    rows : pandas.DataFrame
        One a programme: `programme_deg` (direction of strain, or of stress, from axis 1 to axis 2),
        `kind` of what ended it (`ENDS`), the changes of strain `E1`, `E2` and the stresses `s1`,
        `s2` there (unit `stress_unit`), not numbers where no end is known; `start_w2`, the
        normalised second-order work of the present state along it. A loop that is unstable in
        its present state is not followed: all of its programmes end at their `start`.
    yields : pandas.DataFrame
        The same of the first contact that yields on the programmes where one does.
    start : (2,) array
        Stress of the present state, in `stress_unit`.
    status : str
        Verdict on the present state in (11, 22).
    control, stress_unit : str
        Whether programmes are straight in strain or in stress, and what stresses are over.
    tangent : (2, 2) array
        Tangent of the present state in (11, 22), in `stress_unit`.
    reach : float
        Strain at which programmes end, five mean overlaps.
    all_around : bool
        Whether programmes leave in all directions, so that the boundary is closed.
    """

    rows: pd.DataFrame
    yields: pd.DataFrame
    start: Floats
    status: str
    control: str
    stress_unit: str
    tangent: Floats
    reach: float
    all_around: bool = True

    def facts(self) -> dict[str, object]:
        """Facts that the prompt and a notebook show."""
        ended, counts = words("lines")["words"]["ended"], self.rows["kind"].value_counts()
        negative = 100.0 * np.mean(self.rows["start_w2"] < 0.0)
        lost = {"negative second-order work there": f"along {negative:.0f} % of the programmes"}
        return {
            "present state": self.status, **(lost if negative else {}),
            "programmes": len(self.rows), "of": self.control,
            **{f"ended by {ended[kind]}": count for kind, count in counts.items()},
        }  # fmt: skip


def programmes_of(spins: Spins, *, linear: bool) -> int:
    """Number of programmes of a loop for which none is asked."""
    return MANY if spins == "blocked" and linear else FEW


def present_fan(
    graph: GrainGraph,
    law: ContactLaw,
    closure: Closure,
    spins: Spins,
    control: Control,
    directions: int,
    after_one: Callable[[], object] = lambda: None,
) -> tuple[Fan, FanLimits]:
    """Limits of the programmes from the present state of a loop in all directions."""
    graph = graph.replace(x0=graph.x)
    contacts = contact_state(graph)
    overlap = float(np.mean(contacts.overlap / contacts.touching_length))
    # All directions, 45 degrees among them: the isotropic one for equal sides.
    around = 0.25 * np.pi + np.linspace(-np.pi, np.pi, directions, endpoint=False)
    loop = Scene(graph, law)
    fan = Fan(loop, closure, spins, control, around, REACH_OVERLAPS * overlap)
    if present_tangent(fan)[1] == "unstable":
        return fan, FanLimits.none(fan)
    return fan, limits_along(fan, after_one)


@one_blas_thread()
def limits_along(fan: Fan, after_one: Callable[[], object] = lambda: None) -> FanLimits:
    """Return first limits along the programmes."""
    limits = FanLimits.none(fan)
    for row in range(len(fan.programme)):
        limits.follow(fan, row)
        after_one()
    return limits


def present_tangent(fan: Fan) -> tuple[Floats, str]:
    """Tangent of the present state in (11, 22), and the verdict on it."""
    loop = fan.loop
    tangent = macroscopic_tangent(loop.graph, loop.law, fan.closure, spins=fan.spins)
    return restrict(tangent, "diagonal"), judge(tangent, "diagonal").status


def in_planes(limits: FanLimits, kind: str, rows: Flags) -> dict[str, Floats]:
    """Columns of strains and stresses along both axes, in the states of a kind."""
    H, P = limits.states[kind].H[rows], limits.states[kind].P[rows]
    return {"E1": H[:, 0], "E2": H[:, 3], "s1": P[:, 0], "s2": P[:, 3]}


def strain_to(limits: FanLimits, kind: str) -> Floats:
    """Size of the strain at a kind of limit on each programme, infinite where there is none."""
    return np.where(limits.found[kind], np.hypot(*limits.states[kind].H[:, [0, 3]].T), np.inf)


def ends_of(fan: Fan, limits: FanLimits) -> pd.DataFrame:
    """Return the first limit of each programme, or its end, with strains and stresses there."""
    kinds = [*(kind for kind in ENDS if kind in LIMITS), "end"]
    distance = np.stack([strain_to(limits, kind) for kind in kinds])
    kind = np.where(np.isinf(distance).all(axis=0), "end", np.array(kinds)[distance.argmin(axis=0)])
    table = pd.DataFrame({"programme_deg": np.degrees(fan.programme), "kind": kind})
    table[["E1", "E2", "s1", "s2"]] = np.nan
    for name in kinds:
        at = (kind == name) & limits.found[name]
        own = in_planes(limits, name, at)
        table.loc[at, [*own]] = np.column_stack([*own.values()])
    return table


def yields_of(fan: Fan, limits: FanLimits) -> pd.DataFrame:
    """State of the first yield on each programme that has one."""
    at = limits.found["yield"]
    return pd.DataFrame(
        {"programme_deg": np.degrees(fan.programme[at]), **in_planes(limits, "yield", at)}
    )


def loop_domain(
    loop: Subject,
    closure: Closure | None = None,
    *,
    spins: Spins = "blocked",
    control: Control = "strain",
    directions: int | None = None,
    progress: Progress | None = None,
) -> LoopDomain:
    """Domain of one loop: what ends straight programmes from its present state, and where.

    Parameters
    ----------
    loop : SnapshotLoop, Scene or Snapshot
        One loop, `gl.loop(snapshot, 62)` for example.
    closure : {'affine', 'traction'}
        How the surrounding medium drives the grains; it has to be named.
    spins : {'blocked', 'affine', 'free'}
        What the grains' spins do; others than blocked follow each programme by itself.
    control : {'strain', 'stress'}
        Whether programmes are straight in (H11, H22) or in (P11, P22).
    directions : int
        Number of programmes in all directions, 3 or more; they end at a strain of five mean
        overlaps. If left out 361, or 61 (spins that turn, other laws).
    progress : callable, optional
        Called after each programme with how many are done, the seconds that the others will take
        at their pace, and how many are left.

    Returns
    -------
    LoopDomain
        `.table()` has a row a programme: what ended it (`det Ks = 0`, `det K = 0`, no continuation,
        an opening, the end of the range), the changes `E1`, `E2` of strain and the stresses `s1`,
        `s2` (force/length) there, positive in compression. `.plot()` draws them.

    Raises
    ------
    InputError
        Without a closure, for other words, for a packing in place of a loop, or if the forces do
        not fit the law.

    Examples
    --------
    >>> from patterns import loop_of_snapshot, read_snapshot, sample_path
    >>> one = loop_of_snapshot(read_snapshot(sample_path()), 62)
    >>> found = loop_domain(one, "traction", directions=9)
    >>> found.status, len(found.rows)
    ('stable', 9)
    """
    closure = named_closure(closure)
    check_choice("control", control, ("strain", "stress"))
    scene: Scene = scene_of(loop)
    if directions is None:
        directions = programmes_of(spins, linear=linear_springs(scene.law))
    whole_number("directions", directions, 3)
    if scene.boundary.kind != "free":
        received, remedy = f"a scene that ends at {scene.boundary.kind}", "Cut one out: gl.loop."
        raise InputError("first argument", received, "one loop", remedy)
    how: Any = closure, spins, control, directions, paced(progress, directions)
    fan, limits = present_fan(scene.graph, scene.law, *how)
    return domain_of(fan, limits, "force/length")


def domain_of(fan: Fan, limits: FanLimits, stress_unit: str) -> LoopDomain:
    """Domain of a loop from its fan and the limits along it."""
    start = np.diagonal(nominal_stress(fan.loop.graph))
    tangent, status = present_tangent(fan)
    rows = ends_of(fan, limits)
    if status == "unstable":
        rows[["kind", "E1", "E2", "s1", "s2"]] = "start", 0.0, 0.0, *start
    strain = np.stack([np.cos(fan.programme), np.sin(fan.programme)], axis=-1)
    if fan.control == "stress":
        strain = np.linalg.solve(tangent, strain.T).T
    return LoopDomain(
        rows=rows.assign(start_w2=normalised_second_order_work(tangent, strain)),
        yields=yields_of(fan, limits),
        start=start,
        status=status,
        control=fan.control,
        stress_unit=stress_unit,
        tangent=tangent,
        reach=fan.reach,
    )


def virgin_domain(fan: Fan, limits: FanLimits) -> LoopDomain:
    """Domain of a loop that begins without load, along programmes that compress every branch."""
    return LoopDomain(
        rows=ends_of(fan, limits),
        yields=yields_of(fan, limits),
        start=np.zeros(2),
        status="unloaded",
        control=fan.control,
        stress_unit="over $k_n$",
        tangent=np.full((2, 2), np.nan),
        reach=fan.reach,
        all_around=False,
    )


@styled()
def loop_domain_figure(found: Mapping[str, LoopDomain], plane: str) -> Figure:
    """Domains of one loop by its start or kind of contacts, a panel each."""
    figure, (axes,) = new_panels(1, len(found), 4.4, ONE_COLUMN * len(found))
    for ax, (name, domain) in zip(axes, found.items(), strict=True):
        key = draw_loop_domain(domain, ax, plane).get_legend()
        assert key is not None
        key.set_title(name)
    return figure


def draw_loop_domain(found: LoopDomain, ax: Axes, plane: str = "strain") -> Axes:
    """Boundary of a domain in the plane of strains or of stresses; of an unstable loop its cone."""
    origin = np.zeros(2) if plane == "strain" else found.start
    if found.status == "unstable":
        _draw_present(found, ax, origin, IDENTITY if plane == "strain" else found.tangent)
    else:
        _draw_ends(found, ax, origin, plane)
    label = f"present state, {found.status}" if found.all_around else "no load"
    ax.plot(*origin, "P", color=BLACK, markersize=5, label=label)
    unit = " (–)" if plane == "strain" else f" ({found.stress_unit})"
    symbol = "E" if plane == "strain" else "P"
    changes = "change of strain " if found.all_around else "strain "
    change = changes if plane == "strain" else "stress "
    ax.set(xlabel=f"{change}${symbol}_{{11}}${unit}", ylabel=f"{change}${symbol}_{{22}}${unit}")
    ax.set_aspect("equal", adjustable="datalim")
    ax.autoscale_view()
    ax.ticklabel_format(scilimits=(-2, 3))
    outer_legend(ax, "lower left", (0.0, 1.0), 1.8)
    return ax


def _draw_ends(found: LoopDomain, ax: Axes, origin: Floats, plane: str) -> None:
    """Ends of the programmes as a line, the programmes where they are straight, first yields."""
    names = ["E1", "E2"] if plane == "strain" else ["s1", "s2"]
    points, kind = found.rows[names].to_numpy(dtype=float), found.rows["kind"].to_numpy()
    if found.control == plane:  # in the other plane programmes are curves
        rays = [np.stack([origin, point]) for point in points[:: max(1, len(points) // RAYS)]]
        ax.add_collection(LineCollection(rays, colors=LIGHT_GREY, linewidths=0.5, zorder=0))
    for name, (colour, style, text) in ENDS.items():
        if (kind == name).any():
            lines: Any = stretches(found.rows, names, kind == name)
            look: Any = {"colors": colour, "linestyles": style, "linewidths": 1.3}
            ax.add_collection(LineCollection(lines, capstyle="round", **look))
            share = 100.0 * np.mean(kind == name)
            ax.plot([], [], style, color=colour, label=f"{text} ({share:.1f} %)")
    inside = found.yields[names].to_numpy(dtype=float)
    # Contacts that slide from the start yield in the present state itself.
    inside = inside[np.abs(inside - origin).max(axis=1) > 0.01 * np.nanmax(np.ptp(points, axis=0))]
    if len(inside):
        ax.plot(*inside.T, ".", color=GREEN, markersize=2.5, label="a contact yields")


def goes_on(rows: pd.DataFrame) -> Flags:
    """Whether the border of a domain goes on from each programme to the next one in a circle.

    It is interrupted where programmes are missing or their ends unknown, and where the strain at
    the end jumps: by far more than at the programmes around, and by more than a little.
    """
    reach, angle = (np.hypot(rows["E1"], rows["E2"]).to_numpy(), rows["programme_deg"].to_numpy())
    step, turn = np.abs(np.roll(reach, -1) - reach), np.mod(np.roll(angle, -1) - angle, 360.0)
    around = pd.Series(np.concatenate([step[-3:], step, step[:3]]))
    usual = around.rolling(7, center=True, min_periods=1).median().to_numpy()[3 : 3 + len(step)]
    least = LEAST_JUMP * np.nanmax(reach, initial=0.0)
    on: Flags = (step <= JUMP * usual + least) & (turn < 1.5 * np.median(turn))
    return on


def stretches(rows: pd.DataFrame, names: list[str], kept: Flags) -> list[Floats]:
    """Lines of the border of a domain through the programmes kept, each up to the next one.

    A programme on its own, interrupted on both sides, is a dot.
    """
    points, on = rows[names].to_numpy(dtype=float), goes_on(rows)
    closed = np.vstack([points, points[:1]])
    alone = kept & ~on & ~np.roll(on, 1)
    lines = [closed[run.start : run.stop + 1] for run in true_runs(kept & on)]
    return lines + [points[[k, k]] for k in np.flatnonzero(alone)]


def _draw_present(found: LoopDomain, ax: Axes, origin: Floats, map_strain: Floats) -> None:
    """Directions of the present state: strains of the range, mapped, by the sign of their work."""
    angle = np.linspace(0.0, 2.0 * np.pi, FINE + 1)
    strain = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    between = np.stack([np.cos(angle[:-1] + np.pi / FINE), np.sin(angle[:-1] + np.pi / FINE)]).T
    work = ((between @ found.tangent.T) * between).sum(axis=1)
    points = origin + found.reach * strain @ map_strain.T
    rays = [np.stack([origin, point]) for point in points[:: FINE // RAYS]]
    ax.add_collection(LineCollection(rays, colors=LIGHT_GREY, linewidths=0.5, zorder=0))
    negative = np.stack([points[:-1], points[1:], np.tile(origin, (FINE, 1))], axis=1)[work < 0.0]
    ax.add_collection(
        PolyCollection(list(negative), facecolors=VERMILION, edgecolors=VERMILION, linewidths=0.4)
    )
    share = 100.0 * np.mean(work < 0.0)
    label = f"negative second-order work ({share:.1f} % of the strains)"
    ax.plot([], [], color=VERMILION, linewidth=4.0, label=label)
    around = "strain" if map_strain is IDENTITY else "response to a strain"
    ax.plot(*points.T, "-", color=GREY, linewidth=1.0, label=f"{around} of {found.reach:.2g}")
