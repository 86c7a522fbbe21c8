"""Bifurcation domains of loops: where loading programmes lose stability in (s1, s2).

Diamonds: from the virgin loop, a fan of straight strain programmes `E' = (cos b, sin b)`; on
each the first state where `det Ks = 0` and where `det K = 0`, located by `follow`, with contacts
that always stick and with friction. Sticking contacts have `det K = kappa - N/l` (35) and
`det Ks = det K - (T/2l)^2`, because
`K12 - K21 = -T/l`: in terms of the branch alone, the same for every `alpha0`. With
`T = s mu N` they slide, and `det K = -(1 + mu^2) N/l` (36) is negative at once: where a programme
yields before, both determinants are lost in a jump.

Loops of any order, of unequal grains, and of a snapshot: the limits of a fan of straight programmes
(`stability.paths.domain`), the share of the strain plane that they leave unstable, and the domains
of several orders over one another.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pandas as pd
from matplotlib import colormaps
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator

from loops import (
    GrainGraph,
    InputError,
    LinearFrictional,
    Regime,
    Scene,
    boundary_of,
    contact_state,
    macroscopic_tangent,
    nominal_stress,
)
from loops.arrays import Flags, Floats, one_blas_thread, true_runs
from loops.closures import Closure, Spins
from loops.closures.system import named_closure
from loops.errors import check_choice, whole_number
from loops.laws.kinds import linear_springs
from loops.scene import Subject, scene_of
from loops.shown import Shown
from patterns import diamond
from patterns.diamond import (
    TABLE_1,
    TABLE_2,
    angle_from_strains,
    critical_strain,
    opposite_gaps,
    stress_of_isotropic_strain,
)
from patterns.diamond import DiamondParameters as Case
from patterns.diamond.states import diamond_states
from patterns.polygons import opposite_gap
from stability import judge, normalised_second_order_work, restrict
from stability.paths.domain import LIMITS, Control, Fan, FanLimits
from studies.clock import Progress, paced
from studies.output import Summary, words
from studies.paths.options import LoopOptions, PolygonOptions, file_notes, inside
from studies.study import Drawings, study
from studies.style import (
    BLACK,
    BLUE,
    GREEN,
    GREY,
    LIGHT_GREY,
    LINE_COLOURS,
    ONE_COLUMN,
    ORANGE,
    TWO_COLUMNS,
    VERMILION,
    figure_key,
    key_columns,
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
Answer = tuple[dict[str, pd.DataFrame], Summary, Drawings, str]
PAPER_CASES = TABLE_1, TABLE_2
# Strain up to which programmes are followed: no diamond is left there.
REACH = 1.5
LOSSES = ("det_Ks_zero", "det_K_zero")
# Opposite grains nearer than this, in reference branches, touch within rounding.
OVERLAP_ATOL = 1e-14
# Programmes of a fan if none are asked for.
PROGRAMMES = 181
# Strain at which the programmes of a virgin loop end.
FAN_REACH = 0.95
# Limits that end stability in (11, 22).
STABILITY_LIMITS = ("det_Ks_zero", "limit")
PRESENT = "from the present state"
SLIDING_WORDS = {
    "sticking": "contacts never slide",
    "frictional": r"contacts slide at $|T| = \mu N$",
}
PLANES = (("domain", "stress"), ("domain-strain", "strain"))


# ---- one loop


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
    loop: Scene, closure: Closure, spins: Spins, control: Control, directions: int
) -> Fan:
    """Programmes from the present state of a loop in all directions."""
    graph = loop.graph.replace(x0=loop.graph.x)
    contacts = contact_state(graph)
    overlap = float(np.mean(contacts.overlap / contacts.touching_length))
    # All directions, 45 degrees among them: the isotropic one for equal sides.
    around = 0.25 * np.pi + np.linspace(-np.pi, np.pi, directions, endpoint=False)
    return Fan(Scene(graph, loop.law), closure, spins, control, around, REACH_OVERLAPS * overlap)


@one_blas_thread()
def limits_along(fan: Fan, after_one: Callable[[], object] = lambda: None) -> FanLimits:
    """Return first limits along the programmes; none of a loop under load that is unstable."""
    limits, loaded = FanLimits.none(fan), bool(fan.loop.graph.normal_force.any())
    if loaded and present_tangent(fan)[1] == "unstable":
        return limits
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
    fan = present_fan(scene, closure, spins, control, directions)
    return domain_of(fan, limits_along(fan, paced(progress, directions)), "force/length")


def domain_of(fan: Fan, limits: FanLimits, stress_unit: str, *, loaded: bool = True) -> LoopDomain:
    """Domain of a loop from its fan and the limits along it.

    One that is not loaded begins at no stress, along programmes that compress every branch.
    """
    start, rows = np.diagonal(nominal_stress(fan.loop.graph)), ends_of(fan, limits)
    tangent, status = np.full((2, 2), np.nan), "unloaded"
    if loaded:
        tangent, status = present_tangent(fan)
        if status == "unstable":
            rows[["kind", "E1", "E2", "s1", "s2"]] = "start", 0.0, 0.0, *start
        strain = np.stack([np.cos(fan.programme), np.sin(fan.programme)], axis=-1)
        if fan.control == "stress":
            strain = np.linalg.solve(tangent, strain.T).T
        rows = rows.assign(start_w2=normalised_second_order_work(tangent, strain))
    whole = rows, yields_of(fan, limits), start, status, fan.control, stress_unit, tangent
    return LoopDomain(*whole, fan.reach, all_around=loaded)


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
    yields = found.yields[names].to_numpy(dtype=float)
    # Contacts that slide from the start yield in the present state itself.
    yields = yields[np.abs(yields - origin).max(axis=1) > 0.01 * np.nanmax(np.ptp(points, axis=0))]
    if len(yields):
        ax.plot(*yields.T, ".", color=GREEN, markersize=2.5, label="a contact yields")


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


# ---- diamonds


def described(case: Case) -> dict[str, float]:
    """Columns of the table and the summary that name a diamond, angles in degrees."""
    alpha0, phi = (round(float(np.degrees(angle)), 12) for angle in (case.alpha0, case.phi))
    return {"alpha0_deg": alpha0, "kappa": case.kappa, "phi_deg": phi}


def rows_of(table: pd.DataFrame, case: Case) -> pd.DataFrame:
    """The rows of one diamond."""
    named = described(case)
    return table[(table[list(named)] == list(named.values())).all(axis=1)]


@dataclass(frozen=True)
class DomainParameters:
    """Options of `grainloops domain`; angles in degrees."""

    alpha0_deg: tuple[float, ...] | None = None
    kappa: tuple[float, ...] | None = None
    phi_deg: float | None = None
    directions: int = PROGRAMMES

    def __post_init__(self) -> None:
        inside("--alpha0", self.alpha0_deg, lambda a: 0.0 < a < 90.0, "degrees in (0, 90)")
        inside("--kappa", self.kappa, lambda k: k > 0.0, "positive ratios")
        inside("--phi", self.phi_deg, lambda p: 0.0 < p <= 90.0, "degrees in (0, 90]")
        require_odd(self.directions)

    def cases(self) -> tuple[Case, ...]:
        """The diamonds, in radians."""
        if self.alpha0_deg is None and self.kappa is None and self.phi_deg is None:
            return PAPER_CASES
        angles = (TABLE_1.alpha0,) if self.alpha0_deg is None else np.radians(self.alpha0_deg)
        ratios = (TABLE_1.kappa,) if self.kappa is None else self.kappa
        phi = TABLE_1.phi if self.phi_deg is None else float(np.radians(self.phi_deg))
        return tuple(Case(float(a), k, phi, 0.0) for a, k in product(angles, ratios))

    def described(self) -> dict[str, Any]:
        """Value of every option by its name on the command line."""
        cases = [described(case) for case in self.cases()]
        return {"cases": cases, "directions": self.directions}

    def answer(self, progress: Progress | None = None) -> Answer:
        """Tables, summary and figures of the domains, and the title of their page."""
        table = domain_table(self.cases(), self.directions, progress)
        drawings = [("domain", lambda: domain_figure(table, self.cases()))]
        summary = domain_summary(table, self)
        return {"domain": table}, summary, drawings, "Bifurcation domains of diamonds"


def require_odd(directions: int) -> None:
    """Raise `InputError` unless a fan has a programme in its middle."""
    if directions < 3 or directions % 2 == 0:
        received, expected = str(directions), "an odd number from 3 on"
        raise InputError("--directions", received, expected, "Correct it.")


def diamond_fan(case: Case, directions: int, *, friction: bool) -> Fan:
    """Fan of programmes of one diamond, whose P are the paper's stresses."""
    virgin, mu = diamond(case.alpha0), case.mu if friction else np.inf
    boundary = boundary_of(virgin, volume=2.0 * np.sin(2.0 * case.alpha0))
    loop = Scene(virgin, LinearFrictional(1.0, case.kappa, mu), boundary)
    programme = loop_fan(virgin.reference_branches, directions)
    return Fan(loop, "affine", "blocked", "strain", programme, REACH)


def domain_table(
    cases: tuple[Case, ...], directions: int, progress: Progress | None = None
) -> pd.DataFrame:
    """Losses of every diamond along its fan, with contacts that stick and with friction."""
    parts, fans = [], [(case, friction) for case in cases for friction in _contacts(case)]
    after_one = paced(progress, len(fans) * directions)
    for case, friction in fans:
        fan = diamond_fan(case, directions, friction=friction)
        losses, name = limits_along(fan, after_one), "frictional" if friction else "sticking"
        parts += [loss_table(case, fan, losses, kind, name) for kind in LOSSES]
    return pd.concat(parts, ignore_index=True)


def _contacts(loop: Case | PolygonOptions) -> tuple[bool, ...]:
    """Whether contacts slide: never, and where they have friction; of a snapshot as they do."""
    if isinstance(loop, LoopOptions):
        return (True,)
    return (False, True) if np.isfinite(loop.mu) else (False,)


def loss_table(case: Case, fan: Fan, limits: FanLimits, kind: str, contacts: str) -> pd.DataFrame:
    """One row for each programme with a loss of this kind: its state and determinants."""
    rows = limit_rows(fan, limits, kind, {**described(case), "contacts": contacts})
    E1, E2, s1, s2 = (rows[name].to_numpy() for name in ("E1", "E2", "s1", "s2"))
    alpha0, alpha = case.alpha0, angle_from_strains(E1, E2, case.alpha0)
    T = s1 * np.sin(alpha0) * np.sin(alpha) - s2 * np.cos(alpha0) * np.cos(alpha)
    state = diamond_states(case, E1, E2, T, sliding=rows.regime == "sliding", s1=s1, s2=s2)
    rows = rows.drop(columns="opposite_overlap").assign(N=state.N, T=T, alpha_deg=np.degrees(alpha))
    overlap = np.minimum(*opposite_gaps(E1, E2, alpha0)) < -OVERLAP_ATOL
    return rows.assign(det_K=state.det_K, det_Ks=state.det_Ks, opposite_overlap=overlap)


def run_domain(
    parameters: DomainParameters | LoopDomainParameters,
    out: Path,
    progress: Progress | None = None,
    **files: Any,
) -> Summary:
    """Find the bifurcation domains of diamonds or loops, and write tables, summary and figures.

    `files` are `force`, `csv` and `figures` of a study.
    """
    with study("domain", out, parameters.described(), **files) as results:
        return results.write_results(*parameters.answer(progress))


def domain_summary(table: pd.DataFrame, parameters: DomainParameters) -> Summary:
    """Counts and bounds of each diamond's domain."""
    cases = []
    for case in parameters.cases():
        contacts = {}
        for name, rows in rows_of(table, case).groupby("contacts"):
            first, last = (rows[rows.kind == kind].set_index("programme_deg") for kind in LOSSES)
            # Along one programme the strains grow in proportion.
            size = [np.hypot(lost.E1, lost.E2) for lost in (first, last)]
            contacts[str(name)] = {
                "det_Ks_zero": len(first),
                "det_K_zero": len(last),
                "by_yielding": int((first.regime == "sliding").sum()),
                "opposite_overlap": int(first.opposite_overlap.sum()),
                "det_Ks_first": len(first) - int((size[0] >= size[1].reindex(size[0].index)).sum()),
                "s1": [float(first.s1.min()), float(first.s1.max())],
                "s2": [float(first.s2.min()), float(first.s2.max())],
            }
        strain = float(critical_strain(case.kappa))
        cases.append({**described(case), "isotropic_strain": strain, "contacts": contacts})
    return {"directions": parameters.directions, "cases": cases}


@styled()
def domain_figure(table: pd.DataFrame, cases: Sequence[Case]) -> Figure:
    """The domains, a column for each reference angle; below, near a single diamond's curves."""
    angles = list(dict.fromkeys(case.alpha0 for case in cases))
    rows, columns = 2 if len(angles) == len(cases) else 1, len(angles)
    width = ONE_COLUMN * 1.2 if columns == 1 else max(TWO_COLUMNS, 2.4 * columns)
    figure, panels = new_panels(rows, columns, 0.8 + 2.4 * rows, width)
    for angle, (whole, *near) in zip(angles, panels.T, strict=True):
        similar = [case for case in cases if case.alpha0 == angle]
        if near:
            draw_domain(table, similar, near[0], _colours(cases))
            # Limits around the curves of sticking contacts.
            losses = pd.concat([rows_of(table, case) for case in similar])
            sticking = losses[losses.contacts == "sticking"]
            for values, limit in ((sticking.s1, near[0].set_xlim), (sticking.s2, near[0].set_ylim)):
                margin = 0.1 * (values.max() - values.min())
                limit(values.min() - margin, values.max() + margin)
        draw_domain(table, similar, whole, _colours(cases))
        slides, phi = np.isfinite(similar[0].mu), np.degrees(similar[0].phi)
        friction = rf"$\varphi$ = {phi:g}°" if slides else "no sliding"
        whole.set_title(rf"$\alpha_0$ = {np.degrees(angle):g}°, {friction}")
    handles: list[Artist] = [
        Line2D([], [], color=BLACK, label=r"$\det K_s = 0$, sticking"),
        Line2D([], [], color=BLACK, linestyle="--", label=r"$\det K = 0$, sticking"),
    ]
    if any(np.isfinite(case.mu) for case in cases):
        handles += [
            Line2D([], [], color=BLACK, linestyle=":", label="yield: both lost by sliding"),
            Patch(facecolor=BLACK, alpha=0.15, label="stable with friction"),
        ]
    for kappa, colour in _colours(cases).items():
        label = rf"isotropic strain, $\kappa$ = {kappa:g}"
        handles.append(Line2D([], [], color=colour, marker="o", linestyle="", label=label))
    beside = key_columns(figure, 2 if columns == 1 else 4)
    figure.legend(handles=handles, loc="outside lower center", ncols=beside)
    return figure


def _colours(cases: Sequence[Case]) -> dict[float, str]:
    """Colour of each stiffness ratio."""
    ratios = dict.fromkeys(case.kappa for case in cases)
    return {kappa: LINE_COLOURS[k % len(LINE_COLOURS)] for k, kappa in enumerate(ratios)}


def draw_domain(
    table: pd.DataFrame, cases: Sequence[Case], ax: Axes, colours: Mapping[float, str]
) -> None:
    """Domains of diamonds of one reference angle."""
    for case in cases:
        colour = colours[case.kappa]
        rows = rows_of(table, case)
        for kind, style in (("det_Ks_zero", "-"), ("det_K_zero", "--")):
            curve = rows[(rows.contacts == "sticking") & (rows.kind == kind)]
            ax.plot(curve.s1, curve.s2, style, color=colour, linewidth=1.0)
        bound = rows[(rows.contacts == "frictional") & (rows.kind == "det_Ks_zero")]
        ax.fill(bound.s1, bound.s2, color=colour, alpha=0.15, linewidth=0.0)
        # The part lost by sliding, up to its neighbours on the elastic side.
        sliding = np.pad((bound.regime == "sliding").to_numpy(), 1)
        near = sliding[:-2] | sliding[1:-1] | sliding[2:]
        yielding = (np.where(near, values, np.nan) for values in (bound.s1, bound.s2))
        ax.plot(*yielding, ":", color=colour, linewidth=1.6)
        s1, s2 = stress_of_isotropic_strain(critical_strain(case.kappa), case.alpha0)
        ax.plot(float(s1), float(s2), "o", color=colour)
    ax.set(xlabel="$s_1$ over $k_n$ (–)", ylabel="$s_2$ over $k_n$ (–)")
    ax.locator_params(nbins=6)


# ---- loops of any order


@dataclass(frozen=True)
class LoopDomainParameters:
    """Options of `grainloops domain --order`, `--compare`, `--radii` and `--snapshot`."""

    loops: tuple[PolygonOptions, ...]
    control: Control = "strain"
    directions: int = 361

    def __post_init__(self) -> None:
        check_choice("--programmes", self.control, get_args(Control))
        require_odd(self.directions)
        for loop in self.loops:
            inside("--kappa", loop.kappa, lambda k: k > 0.0, "positive ratios")
            inside("--phi", loop.phi_deg, lambda p: p > 0.0, "degrees in (0, 90]")

    def described(self) -> dict[str, Any]:
        """Value of every option by its name on the command line."""
        loops = [_loop_columns(loop) | loop.special() for loop in self.loops]
        return {"loops": loops, "programmes": self.control, "directions": self.directions}

    def answer(self, progress: Progress | None = None) -> Answer:
        """Tables, summary and figures of the domains, and the title of their page."""
        table, loops, alone = loop_domains(self, progress)
        summary = {"directions": self.directions, "loops": loops}
        summary["notes"] = file_notes(self.loops[0])
        tables, drawings = {"domain": table}, loop_figures(table, loops, self)
        if PRESENT in alone:
            tables["boundary"] = alone[PRESENT].rows
        if alone:
            drawings = ((n, partial(loop_domain_figure, alone, plane)) for n, plane in PLANES)
        return tables, summary, drawings, "Bifurcation domains of loops"


def _loop_columns(loop: PolygonOptions) -> dict[str, Any]:
    """Columns of the table and the summary that name a loop; of a snapshot's its mean contact."""
    kappa, phi = loop.kappa, loop.phi_deg
    if isinstance(loop, LoopOptions):
        law = loop.law()
        kappa, phi = float(np.mean(law.kt / law.kn)), float(np.degrees(np.arctan(np.mean(law.mu))))
    named = {"order": loop.order, "closure": loop.closure, "spins": loop.spins}
    return {**named, "kappa": kappa, "phi_deg": phi}


def loop_fan(d0: Floats, directions: int) -> Floats:
    """Angles of programmes that compress every branch at first, as the diamond's fan.

    Evenly spread on either side of the isotropic one, measured in half diagonals.
    """
    size = np.sqrt((d0**2).sum(axis=0))
    middle, across = np.arctan2(size[1], size[0]), d0**2 / size
    # The rate of a branch vanishes a right angle from this direction.
    toward = np.arctan2(across[:, 1], across[:, 0])
    low, high = toward.max() - 0.5 * np.pi, toward.min() + 0.5 * np.pi
    half = directions // 2
    share = np.arange(-half, half + 1) / (half + 1)
    turned = middle + np.where(share < 0.0, middle - low, high - middle) * share
    return np.arctan2(np.sin(turned) / size[1], np.cos(turned) / size[0])


def programmes_along(
    loop: PolygonOptions, control: Control, directions: int, *, friction: bool
) -> Fan:
    """Fan of one loop: from its present state in a snapshot, else from no load."""
    whole = Scene(loop.graph(), loop.law())
    if isinstance(loop, LoopOptions):
        return present_fan(whole, loop.closure, loop.spins, control, directions)
    if not friction and loop.phi_deg < 90.0:
        whole = replace(whole, law=replace(loop, phi_deg=90.0).law())
    around = loop_fan(whole.graph.reference_branches, directions)
    return Fan(whole, loop.closure, loop.spins, control, around, FAN_REACH)


def unstable_share(fan: Fan, limits: FanLimits) -> float:
    """Share of the strains up to the first opening, or `reach`, beyond the loss of stability.

    Areas `int rho^2/2 db` by the trapezoidal rule over the programmes.
    """
    direction = np.stack([np.cos(fan.programme), np.sin(fan.programme)], axis=-1)
    d0 = fan.loop.graph.reference_branches
    rate = direction[:, None, :] * d0
    # |d0 - rho rate| = |d0|.
    opening = 2.0 * (rate * d0).sum(axis=-1) / (rate**2).sum(axis=-1)
    end = np.minimum(opening.min(axis=1), fan.reach)
    end = np.minimum(end, strain_to(limits, "opening"))
    stable = np.minimum(end, np.minimum(*(strain_to(limits, kind) for kind in STABILITY_LIMITS)))
    left, whole = (np.trapezoid(0.5 * rho**2, fan.programme) for rho in (stable, end))
    return float(1.0 - left / whole)


def loop_domains(
    parameters: LoopDomainParameters, progress: Progress | None = None
) -> tuple[pd.DataFrame, list[dict[str, Any]], dict[str, LoopDomain]]:
    """Limits of every loop, contacts sticking and with friction; their counts and the shares.

    Besides the domains of a loop of a snapshot, which begins in its present state, or of a single
    other one, by kind of contacts.
    """
    parts, loops, alone = [], [], {}
    fan_options = parameters.control, parameters.directions
    fans = [(loop, friction) for loop in parameters.loops for friction in _contacts(loop)]
    after_one = paced(progress, len(fans) * parameters.directions)
    for loop, friction in fans:
        from_snapshot = isinstance(loop, LoopOptions)
        fan = programmes_along(loop, *fan_options, friction=friction)
        limits = limits_along(fan, after_one)
        named = {**_loop_columns(loop), "contacts": "frictional" if friction else "sticking"}
        parts += [limit_rows(fan, limits, kind, named) for kind in LIMITS]
        counts = {kind: int(limits.found[kind].sum()) for kind in sorted(LIMITS)}
        met = {kind: count for kind, count in counts.items() if count}
        loops.append({**named, "limits": met})
        if parameters.control == "strain" and not from_snapshot:
            loops[-1]["unstable_share"] = unstable_share(fan, limits)
        if from_snapshot:
            present = domain_of(fan, limits, "over $k_n$")
            loops[-1]["present_state"] = present.status
            loops[-1]["negative_share"] = float((present.rows["start_w2"] < 0.0).mean())
            counts = present.rows["kind"].value_counts().to_dict()
            loops[-1]["ended_by"] = {kind: counts[kind] for kind in sorted(counts)}
            alone[PRESENT] = present
        elif len(parameters.loops) == 1:
            domain = domain_of(fan, limits, "over $k_n$", loaded=False)
            alone[SLIDING_WORDS[named["contacts"]]] = domain
    filled = [part for part in parts if len(part)] or parts[:1]
    return pd.concat(filled, ignore_index=True), loops, alone


def limit_rows(fan: Fan, limits: FanLimits, kind: str, named: dict[str, Any]) -> pd.DataFrame:
    """One row for each programme with a limit of this kind: its state and stress."""
    met, graph = limits.found[kind], fan.loop.graph
    _, _, x, regime = (values[met] for values in limits.states[kind])
    sliding = (regime == Regime.SLIDING).any(axis=1)
    ring = GrainGraph(x=x, radii=graph.radii, contacts=graph.contacts)
    return pd.DataFrame(
        {
            **named,
            "kind": kind,
            "programme_deg": np.degrees(fan.programme[met]),
            "regime": np.where(sliding, "sliding", "elastic"),
            **in_planes(limits, kind, met),
            "opposite_overlap": opposite_gap(ring) < -OVERLAP_ATOL,
        }
    )


def loop_figures(
    table: pd.DataFrame, loops: list[dict[str, Any]], parameters: LoopDomainParameters
) -> Drawings:
    """The domains over one another, and the unstable share over order if there are several."""
    yield "domain", lambda: domains_figure(table, parameters)
    yield "domain-strain", lambda: domains_figure(table, parameters, ("E1", "E2"))
    if len({loop.order for loop in parameters.loops}) > 1 and "unstable_share" in loops[0]:
        yield "domain-share", lambda: share_figure(pd.DataFrame(loops))


@styled()
def domains_figure(
    table: pd.DataFrame, parameters: LoopDomainParameters, plane: tuple[str, str] = ("s1", "s2")
) -> Figure:
    """First loss of each programme by order, a panel for each closure and kind of contacts.

    In the plane of the stresses or of the strains (`E1`, `E2`).
    """
    closures = list(dict.fromkeys(loop.closure for loop in parameters.loops))
    orders = list(dict.fromkeys(loop.order for loop in parameters.loops))
    kinds = list(table.contacts.unique()) or ["no limit found"]
    kappa = table.kappa.iloc[0] if len(table) else parameters.loops[0].kappa
    # Kinds of contacts below one another, beside one another if there is one closure.
    alone = len(closures) == 1
    shape = (1, len(kinds)) if alone else (len(kinds), len(closures))
    figure, panels = new_panels(*shape, 0.8 + 2.5 * shape[0])
    panels = panels.reshape(len(kinds), len(closures))
    regular = plane == ("s1", "s2") and all(
        loop.radii is None and not isinstance(loop, LoopOptions) for loop in parameters.loops
    )
    over = r"$/(2\tan(\pi/n))$" if regular else ""
    unit = " over $k_n$ (–)" if plane == ("s1", "s2") else " (–)"
    names = [f"${name[0]}_{name[1]}${over}{unit}" for name in plane]
    colours = colormaps["viridis"](np.linspace(0.0, 0.9, len(orders)))
    for row, contacts in zip(panels, kinds, strict=True):
        for ax, closure in zip(row, closures, strict=True):
            for order, colour in zip(orders, colours, strict=True):
                # The first state of each programme at which the loop is lost or parts.
                rows = table[(table.contacts == contacts) & (table.closure == closure)
                            & (table.order == order) & (table.kappa == kappa)
                            & table.kind.isin((*STABILITY_LIMITS, "opening"))]  # fmt: skip
                first = np.hypot(rows.E1, rows.E2).groupby(rows.programme_deg).idxmin()
                bound = rows.loc[first].sort_values("programme_deg")
                # The force `s l0/(2 tan(pi/n))` of a contact across the axis of a regular loop.
                factor = 2.0 * np.tan(np.pi / order) if regular else 1.0
                lost = bound.kind.isin(STABILITY_LIMITS).to_numpy()
                for kept, style in ((lost, "-"), (~lost, ":")):
                    for line in stretches(bound, list(plane), kept):
                        look: Any = {"linewidth": 1.0, "solid_capstyle": "round"}
                        ax.plot(*line.T / factor, style, color=colour, **look)
            ax.plot(0.0, 0.0, "P", color=BLACK, markersize=4)
            ax.set_title(f"{closure} closure, {SLIDING_WORDS.get(contacts, contacts)}")
            ax.set(xlabel=names[0], ylabel=names[1])
            ax.set_aspect("equal", adjustable="datalim")
    handles = [
        Line2D([], [], color=c, label=f"n = {n}") for n, c in zip(orders, colours, strict=True)
    ]
    handles.append(Line2D([], [], color=BLACK, label="loss"))
    handles.append(Line2D([], [], color=BLACK, linestyle=":", label="a contact opens first"))
    handles.append(Line2D([], [], color=BLACK, marker="P", linestyle="", label="no load"))
    key: Any = {"title": rf"$\kappa$ = {kappa:g}", "ncols": key_columns(figure, 7)}
    figure.legend(handles=handles, loc="outside lower center", **key)
    return figure


@styled()
def share_figure(loops: pd.DataFrame) -> Figure:
    """Share of the strain plane that is unstable over order, a panel for each kind of contacts."""
    kinds = list(loops.contacts.unique())
    figure, (axes,) = new_panels(1, len(kinds), 2.9, 2.9 * len(kinds) + 0.6)
    for ax, contacts in zip(axes, kinds, strict=True):
        part = loops[loops.contacts == contacts]
        for (kappa, colour), closure in product(
            zip(part.kappa.unique(), LINE_COLOURS, strict=False), part.closure.unique()
        ):
            rows = part[(part.kappa == kappa) & (part.closure == closure)]
            style = "o-" if closure == "affine" else "s--"
            label = rf"{closure}, $\kappa$ = {kappa:g}"
            ax.plot(rows.order, rows.unstable_share, style, color=colour, markersize=3, label=label)
        ax.set(xlabel="order $n$ (–)", ylabel="unstable share of the strains (–)", ylim=(0, 1))
        ax.set_title(SLIDING_WORDS[contacts])
        ax.xaxis.set_major_locator(MaxNLocator(integer=True))
    figure_key(figure, ncols=key_columns(figure, 4))
    return figure
