"""Bifurcation domains of a loop of any order, or of one of a snapshot."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pandas as pd
from matplotlib import colormaps
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from loops import GrainGraph, InputError, Regime, Scene
from loops.arrays import Floats
from loops.errors import check_choice
from patterns.polygons import opposite_gap
from stability.paths.domain import LIMITS, Control, Fan, FanLimits
from studies.domain import OVERLAP_ATOL, require_odd
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
    virgin_domain,
)
from studies.study import Drawings, study
from studies.style import BLACK, LINE_COLOURS, figure_key, key_columns, new_panels, styled

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
# Distance of neighbours on a curve, over its extent, beyond which it jumps.
CURVE_JUMP = 0.15


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
            if loop.order > LONGEST:
                expected = f"a whole number from 3 to {LONGEST}"
                raise InputError("--order", str(loop.order), expected, "Correct it.")
            inside("--kappa", loop.kappa, lambda k: k > 0.0, "positive ratios")
            inside("--phi", loop.phi_deg, lambda p: p > 0.0, "degrees in (0, 90]")

    def described(self) -> dict[str, Any]:
        """Value of every option by its name on the command line."""
        loops = [_loop_columns(loop) | loop.special() for loop in self.loops]
        return {"loops": loops, "programmes": self.control, "directions": self.directions}


def _loop_columns(loop: PolygonOptions) -> dict[str, Any]:
    """Columns of the table and the summary that name a loop; of a snapshot's its mean contact."""
    kappa, phi = loop.kappa, loop.phi_deg
    if isinstance(loop, LoopOptions):
        law = loop.law()
        kappa, phi = float(np.mean(law.kt / law.kn)), float(np.degrees(np.arctan(np.mean(law.mu))))
    own = {"order": loop.order, "closure": loop.closure, "spins": loop.spins}
    return {**own, "kappa": kappa, "phi_deg": phi}


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
    loop: PolygonOptions, control: Control, directions: int, *, friction: bool
) -> tuple[Fan, FanLimits]:
    """First limits of one loop along its fan."""
    graph, law = loop.graph(), loop.law()
    if isinstance(loop, LoopOptions):
        return present_fan(graph, law, loop.closure, loop.spins, control, directions)
    if not friction:
        law = (loop if loop.phi_deg == 90.0 else replace(loop, phi_deg=90.0)).law()
    around = loop_fan(graph.reference_branches, directions)
    whole = Scene(graph, law)
    fan = Fan(whole, loop.closure, loop.spins, control, around, FAN_REACH)
    return fan, limits_along(fan)


def unstable_share(fan: Fan, limits: FanLimits) -> float:
    """Share of the strain plane in which the loop has lost stability in (11, 22).

    Of the strains on the programmes of a virgin loop up to the first opening of a contact (that of
    the programme or, after a loss, of branches that follow the strain), or to `reach`: the part
    beyond the loss. Areas `int rho^2/2 db` by the trapezoidal rule over the programmes.
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
    parameters: LoopDomainParameters,
) -> tuple[pd.DataFrame, list[dict[str, Any]], dict[str, LoopDomain]]:
    """Limits of every loop, contacts sticking and with friction; their counts and the shares.

    Besides the domains of a loop of a snapshot, which begins in its present state, or of a single
    other one, by kind of contacts.
    """
    parts, loops, alone = [], [], {}
    for loop in parameters.loops:
        own = isinstance(loop, LoopOptions)
        for friction in (True,) if own else (False, True) if np.isfinite(loop.mu) else (False,):
            fan, limits = loop_limits(
                loop, parameters.control, parameters.directions, friction=friction
            )
            named = {**_loop_columns(loop), "contacts": "frictional" if friction else "sticking"}
            parts += [limit_rows(fan, limits, kind, named) for kind in LIMITS]
            counts = {kind: int(limits.found[kind].sum()) for kind in sorted(LIMITS)}
            found = {kind: count for kind, count in counts.items() if count}
            loops.append({**named, "limits": found})
            if parameters.control == "strain" and not own:
                loops[-1]["unstable_share"] = unstable_share(fan, limits)
            if own:
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
    found, graph = limits.found[kind], fan.loop.graph
    _, _, x, regime = (values[found] for values in limits.states[kind])
    sliding = (regime == Regime.SLIDING).any(axis=1)
    ring = GrainGraph(x=x, radii=graph.radii, contacts=graph.contacts)
    return pd.DataFrame(
        {
            **named,
            "kind": kind,
            "programme_deg": np.degrees(fan.programme[found]),
            "regime": np.where(sliding, "sliding", "elastic"),
            **in_planes(limits, kind, found),
            "opposite_overlap": opposite_gap(ring) < -OVERLAP_ATOL,
        }
    )


def run_loop_domains(parameters: LoopDomainParameters, out: Path, **files: Any) -> Summary:
    """Find the bifurcation domains of loops, and write the table, summary and figures.

    `files` are `force`, `csv` and `figures` of a study.
    """
    with study("domain", out, parameters.described(), **files) as results:
        table, loops, alone = loop_domains(parameters)
        found = {"directions": parameters.directions, "loops": loops}
        found["notes"] = file_notes(parameters.loops[0])
        tables = {"domain": table}
        if PRESENT in alone:
            tables["boundary"] = alone[PRESENT].rows
        drawn: Drawings = loop_figures(table, loops, parameters)
        if alone:
            drawn = [(name, partial(loop_domain_figure, alone, plane)) for name, plane in PLANES]
        return results.write_results(tables, found, drawn)


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
    factor = r"$/(2\tan(\pi/n))$" if regular else ""
    unit = " over $k_n$ (–)" if plane == ("s1", "s2") else " (–)"
    names = [f"${name[0]}_{name[1]}${factor}{unit}" for name in plane]
    colours = colormaps["viridis"](np.linspace(0.0, 0.9, len(orders)))
    for row, contacts in zip(panels, kinds, strict=True):
        for ax, closure in zip(row, closures, strict=True):
            for order, colour in zip(orders, colours, strict=True):
                own = table[(table.contacts == contacts) & (table.closure == closure)
                            & (table.order == order) & (table.kappa == kappa)]  # fmt: skip
                bound = domain_boundary(own)
                values = bound[list(plane)].to_numpy()
                # The force `s l0/(2 tan(pi/n))` of a contact across the axis of a regular loop.
                values = values / (2.0 * np.tan(np.pi / order)) if regular else values
                lost = bound.kind.isin(STABILITY_LIMITS).to_numpy()
                ax.plot(*_pieces(values, lost), "-", color=colour, linewidth=1.0)
                ax.plot(*_pieces(values, ~lost), ":", color=colour, linewidth=0.8)
            ax.plot(0.0, 0.0, "P", color=BLACK, markersize=4)
            ax.set_title(f"{closure} closure, {SLIDING_WORDS.get(contacts, contacts)}")
            ax.set(xlabel=names[0], ylabel=names[1])
            ax.set_aspect("equal", adjustable="datalim")
    handles = [
        Line2D([], [], color=c, label=f"n = {n}") for n, c in zip(orders, colours, strict=True)
    ]
    styles: tuple[tuple[Any, str], ...] = (("-", "loss"), (":", "a contact opens first"))
    for style, label in styles:
        handles.append(Line2D([], [], color=BLACK, linestyle=style, label=label))
    handles.append(Line2D([], [], color=BLACK, marker="P", linestyle="", label="no load"))
    key: Any = {"title": rf"$\kappa$ = {kappa:g}", "ncols": key_columns(figure, 7)}
    figure.legend(handles=handles, loc="outside lower center", **key)
    return figure


def _pieces(points: Floats, kept: Any) -> tuple[Floats, Floats]:
    """Coordinates of a curve, broken where points are left out and where it jumps."""
    shown = np.where(kept[:, None], points, np.nan)
    if not len(points):
        return np.zeros(0), np.zeros(0)
    apart = np.linalg.norm(np.diff(points, axis=0), axis=1)
    jumps = np.flatnonzero(apart > CURVE_JUMP * np.ptp(points, axis=0).max(initial=0.0)) + 1
    x, y = np.insert(shown, jumps, np.nan, axis=0).T
    return x, y


@styled()
def share_figure(loops: pd.DataFrame) -> Figure:
    """Share of the strain plane that is unstable over order, a panel for each kind of contacts."""
    kinds = list(loops.contacts.unique())
    figure, (axes,) = new_panels(1, len(kinds), 2.9, 2.9 * len(kinds) + 0.6)
    for ax, contacts in zip(axes, kinds, strict=True):
        own = loops[loops.contacts == contacts]
        for (kappa, colour), closure in product(
            zip(own.kappa.unique(), LINE_COLOURS, strict=False), own.closure.unique()
        ):
            rows = own[(own.kappa == kappa) & (own.closure == closure)]
            style = "o-" if closure == "affine" else "s--"
            label = rf"{closure}, $\kappa$ = {kappa:g}"
            ax.plot(rows.order, rows.unstable_share, style, color=colour, markersize=3, label=label)
        title = SLIDING_WORDS[contacts]
        ax.set(title=title, xlabel="order $n$ (–)", ylabel="unstable share of the strains (–)")
        ax.set_ylim(0, 1)
        ax.xaxis.set_major_locator(MaxNLocator(integer=True))
    figure_key(figure, ncols=key_columns(figure, 4))
    return figure
