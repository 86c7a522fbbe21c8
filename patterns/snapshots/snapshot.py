"""One snapshot of a discrete-element simulation, and the samples that come with the project."""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from loops import Faces, GrainGraph, InputError, LinearFrictional, find_faces
from loops.shown import Shown
from patterns.snapshots.checks import Finding


@dataclass(frozen=True, eq=False)
class WallContacts:
    """Contacts of grains with walls: they belong to no loop, but carry stress.

    Attributes
    ----------
    grain : (W,) array of int
        Grain of each, an index of the graph.
    force : (W, 2) array
        Force of the wall on the grain (force).
    branch : (W, 2) array
        From the foot on the wall to the centre of the grain (length).
    kn, kt : (W,) array, optional
        Stiffness, if the file has it; `kt` is zero where nothing sticks to the wall.
    """

    grain: NDArray[np.int64]
    force: NDArray[np.float64]
    branch: NDArray[np.float64]
    kn: NDArray[np.float64] | None = None
    kt: NDArray[np.float64] | None = None


@dataclass(frozen=True, eq=False, repr=False)
class Snapshot(Shown):
    """Grains, contacts and law of one snapshot, walls set aside.

    Attributes
    ----------
    graph : GrainGraph
        Grains and the contacts between them; forces compression positive; the reference is the
        current configuration; periodic if there is a cell.
    law : LinearFrictional or None
        Stiffness and friction of each contact; None if the file lacks forces or their shear part:
        then the graph has the normal forces of the file, else zeros, and no shear forces.
    regime : (C,) array of int8 or None
        `Regime` of each contact, sliding where the file flags it; None with the law.
    ids : (G,) array of int
        Ids of the grains as the file has them.
    wall_contacts : int
        Number of contacts with walls, which belong to no loop.
    notes : tuple of str
        Assumptions and omissions, for the reader of the results.
    walls : WallContacts or None
        Forces of the walls, None if the file has none.
    step : float or None
        The code's own number of the snapshot.
    findings : tuple of Finding
        Results of the checks, also where nothing is wrong; doubts are repeated in the notes.
    rotation : (G,) array or None
        Angle that each grain has turned by, up to full turns (rad); None if the file lacks it.
    """

    graph: GrainGraph
    law: LinearFrictional | None
    regime: NDArray[np.int8] | None
    ids: NDArray[np.int64]
    wall_contacts: int
    notes: tuple[str, ...]
    walls: WallContacts | None = None
    step: float | None = None
    findings: tuple[Finding, ...] = ()
    rotation: NDArray[np.float64] | None = None

    @cached_property
    def faces(self) -> Faces:
        """The faces of its graph, as `find_faces` finds them."""
        return find_faces(self.graph)

    def facts(self) -> dict[str, object]:
        """Facts that the prompt and a notebook show."""
        facts = {**self.graph.facts(), "contacts with walls": self.wall_contacts}
        return {**facts, "forces": "known" if self.mechanical else "none", "notes": len(self.notes)}

    @property
    def mechanical(self) -> bool:
        """Whether there are forces and a law; else only the geometry is known."""
        return self.law is not None

    def mechanics(self) -> tuple[LinearFrictional, NDArray[np.int8]]:
        """Law and regime of the contacts; `InputError` for a snapshot without forces."""
        if self.law is None or self.regime is None:
            raise InputError(
                "snapshot", "no forces", "forces and a law", "Export the contact forces."
            )
        return self.law, self.regime


SAMPLE = Path(__file__).parent / "sample"


def sample_path(name: str = "grains_biaxial.csv.gz") -> Path:
    """Path of a sample file: `grains_biaxial.csv.gz` or `grains_periodic.parquet`.

    Parameters
    ----------
    name : str
        File name in the sample folder.

    Returns
    -------
    Path
        Where it is installed.

    Examples
    --------
    >>> from patterns import sample_path
    >>> sample_path().name
    'grains_biaxial.csv.gz'
    """
    return SAMPLE / name


def sample_cell() -> NDArray[np.float64]:
    """Periodic cell of `grains_periodic.parquet`, columns are the cell vectors (m).

    Returns
    -------
    (2, 2) array
        Cell vectors.
    """
    return np.array(json.loads((SAMPLE / "macro.json").read_text())["cell"])
