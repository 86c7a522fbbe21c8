"""Figure of the bifurcation domain in the plane of stresses."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from patterns.diamond import critical_strain, isotropic_stress
from patterns.diamond.strain_lines import line_states
from studies.domain.losses import Case, first_losses, rows_of
from studies.style import (
    BLACK,
    LIGHT_GREY,
    LINE_COLOURS,
    ONE_COLUMN,
    TWO_COLUMNS,
    axes_or_new,
    key_columns,
    new_panels,
    styled,
)

DRAWN_PROGRAMMES = 31


@styled()
def domain_figure(table: pd.DataFrame, cases: Sequence[Case]) -> Figure:
    """The domains, a column for each reference angle; below, near a single diamond's curves."""
    angles = list(dict.fromkeys(case.alpha0 for case in cases))
    rows, columns = 2 if len(angles) == len(cases) else 1, len(angles)
    width = ONE_COLUMN * 1.2 if columns == 1 else max(TWO_COLUMNS, 2.4 * columns)
    figure, panels = new_panels(rows, columns, 0.8 + 2.4 * rows, width)
    for angle, (whole, *near) in zip(angles, panels.T, strict=True):
        own = [case for case in cases if case.alpha0 == angle]
        if near:
            draw_programmes(own[0], whole)
            ax = draw_domain(table, own, near[0], _colours(cases))
            # Limits around the curves of sticking contacts.
            losses = pd.concat([rows_of(table, case) for case in own])
            sticking = losses[losses.contacts == "sticking"]
            for values, limit in ((sticking.s1, ax.set_xlim), (sticking.s2, ax.set_ylim)):
                margin = 0.1 * (values.max() - values.min())
                limit(values.min() - margin, values.max() + margin)
        draw_domain(table, own, whole, _colours(cases))
        phi = (
            rf"$\varphi$ = {np.degrees(own[0].phi):g}°" if np.isfinite(own[0].mu) else "no sliding"
        )
        whole.set_title(rf"$\alpha_0$ = {np.degrees(angle):g}°, {phi}")
    handles = _legend(cases, drawn_programmes=rows == 2)
    beside = key_columns(figure, 2 if columns == 1 else 4)
    figure.legend(handles=handles, loc="outside lower center", ncols=beside)
    return figure


def _colours(cases: Sequence[Case]) -> dict[float, str]:
    """Colour of each stiffness ratio."""
    ratios = dict.fromkeys(case.kappa for case in cases)
    return {kappa: LINE_COLOURS[k % len(LINE_COLOURS)] for k, kappa in enumerate(ratios)}


def _legend(cases: Sequence[Case], *, drawn_programmes: bool) -> list[Artist]:
    handles: list[Artist] = [
        Line2D([], [], color=BLACK, label=r"$\det K_s = 0$, sticking"),
        Line2D([], [], color=BLACK, linestyle="--", label=r"$\det K = 0$, sticking"),
    ]
    if any(np.isfinite(case.mu) for case in cases):
        handles += [
            Line2D([], [], color=BLACK, linestyle=":", label="yield: both lost by sliding"),
            Patch(facecolor=BLACK, alpha=0.15, label="stable with friction"),
        ]
    if drawn_programmes:
        handles.append(Line2D([], [], color=LIGHT_GREY, label="programmes, sticking"))
    for kappa, colour in _colours(cases).items():
        label = rf"isotropic strain, $\kappa$ = {kappa:g}"
        handles.append(Line2D([], [], color=colour, marker="o", linestyle="", label=label))
    return handles


@styled()
def draw_domain(
    table: pd.DataFrame,
    cases: Sequence[Case],
    ax: Axes | None = None,
    colours: Mapping[float, str] | None = None,
) -> Axes:
    """Domains of diamonds of one reference angle."""
    ax = axes_or_new(ax)
    for case in cases:
        colour = (colours or _colours(cases))[case.kappa]
        own = rows_of(table, case)
        for kind, style in (("det_Ks_zero", "-"), ("det_K_zero", "--")):
            curve = own[(own.contacts == "sticking") & (own.kind == kind)]
            ax.plot(curve.s1, curve.s2, style, color=colour, linewidth=1.0)
        bound = own[(own.contacts == "frictional") & (own.kind == "det_Ks_zero")]
        ax.fill(bound.s1, bound.s2, color=colour, alpha=0.15, linewidth=0.0)
        # The part lost by sliding, up to its neighbours on the elastic side.
        sliding = np.pad((bound.regime == "sliding").to_numpy(), 1)
        near = sliding[:-2] | sliding[1:-1] | sliding[2:]
        yielding = (np.where(near, values, np.nan) for values in (bound.s1, bound.s2))
        ax.plot(*yielding, ":", color=colour, linewidth=1.6)
        s1, s2 = isotropic_stress(critical_strain(case.kappa), case.alpha0)
        ax.plot(float(s1), float(s2), "o", color=colour)
    ax.set(xlabel="$s_1$ over $k_n$ (–)", ylabel="$s_2$ over $k_n$ (–)")
    ax.locator_params(nbins=6)
    return ax


@styled()
def draw_programmes(case: Case, ax: Axes | None = None) -> Axes:
    """Stresses along a few programmes, of contacts that stick, up to the loss of `det Ks`."""
    ax = axes_or_new(ax)
    losses = first_losses(case, DRAWN_PROGRAMMES, friction=False)
    share = np.linspace(0.0, 1.0, 200)[:, None]
    start, end = losses.line.start, losses.det_Ks_zero
    states = line_states(losses.line, start + share * (end - start), case.kappa)
    ax.plot(states.s1, states.s2, color=LIGHT_GREY, linewidth=0.6, zorder=0)
    return ax
