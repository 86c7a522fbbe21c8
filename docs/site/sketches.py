"""The drawings of the theory's pages, written to docs/figures: `python docs/site/sketches.py`."""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

BLUE, RED, GREY = "#0072B2", "#D55E00", "0.55"
FIGURES = Path(__file__).parents[1] / "figures"


def sketch(x, y):
    """An empty figure over these two ranges, 1.3 inches a unit."""
    ax = Figure(figsize=(1.3 * (x[1] - x[0]), 1.3 * (y[1] - y[0]))).add_axes((0, 0, 1, 1))
    ax.set(xlim=x, ylim=y)
    ax.set_axis_off()
    return ax


def disc(ax, x, r=0.5):
    """A grain with its centre."""
    turn = np.linspace(0.0, 2.0 * np.pi, 181)
    ax.plot(x[0] + r * np.cos(turn), x[1] + r * np.sin(turn), color=GREY, lw=1.2)
    ax.plot(*x, "o", color="black", ms=3)


def arrow(ax, start, vector, label="", colour="black", place=(0.0, 0.0), style="-|>"):
    """A vector with its label at its end, moved by `place`."""
    start, end = np.asarray(start), np.asarray(start) + vector
    line = {"arrowstyle": style, "color": colour, "lw": 1.4, "shrinkA": 0, "shrinkB": 0}
    ax.annotate("", end, start, arrowprops=line)
    ax.text(*(end + np.asarray(place)), label, color=colour, ha="center", va="center", fontsize=12)


def contact():
    """Two grains: branch, frame, lever arms, and the force of i on j."""
    ax, angle = sketch((-0.65, 2.0), (-0.65, 1.2)), 0.35
    n = np.array([np.cos(angle), np.sin(angle)])
    t = np.array([-n[1], n[0]])
    xi, xj = np.zeros(2), 1.16 * n
    disc(ax, xi, 0.55)
    disc(ax, xj, 0.7)
    ax.plot(*np.stack([xi, xj]).T, color="black", lw=1)
    ax.text(-0.1, -0.1, "$i$", fontsize=12)
    ax.text(xj[0] + 0.06, xj[1] - 0.12, "$j$", fontsize=12)
    middle = 0.505 * n
    ax.plot(*middle, "s", color="black", ms=3)
    for start, end, name in ((xi, middle, "$a_i$"), (middle, xj, "$a_j$")):
        arrow(ax, start - 0.1 * t, end - start, style="<|-|>", colour=GREY)
        ax.text(*((start + end) / 2 - 0.24 * t), name, color=GREY, ha="center", fontsize=12)
    arrow(ax, xj, 0.5 * n, r"$N\,\mathbf{n}$", RED, (0.16, 0.05))
    arrow(ax, xj, 0.35 * t, r"$T\,\mathbf{t}$", RED, (-0.05, 0.1))
    arrow(ax, xi, 0.4 * n, r"$\mathbf{n}$", BLUE, (0.0, 0.13))
    arrow(ax, xi, 0.4 * t, r"$\mathbf{t}$", BLUE, (-0.08, 0.05))
    ax.plot([0, 1.9], [0, 0], ":", color=GREY, lw=1)
    ax.text(1.35, 0.15, r"$\alpha$", fontsize=12)
    return ax.figure


def loop():
    """A pentagon: an edge's outward normal, a boundary vector, a turned midpoint."""
    ax = sketch((-0.8, 2.1), (-1.3, 1.95))
    x = np.array([[0.0, 0.0], [1.0, -0.1], [1.45, 0.75], [0.7, 1.35], [-0.2, 0.9]])
    for corner, name in zip(x, ("$i-1$", "$i$", "$i+1$", "", ""), strict=True):
        disc(ax, corner)
        ax.text(corner[0] - 0.06, corner[1] + 0.1, name, ha="right", fontsize=11)
    ax.plot(*np.vstack([x, x[:1]]).T, color="black", lw=1)
    edges = np.roll(x, -1, axis=0) - x
    normals = np.stack([edges[:, 1], -edges[:, 0]], axis=1)
    for c in (0, 1):
        arrow(ax, x[c] + edges[c] / 2, 0.5 * normals[c], colour=BLUE)
    ax.text(0.35, -0.78, r"$\frac{1}{2}\mathbf{S}(\mathbf{x}_{i}-\mathbf{x}_{i-1})$", color=BLUE,
            ha="center", fontsize=12)  # fmt: skip
    arrow(ax, x[1], 0.5 * (normals[0] + normals[1]), r"$\mathbf{B}_i$", RED, (0.14, -0.02))
    return ax.figure


def diamond():
    """The paper's pattern: diagonals, loads, branch angle."""
    ax, angle = sketch((-1.8, 1.8), (-1.85, 1.85)), np.radians(50.0)
    h, v = np.cos(angle) * 0.96, np.sin(angle) * 0.96
    x = np.array([[h, 0.0], [0.0, v], [-h, 0.0], [0.0, -v]])
    for corner in x:
        disc(ax, corner)
    ax.plot(*np.vstack([x, x[:1]]).T, color="black", lw=1)
    ax.plot([-h, h], [0, 0], ":", color=GREY)
    for sign in (1, -1):
        arrow(ax, (sign * (h + 1.0), 0), (-sign * 0.45, 0), colour=RED)
        arrow(ax, (0, sign * (v + 1.0)), (0, -sign * 0.45), colour=RED)
    ax.text(h + 0.8, 0.1, "$F_1$", color=RED, fontsize=12)
    ax.text(0.08, v + 0.85, "$F_2$", color=RED, fontsize=12)
    ax.text(-h + 0.2, 0.1, r"$\alpha$", fontsize=12)
    ax.text(-h / 2 - 0.12, v / 2 + 0.06, r"$\ell$", fontsize=12)
    for side in (1, -1):
        ax.plot([side * h] * 2, [0, -1.6], ":", color=GREY, lw=0.8)
        ax.plot([0, -1.6], [side * v] * 2, ":", color=GREY, lw=0.8)
    arrow(ax, (-h, -1.55), (2 * h, 0), style="<|-|>", colour=GREY)
    ax.text(0.2, -1.5, "$L_1$", color=GREY, fontsize=12)
    arrow(ax, (-1.5, -v), (0, 2 * v), style="<|-|>", colour=GREY)
    ax.text(-1.45, 0.3, "$L_2$", color=GREY, fontsize=12)
    return ax.figure


if __name__ == "__main__":
    for draw in (contact, loop, diamond):
        path = FIGURES / f"theory-{draw.__name__}.png"
        draw().savefig(path, dpi=150, metadata={"Software": None})
