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
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator

from loops import GrainGraph, InputError, LinearFrictional, Regime, Scene, boundary_of
from loops.arrays import Floats
from loops.errors import check_choice
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
from stability.paths.domain import LIMITS, Control, Fan, FanLimits
from studies.clock import Progress, paced
from studies.output import Summary
from studies.paths.options import LoopOptions, PolygonOptions, file_notes, inside
from studies.present_domain import (
    LoopDomain,
    domain_of,
    in_planes,
    limits_along,
    loop_domain_figure,
    present_fan,
    strain_to,
    stretches,
    virgin_domain,
)
from studies.study import Drawings, study
from studies.style import (
    BLACK,
    LINE_COLOURS,
    ONE_COLUMN,
    TWO_COLUMNS,
    figure_key,
    key_columns,
    new_panels,
    styled,
)

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
LONGEST = 60
PRESENT = "from the present state"
SLIDING_WORDS = {
    "sticking": "contacts never slide",
    "frictional": r"contacts slide at $|T| = \mu N$",
}
PLANES = (("domain", "stress"), ("domain-strain", "strain"))


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


def first_losses(
    case: Case, directions: int, *, friction: bool, after_one: Callable[[], object] = lambda: None
) -> tuple[Fan, FanLimits]:
    """Losses of one diamond along its fan of programmes, whose P are the paper's stresses."""
    virgin, mu = diamond(case.alpha0), case.mu if friction else np.inf
    boundary = boundary_of(virgin, volume=2.0 * np.sin(2.0 * case.alpha0))
    loop = Scene(virgin, LinearFrictional(1.0, case.kappa, mu), boundary)
    programme = loop_fan(virgin.reference_branches, directions)
    fan = Fan(loop, "affine", "blocked", "strain", programme, REACH)
    return fan, limits_along(fan, after_one)


def domain_table(
    cases: tuple[Case, ...], directions: int, progress: Progress | None = None
) -> pd.DataFrame:
    """Losses of every diamond along its fan, with contacts that stick and with friction."""
    parts, fans = [], [(case, friction) for case in cases for friction in _contacts(case)]
    after_one = paced(progress, len(fans) * directions)
    for case, friction in fans:
        losses = first_losses(case, directions, friction=friction, after_one=after_one)
        name = "frictional" if friction else "sticking"
        parts += [loss_table(case, *losses, kind, name) for kind in LOSSES]
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


def loop_limits(
    loop: PolygonOptions,
    control: Control,
    directions: int,
    *,
    friction: bool,
    after_one: Callable[[], object] = lambda: None,
) -> tuple[Fan, FanLimits]:
    """First limits of one loop along its fan."""
    graph, law = loop.graph(), loop.law()
    if isinstance(loop, LoopOptions):
        how: Any = loop.closure, loop.spins, control, directions, after_one
        return present_fan(graph, law, *how)
    if not friction:
        law = (loop if loop.phi_deg == 90.0 else replace(loop, phi_deg=90.0)).law()
    around = loop_fan(graph.reference_branches, directions)
    whole = Scene(graph, law)
    fan = Fan(whole, loop.closure, loop.spins, control, around, FAN_REACH)
    return fan, limits_along(fan, after_one)


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
        fan, limits = loop_limits(loop, *fan_options, friction=friction, after_one=after_one)
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
            alone[SLIDING_WORDS[named["contacts"]]] = virgin_domain(fan, limits)
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


def domain_boundary(rows: pd.DataFrame) -> pd.DataFrame:
    """The first state of each programme at which the loop is lost or parts, by programme."""
    rows = rows[rows.kind.isin((*STABILITY_LIMITS, "opening"))]
    first = np.hypot(rows.E1, rows.E2).groupby(rows.programme_deg).idxmin()
    return rows.loc[first].sort_values("programme_deg")


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
                rows = table[(table.contacts == contacts) & (table.closure == closure)
                            & (table.order == order) & (table.kappa == kappa)]  # fmt: skip
                bound = domain_boundary(rows)
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
