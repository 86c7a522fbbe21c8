"""Stress of a whole sample, and its fabric: anisotropy and direction, with errors."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from loops import InputError, contact_forces
from loops.arrays import Flags, Floats
from loops.fabric import direction_tensors, edge_tensors, mean_tensor, principal
from loops.scene import Subject
from loops.shown import Shown
from patterns import Snapshot, planar
from patterns.snapshots.snapshot import snapshot_of
from studies.snapshot.table import group_rows

if TYPE_CHECKING:
    import pandas as pd

# Blocks along either axis, of which one after the other is left out for the errors.
BLOCKS = 4


@dataclass(frozen=True, eq=False, repr=False)
class Fabric(Shown):
    """Anisotropy and direction of the contacts and loops of a sample.

    Attributes
    ----------
    of : (n,) array of str
        'contacts'; 'strong contacts' and 'weak contacts' (N above and below the mean); 'contacts by
        force' (weighted by N) and 'by length'; 'loops' (by their edges, weighted by area) and loops
        'of order' 3 to '8+'.
    count : (n,) array of int
        Contacts or loops.
    tensor : (n, 2, 2) array
        Mean of `n (x) n` over the contacts, of `sum e (x) e / sum |e|^2` over the loops.
    anisotropy, anisotropy_error : (n,) array
        Difference of the principal values, half the amplitude of the density of directions, and its
        standard error, as if contacts and loops were independent; nan of fewer than two.
    direction, direction_error : (n,) array
        Of the larger principal value, degrees from axis 1 in (-90, 90], and its standard error.
    snapshot : Snapshot
        The sample.
    """

    of: NDArray[np.str_]
    count: NDArray[np.int64]
    tensor: Floats
    anisotropy: Floats
    anisotropy_error: Floats
    direction: Floats
    direction_error: Floats
    snapshot: Snapshot

    def facts(self) -> dict[str, object]:
        """Facts that the prompt and a notebook show."""
        return {
            name: f"{a:.3f} +- {error:.3f} at {angle:.1f}° ({count})"
            for name, a, error, angle, count in zip(
                self.of, self.anisotropy, self.anisotropy_error, self.direction, self.count,
                strict=True,
            )
        }  # fmt: skip

    def columns(self) -> pd.DataFrame:
        """One row a set of contacts or loops."""
        t = self.tensor
        import pandas as pd

        return pd.DataFrame(
            {
                "of": self.of, "count": self.count, "F11": t[:, 0, 0], "F12": t[:, 0, 1],
                "F22": t[:, 1, 1], "anisotropy": self.anisotropy,
                "anisotropy_error": self.anisotropy_error, "direction_deg": self.direction,
                "direction_error_deg": self.direction_error,
            }
        )  # fmt: skip


def fabric(snapshot: Snapshot | Subject) -> Fabric:
    """Anisotropy and direction of contacts and loops, by force and by order, with errors.

    Parameters
    ----------
    snapshot : Snapshot or Scene
        Without forces contacts are not told apart by them.

    Returns
    -------
    Fabric
        `.table()` has a row for each set, `.plot()` draws the directions of the contacts.

    Raises
    ------
    InputError
        If branches cross.

    Examples
    --------
    >>> from patterns import read_snapshot, sample_path
    >>> found = fabric(read_snapshot(sample_path()))
    >>> [(str(name), round(float(a), 3)) for name, a in zip(found.of[:3], found.anisotropy)]
    [('contacts', 0.093), ('strong contacts', 0.334), ('weak contacts', 0.086)]
    """
    snapshot = planar(snapshot)
    graph, faces = snapshot.graph, snapshot.faces
    branches = graph.branches
    contacts, length = direction_tensors(branches), np.hypot(*branches.T)
    sets: dict[str, tuple[Floats, Floats | None]] = {"contacts": (contacts, None)}
    if snapshot.has_forces:
        strong = strong_contacts(snapshot)
        sets["strong contacts"] = contacts[strong], None
        sets["weak contacts"] = contacts[~strong], None
        sets["contacts by force"] = contacts, graph.normal_force
    sets["contacts by length"] = contacts, length
    shapes, area = edge_tensors(branches, faces), faces.area[faces.loops]
    groups = group_rows(faces.order[faces.loops])
    sets["loops"] = shapes[groups.pop("all")], area
    sets |= {
        f"loops of order {name}": (shapes[rows], area[rows])
        for name, rows in groups.items()
        if len(area[rows])
    }
    means = [mean_tensor(*one) for one in sets.values()]
    tensor = np.stack([mean.mean for mean in means])
    anisotropy, direction = principal(tensor)
    errors = [axis_errors(*one, angle) for one, angle in zip(sets.values(), direction, strict=True)]
    count = np.array([mean.number for mean in means])
    along, across = np.where(count > 1, np.array(errors).T, np.nan)
    with np.errstate(divide="ignore", invalid="ignore"):
        turned = np.degrees(0.5 * across / anisotropy)
    return Fabric(
        of=np.array([*sets]),
        count=count,
        tensor=tensor,
        anisotropy=np.asarray(anisotropy),
        anisotropy_error=along,
        direction=np.degrees(direction),
        direction_error=turned,
        snapshot=snapshot,
    )


def strong_contacts(snapshot: Snapshot) -> Flags:
    """Flags of the contacts whose normal force is above the mean of those that carry."""
    force = snapshot.graph.normal_force
    return np.asarray(force > force[force != 0].mean())


def axis_errors(tensors: Floats, weights: Floats | None, angle: float) -> tuple[float, float]:
    """Standard errors of a mean tensor's anisotropy, and of its part across the direction."""
    weight = np.ones(len(tensors)) if weights is None else weights
    weight = weight / weight.sum()
    half, shear = tensors[:, 0, 0] - tensors[:, 1, 1], 2.0 * tensors[:, 0, 1]
    cos, sin = np.cos(2.0 * angle), np.sin(2.0 * angle)
    parts = half * cos + shear * sin, shear * cos - half * sin
    along, across = (
        float(np.sqrt(np.sum(weight**2 * (part - weight @ part) ** 2))) for part in parts
    )
    return along, across


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
        Which area that is: 'cell', 'box within the walls', 'outline of the network', 'as given'.
    rattlers : int
        Grains with fewer than two contacts, walls included, removed one after the other: they are
        in the area and carry nothing.
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
        With forces. The area is that of the cell, of the box within four upright walls, that of
        the boundary of a scene if it was given, else of the polygon around the network, which makes
        the stress too large by the grains outside it.

    Returns
    -------
    Stress
        Tensor, part of the walls, invariants with their errors, area, rattlers.

    Raises
    ------
    InputError
        For a snapshot without forces, or without an area: no cell, no walls and no loops.

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
    volume, said = snapshot.area
    if not volume > 0:
        expected, remedy = "an area", "Give --cell, or the contacts with the walls."
        raise InputError("stress", "no cell, no box of walls and no loops", expected, remedy)
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
    found = whole / volume, at_walls, float(volume), said
    return Stress(*found, snapshot.rattlers, float(p), float(q), *errors)


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
        share = (place - place.min(axis=0)) / np.ptp(place, axis=0)
    at = np.minimum((BLOCKS * share).astype(np.int64), BLOCKS - 1)
    return np.asarray(BLOCKS * at[:, 0] + at[:, 1])
