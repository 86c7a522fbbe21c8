"""Figure: forces by Yade and by the closed forms, and Yade's error against its step."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from patterns.diamond.strain_lines import Floats
from studies.style import (
    BLACK,
    BLUE,
    GREY,
    LIGHT_GREY,
    LINE_COLOURS,
    TWO_COLUMNS,
    VERMILION,
    axes_or_new,
    new_figure,
    save_figure,
    styled,
)
from studies.yade_diamond.comparison import external_and_contact_forces
from studies.yade_diamond.probes import Probe, exact_states

# Records drawn as markers, one in so many.
THINNED = 5


def draw_figure(
    probes: Sequence[Probe],
    convergence: Sequence[Mapping[str, Any]],
    folder: Path,
    source: Mapping[str, Any],
) -> None:
    """Write the figure `yade_diamond` as PNG and SVG.

    Parameters
    ----------
    probes : sequence of Probe
        To choose from: the one that slides longest, and one that sticks by both increments.
    convergence : sequence of mapping
        From `convergence_rows`.
    folder : Path
        Where.
    source : mapping
        Provenance.
    """
    with styled():
        figure = new_figure(TWO_COLUMNS, 2.7)
        forces, shear, error = figure.subplots(1, 3)
        draw_forces(max(probes, key=lambda probe: int(probe.sliding.sum())), forces)
        draw_increments(twins(probes), shear)
        draw_convergence(convergence, error)
        save_figure(figure, folder, "yade_diamond", source)


def twins(probes: Sequence[Probe]) -> list[Probe]:
    """The sticking path with the largest shear force by radii, and the same by branch.

    Parameters
    ----------
    probes : sequence of Probe
        To choose from.

    Returns
    -------
    list of Probe
        By radii first; empty if no probe is by radii.
    """
    by_radii = [p for p in probes if p.increment == "radii" and np.isinf(p.mu)]
    if not by_radii:
        return []
    first = max(by_radii, key=lambda probe: float(np.abs(probe.T).max()))
    own = (first.alpha0, first.mu, first.confinement, first.angle, first.steps[-1])
    return [p for p in probes if (p.alpha0, p.mu, p.confinement, p.angle, p.steps[-1]) == own][::-1]


@styled()
def draw_forces(probe: Probe, ax: Axes | None = None) -> Axes:
    """Forces over strain on one path: Yade as markers, the closed form as lines.

    Parameters
    ----------
    probe : Probe
        The path.
    ax : Axes, optional
        Where to draw.

    Returns
    -------
    Axes
    """
    ax = axes_or_new(ax)
    exact, strain = exact_states(probe), _strain(probe)
    ours = external_and_contact_forces(probe, exact)
    for (name, values), colour in zip(ours.items(), LINE_COLOURS, strict=False):
        ax.plot(strain, values, color=colour)
        yade = getattr(probe, name)[::THINNED]
        ax.plot(strain[::THINNED], yade, "o", color=colour, markersize=3.0, fillstyle="none")
        ax.annotate(
            f"${name[0]}_{name[1]}$" if len(name) > 1 else f"${name}$",
            (strain[-1], values[-1]),
            xytext=(4, 0),
            textcoords="offset points",
            color=colour,
            va="center",
        )
    onset = strain[np.flatnonzero(probe.sliding)[:1]]
    for position in onset:
        ax.axvline(position, color=LIGHT_GREY, zorder=0)
        ax.annotate(
            "slides",
            (position, 1.0),
            xycoords=("data", "axes fraction"),
            xytext=(2, -2),
            textcoords="offset points",
            va="top",
            color=GREY,
        )
    ax.set(xlabel="strain along the path", ylabel="force over $k_n l_0$", title=_title(probe))
    return ax


@styled()
def draw_increments(probes: Sequence[Probe], ax: Axes | None = None) -> Axes:
    """Shear force on one path by both increments: Yade as markers, closed forms as lines.

    Parameters
    ----------
    probes : sequence of Probe
        The same path by each increment.
    ax : Axes, optional
        Where to draw.

    Returns
    -------
    Axes
    """
    ax = axes_or_new(ax)
    for probe, colour in zip(probes, LINE_COLOURS, strict=False):
        name = {"radii": r"radii, $2r\,d\alpha$", "branch": r"branch, $l\,d\alpha$"}
        ax.plot(_strain(probe), exact_states(probe).T, color=colour, label=name[probe.increment])
        x, y = _strain(probe)[::THINNED], probe.T[::THINNED]
        ax.plot(x, y, "o", color=colour, markersize=3.0, fillstyle="none")
        ax.set(title=_title(probe))
    ax.set(xlabel="strain along the path", ylabel="$T$ over $k_n l_0$")
    ax.plot([], [], "o", color=GREY, markersize=3.0, fillstyle="none", label="Yade")
    ax.legend(loc="best")
    return ax


def _strain(probe: Probe) -> Floats:
    return np.hypot(probe.E1 - probe.E1[0], probe.E2 - probe.E2[0])


def _title(probe: Probe) -> str:
    friction = (
        "no sliding" if np.isinf(probe.mu) else f"$\\varphi$ = {_degrees(np.arctan(probe.mu)):.0f}°"
    )
    return f"$\\alpha_0$ = {_degrees(probe.alpha0):.0f}°, $E_0$ = {probe.confinement:g}, {friction}"


@styled()
def draw_convergence(rows: Sequence[Mapping[str, Any]], ax: Axes | None = None) -> Axes:
    """Yade's error over its number of steps, with the first-order slope.

    Parameters
    ----------
    rows : sequence of mapping
        From `convergence_rows`.
    ax : Axes, optional
        Where to draw.

    Returns
    -------
    Axes
    """
    ax = axes_or_new(ax)
    steps = np.array([row["steps"] for row in rows], dtype=float)
    T, F = (np.array([row[f"error_{name}"] for row in rows]) for name in ("T", "F1"))
    replay = np.array([row["replay_T"] for row in rows])
    ax.loglog(steps, T, "o-", color=BLUE)
    ax.loglog(steps, F, "s-", color=VERMILION)
    ax.loglog(steps, 4.0 * T[0] * steps[0] / steps, ":", color=GREY)
    ax.loglog(steps, np.maximum(replay, np.finfo(float).eps), "^", color=BLACK)
    named = (
        ("slope $-1$", 4.0 * T[1], GREY, 5),
        ("$T$", T[1], BLUE, -11),
        ("$F_1$", F[1], VERMILION, -11),
        ("$T$, Yade's rule replayed", replay[1], BLACK, 6),
    )
    for text, y, colour, shift in named:
        at: Any = {"xytext": (0, shift), "textcoords": "offset points", "ha": "center"}
        ax.annotate(text, (steps[1], y), color=colour, **at)
    ax.set(xlabel="steps of the probe", ylabel="Yade's relative difference", ylim=(1e-16, 1.0))
    return ax


def _degrees(angle: float) -> float:
    return float(np.degrees(angle))
