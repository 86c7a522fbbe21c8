"""Stress of a whole sample: Love and Weber's over all contacts, those with walls included."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from loops import contact_forces, outline_area
from loops.arrays import Floats
from loops.scene import Subject
from loops.shown import Shown
from patterns import Snapshot
from patterns.snapshots.snapshot import snapshot_of
from patterns.snapshots.walls import box_area

# Blocks along either axis, of which one after the other is left out for the errors.
BLOCKS = 4


@dataclass(frozen=True, eq=False, repr=False)
class Stress(Shown):
    """Stress of a sample (force per length, compression positive) and the errors of its invariants.

    Attributes
    ----------
    tensor : (2, 2) array
        `(1/V) sum f (x) d` over all contacts; row = force, column = branch.
    walls : (2, 2) array or None
        Part of the contacts with walls, branch from the wall to the grain's centre.
    volume : float
        Area V that it is taken over (length squared).
    volume_is : str
        Which area that is: 'cell', 'box within the walls' or 'outline of the network'.
    rattlers : int
        Grains without contacts: they are in the area and carry nothing.
    p, q : float
        Mean stress and half the difference of the principal stresses of the symmetric part.
    p_error, q_error, q_over_p_error : float
        Standard errors of the sample: 16 blocks of it are left out one after the other.
    """

    tensor: Floats
    walls: Floats | None
    volume: float
    volume_is: str
    rattlers: int
    p: float
    q: float
    p_error: float
    q_error: float
    q_over_p_error: float

    @property
    def q_over_p(self) -> float:
        """Sine of the mobilised angle of friction."""
        return self.q / self.p if self.p else float("nan")

    @property
    def wall_share(self) -> float:
        """Share of the mean stress that contacts with walls carry."""
        if self.walls is None or not self.walls.any():
            return 0.0
        return float(np.trace(self.walls) / np.trace(self.tensor))

    def facts(self) -> dict[str, object]:
        """Facts that the prompt and a notebook show."""
        s = self.tensor
        return {
            "unit": "force/length",
            "p": f"{self.p:.6g} +- {self.p_error:.2g}",
            "q": f"{self.q:.6g} +- {self.q_error:.2g}",
            "q/p": f"{self.q_over_p:.4g} +- {self.q_over_p_error:.2g}",
            "11": f"{s[0, 0]:.6g}", "22": f"{s[1, 1]:.6g}", "12": f"{s[0, 1]:.6g}",
            "21": f"{s[1, 0]:.6g}", "walls carry": f"{100 * self.wall_share:.3g} % of p",
            "volume": f"{self.volume:.6g} ({self.volume_is})", "rattlers": self.rattlers,
        }  # fmt: skip


def stress(snapshot: Snapshot | Subject) -> Stress:
    """Stress of the whole sample: Love and Weber's mean over all contacts, walls included.

    Parameters
    ----------
    snapshot : Snapshot or Scene
        With forces. The area is that of the cell, of the box within four upright walls, else of
        the polygon around the network, which makes the stress too large by the grains outside it.

    Returns
    -------
    Stress
        Tensor, part of the walls, invariants with their errors, area, rattlers.

    Raises
    ------
    InputError
        For a snapshot without forces.

    Examples
    --------
    >>> from patterns import read_snapshot, sample_path
    >>> found = stress(read_snapshot(sample_path()))
    >>> round(found.p, 1), round(found.q_over_p, 3), found.volume_is
    (308.5, 0.334, 'box within the walls')
    """
    snapshot = snapshot_of(snapshot)
    if not snapshot.has_forces:
        snapshot.mechanics()
    graph, walls = snapshot.graph, snapshot.walls
    box = None
    if walls is not None and graph.cell is None and len(walls.grain):
        box = box_area(graph.x, walls)
    volume, said = outline_area(graph, snapshot.faces), "outline of the network"
    if graph.cell is not None:
        said = "cell"
    elif box is not None:
        volume, said = box, "box within the walls"
    branches, forces = graph.branches, contact_forces(graph)
    place = graph.x[graph.contacts[:, 0]] + 0.5 * branches
    at_walls = None
    if walls is not None and len(walls.grain):
        at_walls = np.asarray(walls.force.T @ walls.branch / volume)
        branches = np.concatenate([branches, walls.branch])
        forces = np.concatenate([forces, walls.force])
        place = np.concatenate([place, graph.x[walls.grain]])
    products = forces[:, :, None] * branches[:, None, :]
    whole = products.sum(axis=0)
    block = _blocks(place, graph.cell)
    parts = np.stack([products[block == k].sum(axis=0) for k in range(BLOCKS**2)])
    # Each sample without one block has the area of the others.
    left = (whole - parts) / (volume * (1.0 - BLOCKS**-2.0))
    mean, half = _invariants(left)
    # By the jackknife.
    with np.errstate(invalid="ignore", divide="ignore"):  # without forces
        apart = [values - values.mean() for values in (mean, half, half / mean)]
    errors = [float(np.sqrt((len(mean) - 1) / len(mean) * np.sum(one**2))) for one in apart]
    p, q = _invariants(whole / volume)
    degree = np.bincount(graph.contacts.ravel(), minlength=graph.grain_count)
    if walls is not None:
        degree += np.bincount(walls.grain, minlength=graph.grain_count)
    rattlers = int(np.count_nonzero(degree == 0))
    return Stress(
        whole / volume, at_walls, float(volume), said, rattlers, float(p), float(q), *errors
    )


def _invariants(tensors: Floats) -> tuple[Floats, Floats]:
    """Mean and half the difference of the principal values of the symmetric parts."""
    half = 0.5 * (tensors[..., 0, 0] - tensors[..., 1, 1])
    shear = 0.5 * (tensors[..., 0, 1] + tensors[..., 1, 0])
    return 0.5 * (tensors[..., 0, 0] + tensors[..., 1, 1]), np.hypot(half, shear)


def _blocks(place: Floats, cell: Floats | None) -> Floats:
    """Number of the block that each place lies in, of the cell or of the box around them."""
    if cell is not None:
        share = np.mod(np.linalg.solve(cell, place.T).T, 1.0)
    else:
        low = place.min(axis=0)
        share = (place - low) / (place.max(axis=0) - low)
    at = np.minimum((BLOCKS * share).astype(np.int64), BLOCKS - 1)
    return np.asarray(BLOCKS * at[:, 0] + at[:, 1])
