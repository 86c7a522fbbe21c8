"""Does a path by events give the numbers of another DEM code, and of its stiffness method?

M. R. Kuhn's 49 discs in a square periodic cell (LCPgranular) are compressed along one axis while
the Cauchy stress across it stays. His code OVAL went through it by small explicit steps; here the
path goes from event to event. `--pathologies` looks at the matrix of the contacts at yield, as his
stiffness method does: symmetric, positive definite, a P-matrix, and the number of solutions.

Run it with the folder `kuhn49` of the published systems: `discs.txt` has radius and place of each
disc, `oval.csv` OVAL's stress and extension at nine strains.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure

from loops import GrainGraph, LinearFrictional, Scene, contact_state, find_faces
from loops.contacts import Contacts
from loops.laws.frictional import ShearIncrement
from loops.neighbours import near_pairs
from stability import Path as FollowedPath
from stability import Stage, follow
from stability.packing import HeldPacking, hold
from stability.packing.path import columns
from studies.evolve import event_table
from studies.examples import run_example, save
from studies.frames import path_table
from studies.style import BLACK, BLUE, LIGHT_GREY, VERMILION, edge_ticks, new_panels, styled

SIDE = 5.718438216717316
KN, FRICTION = 1.0, 0.5
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
    x, cell = np.column_stack(places), SIDE * np.eye(2)
    contacts, images = near_pairs(x, cell, radii, 0.0)
    graph = GrainGraph(x=x, radii=radii, contacts=contacts, images=images, cell=cell)
    law = LinearFrictional(KN, KN, FRICTION, shear_increment)
    N = law.normal_force(contact_state(graph))
    return Scene(graph.replace(normal_force=N, shear_force=0.0 * N), law)


def compressed(
    held: HeldPacking, to: float = END, interval: float = INTERVAL, pathologies: bool = True
) -> FollowedPath:
    """Return the path from the state at rest, its rows `ROW` apart."""
    stage, rows = Stage("cauchy_drained", "H11", to), round(to / ROW)
    return follow(held, stage, rows=rows, interval=interval, pathologies=pathologies)


def compression_table(path: FollowedPath) -> pd.DataFrame:
    """Return the rows of a path with Cauchy stresses and the extension across."""
    F = np.eye(2) - path.H.reshape(-1, 2, 2)
    sigma = path.P.reshape(-1, 2, 2) @ F.transpose(0, 2, 1) / np.linalg.det(F)[:, None, None]
    table = path_table(path).rename(columns={"H11": "strain_11"})
    sigma_11, sigma_22 = sigma[:, 0, 0], sigma[:, 1, 1]
    return table.assign(sigma_11=sigma_11, sigma_22=sigma_22, extension_22=-table.H22)


def compared(rows: pd.DataFrame, oval: pd.DataFrame) -> pd.DataFrame:
    """Return OVAL's numbers, ours, and differences over the increment and the extension."""
    at = [int(np.abs(rows.strain_11 - strain).argmin()) for strain in oval.strain_11]
    ours = rows.iloc[at].reset_index(drop=True)
    table = oval.assign(sigma_11_ours=ours.sigma_11, extension_22_ours=ours.extension_22)
    table["off_sigma"] = (ours.sigma_11 - oval.sigma_11) / (oval.sigma_11 - rows.sigma_11[0])
    table["off_extension"] = ours.extension_22 / oval.extension_22 - 1.0
    return table


def within(table: pd.DataFrame) -> bool:
    """Whether all differences stay below the bounds."""
    early = (table.strain_11 <= min(BOUNDS)).to_numpy()[:, None]
    bounds = np.where(early, BOUNDS[min(BOUNDS)], BOUNDS[END])
    return bool((table[["off_sigma", "off_extension"]].abs().to_numpy() < bounds).all())


def structure(state: Contacts) -> dict[str, Any]:
    """Return numbers of contacts and loops, and the share of the contacts' normals along axis 1.

    Contacts are those that carry; `touching` counts pairs of discs that touch, and
    `fabric_11_touching` takes these.
    """
    touching = state.length < (1.0 + TOUCH) * state.radii[state.contacts].sum(axis=1)
    along, graph = (state.branches[:, 0] / state.length) ** 2, state.graph()
    return {
        "contacts": graph.contact_count,
        "loops": len(find_faces(graph).loops),
        "fabric_11": float(along[state.closed].mean()),
        "touching": int(touching.sum()),
        "fabric_11_touching": float(along[touching].mean()),
    }


def compression_events(path: FollowedPath) -> pd.DataFrame:
    """Return kind, strain and grains of each event, with the answers at the row behind it."""
    names = {"driven": "strain_11", "id1": "grain_1", "id2": "grain_2"}
    table = event_table(path, np.arange(len(path.states[0].x)))[["kind", *names]]
    rows = np.searchsorted(path.parameter, table.driven).clip(max=len(path) - 1)
    answers = pd.DataFrame(columns(path.pathologies)).iloc[rows].reset_index(drop=True)
    return table.rename(columns=names).rename_axis("event").reset_index().join(answers)


@styled()
def draw(rows: pd.DataFrame, table: pd.DataFrame, events: pd.DataFrame) -> Figure:
    """Draw stress ratio, differences, contacts at yield and answers over the strain."""
    figure, ((ratio,), (off,), (count,), (strip,)) = new_panels(4, 1, 6.2, sharex=True)
    strain, theirs = 100 * rows.strain_11, 100 * table.strain_11
    ratio.plot(strain, rows.sigma_11 / rows.sigma_22, color=BLUE, label="by events")
    ratio.plot(theirs, table.sigma_11 / rows.sigma_22[0], "o", color=VERMILION, label="OVAL")
    ratio.set_ylabel(r"$\sigma_{11}/\sigma_{22}$ (–)")
    ratio.legend()
    edge_ticks(ratio, 100 * events.strain_11.to_numpy())
    off.semilogy(theirs, table.off_sigma.abs(), "s", label="of the rise of the stress")
    off.semilogy(theirs, table.off_extension.abs(), "^", label="of the extension")
    off.set_ylabel("difference (–)")
    off.legend()
    count.step(strain, rows.candidates, where="post", color=BLACK)
    count.set_ylabel("contacts\nat yield")
    single = (rows.solutions == 1).astype(float).where(rows.solutions >= 0)
    answers = rows[list(ANSWERS)].assign(single=single, works=(rows.path_w2 > 0).astype(float))
    colours = ListedColormap([VERMILION, BLUE]).with_extremes(bad=LIGHT_GREY)
    strip.pcolormesh(strain, range(5), answers.T, cmap=colours, vmin=0, vmax=1, shading="nearest")
    strip.set_yticks(range(5), [*ANSWERS.values(), "one solution", "$W_2 > 0$"])
    strip.set(xlabel="strain $E_{11}$ (%); blue: yes, vermilion: no", ylim=(4.5, -0.5))
    return figure


def main(out: Path, folder: Path) -> dict[str, Any]:
    """Follow the discs, compare, and write tables, numbers and the figure."""
    scene, oval = discs_in_cell(folder), pd.read_csv(folder / "oval.csv")
    held = hold(scene)
    path = compressed(held)
    rows, events = compression_table(path), compression_events(path)
    table = compared(rows, oval)
    along_radii = compressed(hold(discs_in_cell(folder, "radii")), 4e-4, pathologies=False)
    radii = compared(compression_table(along_radii), oval[oval.strain_11 <= 4e-4])
    numbers = {
        "start": structure(path.states[0]),
        "stress_before": held.stress_before.ravel().tolist(),
        "stress_held": held.stress.ravel().tolist(),
        "sliders": [event.parameter for event in path.of_kind("yield")[:2]],
        "events": len(path.events),
        "instabilities": len(path.of_kind("instability")),
        "intervals": path.intervals,
        "within": within(table),
        "within_radii": within(radii),
        "off_radii": radii[["off_sigma", "off_extension"]].abs().max().tolist(),
        "at_0.009": structure(path.states[round(9e-3 / ROW)]),
    }
    more = {"kuhn_discs_oval": table, "kuhn_discs_events": events}
    return save(out, "kuhn_discs", draw(rows, table, events), numbers, rows, **more)


if __name__ == "__main__":
    run_example(main, "KUHN49_FOLDER")
