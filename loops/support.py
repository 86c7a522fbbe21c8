"""Supports of a cluster: grains that are held, and motions that are imposed on them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from loops.arrays import Flags, Floats
from loops.errors import InputError, counted, short
from loops.graph import GrainGraph
from loops.shown import Shown
from loops.validation import finite, real, require_shape


@dataclass(frozen=True, eq=False, repr=False)
class Support(Shown):
    """Boundary of a cluster: some freedoms of its grains move as imposed, the others are free.

    A grain has three freedoms: its centre along 1 and 2, and its rotation (radians,
    counter-clockwise positive). A free one is in balance under loads that stay constant: its force
    rate, or moment rate, is zero. `Boundary` is what a packing ends at and takes its mean strain;
    a support takes no strain.

    Parameters
    ----------
    held : (G, 3) or (G,) array_like of bool
        Freedoms that are imposed, in the order centre 1, centre 2, rotation; one flag a grain for
        all three.
    motion : (G, 3) array_like, optional
        Their rates (length and radians per time); zero for all if left out. Free freedoms must
        have zero.

    Raises
    ------
    InputError
        If the shapes do not fit, a rate is not finite, or one is given for a free freedom.

    Examples
    --------
    The lower disc is held, the upper one comes down without turning:

    >>> from loops import Support
    >>> support = Support(held=[True, True], motion=[[0, 0, 0], [0, -1, 0]])
    >>> support.held.all(), support.motion[1].tolist()
    (np.True_, [0.0, -1.0, 0.0])
    """

    held: Flags
    motion: Floats

    def __init__(self, held: ArrayLike, motion: ArrayLike | None = None) -> None:
        given = real("held", held, expected="true or false")
        if not np.isin(given, (0.0, 1.0)).all():
            raise InputError("held", short(held), "true or false", "Give a flag a freedom.")
        flags = given.astype(bool)
        if flags.ndim == 1:
            flags = np.repeat(flags[:, None], 3, axis=1)
        require_shape("held", flags, None, 3)
        imposed = np.zeros(flags.shape) if motion is None else motion
        rates = finite("motion", imposed, *flags.shape).copy()
        wrong = np.argwhere((rates != 0.0) & ~flags)
        if len(wrong):
            g, k = wrong[0].tolist()
            received = f"{rates[g, k]:g} for freedom {k} of grain {g}"
            raise InputError("motion", received, "zero where held is false", "Hold that freedom.")
        object.__setattr__(self, "held", flags)
        object.__setattr__(self, "motion", rates)
        flags.flags.writeable = rates.flags.writeable = False

    def require(self, graph: GrainGraph) -> None:
        """Refuse a graph of another size, or a periodic one."""
        if len(self.held) != graph.grain_count:
            received = counted(len(self.held), "grain")
            expected = f"{graph.grain_count}, as the graph"
            raise InputError("support", received, expected, "Give a row per grain.")
        if graph.cell is not None:
            remedy = "Give a programme for the cell's strain."
            raise InputError("graph", "a periodic cell", "a cluster, for a support", remedy)
