"""Does a path by events give the numbers of another DEM code, and of its stiffness method?

M. R. Kuhn's 49 discs in a square periodic cell (LCPgranular) are compressed along one axis while
the Cauchy stress across it stays. His code OVAL went through it by small explicit steps; here the
path goes from event to event. `--pathologies` looks at the matrix of the contacts at yield, as his
stiffness method does: symmetric, positive definite, a P-matrix, and the number of solutions.

Run it with the folder `kuhn49` of the published systems: `discs.txt` has radius and place of each
disc, `oval.csv` OVAL's stress and extension at nine strains.
"""

from __future__ import annotations

from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from loops import GrainGraph, LinearFrictional, Scene, contact_state, find_faces
from loops.contacts import PackingState
from loops.laws.frictional import ShearIncrement
from stability import Path as FollowedPath
from stability import Stage, follow
from stability.packing import HeldPacking, hold
from stability.packing.pathologies import columns
from studies.examples import run_example, save
from studies.style import BLACK, BLUE, LIGHT_GREY, VERMILION, new_panels, styled

SIDE = 5.718438216717316
DISC_STIFFNESS = 1.0
FRICTION = 0.5
# Strain over which the geometry is kept.
INTERVAL = 5e-6
# Strain between rows: all of OVAL's strains are rows.
ROW = 2.5e-5
END = 1.375e-2
# Up to the first strain, differences stay below these shares; up to the second, below those.
BOUNDS = {1.9e-3: (1e-5, 1e-4), END: (3e-4, 5e-4)}
# Gap over the diameter at which two discs touch: a grain that carries nothing rests at others.
TOUCH = 1e-12
ANSWERS = {"symmetric": "symmetric", "definite": "positive definite", "p_matrix": "P-matrix"}


def discs_in_cell(folder: Path, shear_increment: ShearIncrement = "branch") -> Scene:
    """Return the discs in their cell: all overlapping pairs are contacts, without shear forces."""
    radii, *places = np.loadtxt(folder / "discs.txt").T
    x = np.column_stack(places)
    found = []
    for image in product((-1, 0, 1), repeat=2):
        apart = x + SIDE * np.array(image) - x[:, None]
        i, j = np.nonzero(np.hypot(*apart.T).T < radii[:, None] + radii)
        found += [(a, b, *image) for a, b in zip(i, j, strict=True) if a < b]
    contacts, images = np.split(np.array(found), 2, axis=1)
    graph = GrainGraph(x=x, radii=radii, contacts=contacts, images=images, cell=SIDE * np.eye(2))
    law = LinearFrictional(DISC_STIFFNESS, DISC_STIFFNESS, FRICTION, shear_increment)
    N = law.normal_force(contact_state(graph))
    return Scene(graph.replace(normal_force=N, shear_force=0.0 * N), law)


def compressed(
    held: HeldPacking, to: float = END, interval: float = INTERVAL, pathologies: bool = True
) -> FollowedPath:
    """Return the path from the state at rest, its rows `ROW` apart."""
    stage, rows = Stage("cauchy_drained", "H11", to), round(to / ROW)
    return follow(held, stage, rows=rows, interval=interval, pathologies=pathologies)


def compression_table(path: FollowedPath) -> pd.DataFrame:
    """Return strain, Cauchy stresses, extension across, lost area and the answers of each row."""
    F = np.eye(2) - path.H.reshape(-1, 2, 2)
    sigma = path.P.reshape(-1, 2, 2) @ F.transpose(0, 2, 1) / np.linalg.det(F)[:, None, None]
    table = {
        "strain_11": path.H[:, 0],
        "sigma_11": sigma[:, 0, 0],
        "sigma_22": sigma[:, 1, 1],
        "stress_ratio": sigma[:, 0, 0] / sigma[:, 1, 1],
        "extension_22": -path.H[:, 3],
        "lost_area": 1.0 - np.linalg.det(F),
        "contacts": [int(state.closed.sum()) for state in path.states],
    }
    return pd.DataFrame(table | (columns(path.pathologies) if path.pathologies else {}))


def compared(rows: pd.DataFrame, oval: pd.DataFrame) -> pd.DataFrame:
    """Return OVAL's numbers, ours, and differences over the increment and the extension."""
    at = [int(np.abs(rows.strain_11 - strain).argmin()) for strain in oval.strain_11]
    ours, start = rows.iloc[at].reset_index(drop=True), rows.sigma_11[0]
    table = oval.assign(sigma_11_ours=ours.sigma_11, extension_22_ours=ours.extension_22)
    rise = oval.sigma_11 - start
    table["off_sigma"] = (ours.sigma_11 - oval.sigma_11) / rise
    table["off_extension"] = ours.extension_22 / oval.extension_22 - 1.0
    return table


def within(table: pd.DataFrame) -> bool:
    """Whether all differences stay below the bounds."""
    first = 0.0
    for last, bounds in BOUNDS.items():
        part = table[(table.strain_11 > first) & (table.strain_11 <= last)]
        off = part[["off_sigma", "off_extension"]].abs().max().to_numpy()
        if not (off < bounds).all():
            return False
        first = last
    return True


def structure(state: PackingState) -> dict[str, Any]:
    """Return numbers of contacts and loops, and the share of the contacts' normals along axis 1.

    Contacts are those that carry; `touching` counts pairs of discs that touch, and
    `fabric_11_touching` takes these.
    """
    length = np.linalg.norm(state.branches, axis=1)
    touching = length < (1.0 + TOUCH) * state.radii[state.contacts].sum(axis=1)
    along, graph = (state.branches[:, 0] / length) ** 2, state.graph()
    return {
        "contacts": graph.contact_count,
        "loops": len(find_faces(graph).loops),
        "fabric_11": float(along[state.closed].mean()),
        "touching": int(touching.sum()),
        "fabric_11_touching": float(along[touching].mean()),
    }


def compression_events(path: FollowedPath) -> pd.DataFrame:
    """Return kind, strain and grains of each event, with the answers at the row behind it."""
    table = []
    answers = pd.DataFrame(columns(path.pathologies))
    for number, event in enumerate(path.events):
        row = min(int(np.searchsorted(path.parameter, event.parameter)), len(path) - 1)
        contact = event.contacts[0]
        pair = path.states[-1].contacts[contact].tolist()
        told = {"event": number, "kind": event.kind, "strain_11": event.parameter}
        table.append(told | {"grain_1": pair[0], "grain_2": pair[1], **answers.iloc[row]})
    return pd.DataFrame(table)


@styled()
def draw(rows: pd.DataFrame, table: pd.DataFrame, events: pd.DataFrame) -> Figure:
    """Draw stress ratio, lost area, differences, candidates and answers over the strain."""
    heights = {"height_ratios": [3, 3, 2.4, 2, 1.8]}
    figure, panels = new_panels(5, 1, 7.6, sharex=True, gridspec_kw=heights)
    ratio, area, off, count, strip = panels[:, 0]
    strain, theirs = 100 * rows.strain_11, 100 * table.strain_11
    for axes, name, points in (
        (ratio, "stress_ratio", table.sigma_11 / rows.sigma_22[0]),
        (area, "lost_area", 1 - (1 - table.strain_11) * (1 + table.extension_22)),
    ):
        factor = 100 if axes is area else 1
        axes.plot(strain, factor * rows[name], color=BLUE, label="by events")
        axes.plot(theirs, factor * points, "o", color=VERMILION, mfc="none", label="OVAL")
    ratio.set_ylabel(r"$\sigma_{11}/\sigma_{22}$ (–)")
    ratio.legend(loc="upper left")
    area.set_ylabel("lost area (%)")
    low, high = ratio.get_ylim()
    ratio.vlines(100 * events.strain_11, low, low + 0.06 * (high - low), color=BLACK, linewidth=0.4)
    ratio.set_ylim(low, high)
    first = 0.0
    for last, bounds in BOUNDS.items():
        for bound, colour in zip(bounds, (BLUE, VERMILION), strict=True):
            ends, at = [100 * first, 100 * last], [bound, bound]
            off.plot(ends, at, color=colour, linewidth=0.8, dashes=(4, 2))
        first = last
    off.semilogy(theirs, table.off_sigma.abs(), "s", color=BLUE, label="of the increment of stress")
    off.semilogy(theirs, table.off_extension.abs(), "^", color=VERMILION, label="of the extension")
    off.set_ylabel("difference (–)")
    off.legend(loc="lower right")
    count.step(strain, rows.candidates, where="post", color=BLACK)
    count.set_ylabel("contacts\nat yield")
    _strip(strip, rows)
    strip.set_xlabel(r"strain $E_{11}$ (%)")
    return figure


def _strip(axes: Axes, rows: pd.DataFrame) -> None:
    """Draw the answers of the rows as bars: yes blue, no vermilion, not decided grey."""
    edges = 100 * np.append(rows.strain_11 - 0.5 * ROW, rows.strain_11.iloc[-1] + 0.5 * ROW)
    single = (rows.solutions == 1).astype(float).where(rows.solutions >= 0)
    works = (rows.path_w2 > 0).astype(float)
    bars = [rows[name].to_numpy() for name in ANSWERS] + [single.to_numpy(), works.to_numpy()]
    for k, values in enumerate(bars):
        for answer, colour in ((1.0, BLUE), (0.0, VERMILION), (np.nan, LIGHT_GREY)):
            rows_of = np.isnan(values) if np.isnan(answer) else values == answer
            label = {1.0: "yes", 0.0: "no"}.get(answer) if k == 0 else None
            spans = [(edges[r], edges[r + 1] - edges[r]) for r in np.flatnonzero(rows_of)]
            axes.broken_barh(spans, (-k - 0.7, 0.7), color=colour, linewidth=0.0, label=label)
    names = [*ANSWERS.values(), "one solution", "$W_2 > 0$"]
    axes.set_yticks([-k - 0.35 for k in range(len(bars))], names)
    axes.tick_params(axis="y", length=0)
    axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))


def main(out: Path, folder: Path) -> dict[str, Any]:
    """Follow the discs, compare, and write tables, numbers and the figure."""
    scene, oval = discs_in_cell(folder), pd.read_csv(folder / "oval.csv")
    held = hold(scene)
    path = compressed(held)
    rows, events = compression_table(path), compression_events(path)
    table = compared(rows, oval)
    radii = compressed(hold(discs_in_cell(folder, "radii")), 4e-4, pathologies=False)
    other = compared(compression_table(radii), oval[oval.strain_11 <= 4e-4])
    numbers = {
        "start": structure(path.states[0]),
        "stress_before": held.stress_before.ravel().tolist(),
        "stress_held": held.stress.ravel().tolist(),
        "sliders": [event.parameter for event in path.of_kind("yield")[:2]],
        "events": len(path.events),
        "rows_not_definite": rows.strain_11[rows.definite == 0].tolist(),
        "rows_negative_w2": rows.strain_11[rows.path_w2 < 0].tolist(),
        "instabilities": len(path.of_kind("instability")),
        "intervals": path.intervals,
        "within": within(table),
        "within_radii": within(other),
        "off_radii": other[["off_sigma", "off_extension"]].abs().max().tolist(),
        "at_0.009": structure(path.states[round(9e-3 / ROW)]),
    }
    more = {"kuhn_discs_oval": table, "kuhn_discs_events": events}
    return save(out, "kuhn_discs", draw(rows, table, events), numbers, rows, **more)


if __name__ == "__main__":
    run_example(main, "KUHN49_FOLDER")
