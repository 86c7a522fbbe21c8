"""One instant of a discrete-element simulation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from loops import GrainGraph, LinearFrictional


@dataclass(frozen=True, eq=False)
class Snapshot:
    """Grains, contacts and law of one instant, walls set aside.

    Attributes
    ----------
    graph : GrainGraph
        Grains and the contacts between them; forces compression positive; the reference is the
        current configuration; periodic if a cell was given.
    law : LinearFrictional
        Stiffness and friction of each contact.
    regime : (C,) array of int8
        `Regime` of each contact; sliding where the file flags it.
    ids : (G,) array of int
        Ids of the grains as the file has them.
    wall_contacts : int
        Number of contacts with walls, which belong to no loop.
    notes : tuple of str
        What was assumed or left out, for the reader of the results.
    """

    graph: GrainGraph
    law: LinearFrictional
    regime: NDArray[np.int8]
    ids: NDArray[np.int64]
    wall_contacts: int
    notes: tuple[str, ...]
