"""Fabric of a sample: anisotropy and direction of contacts and loops, with errors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from loops.arrays import Flags, Floats
from loops.fabric import direction_tensors, edge_tensors, mean_tensor, principal
from loops.scene import Subject
from loops.shown import Shown
from patterns import Snapshot, planar
from studies.snapshot.summary import group_rows


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
        standard error, as if contacts and loops were independent.
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
    sets: list[tuple[str, Floats, Floats | None]] = [("contacts", contacts, None)]
    if snapshot.has_forces:
        strong = strong_contacts(snapshot)
        sets += [("strong contacts", contacts[strong], None)]
        sets += [("weak contacts", contacts[~strong], None)]
        sets += [("contacts by force", contacts, graph.normal_force)]
    sets += [("contacts by length", contacts, length)]
    shapes, area = edge_tensors(branches, faces), faces.area[faces.loops]
    groups = group_rows(faces.order[faces.loops])
    sets += [("loops", shapes, area)]
    sets += [
        (f"loops of order {name}", shapes[rows], area[rows])
        for name, rows in groups.items()
        if name != "all" and len(area[rows])
    ]
    means = [mean_tensor(tensors, weights) for _, tensors, weights in sets]
    tensor = np.stack([mean.mean for mean in means])
    anisotropy, direction = principal(tensor)
    errors = [
        axis_errors(tensors, weights, angle)
        for (_, tensors, weights), angle in zip(sets, direction, strict=True)
    ]
    along, across = np.array(errors).T
    with np.errstate(divide="ignore", invalid="ignore"):
        turned = np.degrees(0.5 * across / anisotropy)
    return Fabric(
        of=np.array([name for name, _, _ in sets]),
        count=np.array([mean.number for mean in means]),
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
