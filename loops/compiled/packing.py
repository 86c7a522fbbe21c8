"""A packing and its loops as the kernels want them."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from loops.compiled.kernel import given
from loops.contact_state import ContactState
from loops.contact_tangent import local_blocks
from loops.faces import Faces
from loops.graph import GrainGraph, branches_between
from loops.laws.protocol import ContactLaw, Regimes

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

BLOCK = 2**14  # contacts at a time: what is computed of them stays in the cache


class CompiledPacking(NamedTuple):
    """Arrays shared by the kernels, contiguous and read-only.

    Attributes
    ----------
    rows : (C, 8) array
        Contacts: branch vector, tangent block in the frame (n, t) row by row, N and T; the block
        is zero without a law.
    x : (G, 2) array
        Centres.
    regime : (C,) array of int8
        Regime of the contacts, zero without a law.
    offsets, grains, contacts, forward : arrays
        As in `Faces`.
    """

    rows: Floats
    x: Floats
    regime: Regimes
    offsets: Integers
    grains: Integers
    contacts: Integers
    forward: NDArray[np.bool_]


def compiled_packing(
    graph: GrainGraph,
    faces: Faces,
    law: ContactLaw | None = None,
    regime: Regimes | None = None,
    threads: int = 1,
) -> CompiledPacking:
    """Prepare a packing for the kernels.

    Parameters
    ----------
    graph : GrainGraph
        The packing, one state; the reference is the current configuration.
    faces : Faces
        Its faces.
    law : ContactLaw, optional
        Its law; without one only the shapes of the loops can be had.
    regime : (C,) array of Regime, optional
        Regime of each contact; read from the state by the law if left out.
    threads : int
        Threads that share the contacts.

    Returns
    -------
    CompiledPacking
        The arrays.
    """
    count = graph.contact_count
    regime = graph.regime if regime is None else regime
    rows, regimes = np.zeros((count, 8)), np.zeros(count, dtype=np.int8)

    def fill(start: int) -> None:
        part = slice(start, min(start + BLOCK, count))
        images = None if graph.images is None else graph.images[part]
        d = branches_between(graph.x, graph.contacts[part], images, graph.cell)
        rows[part, :2] = d
        if law is None:
            return
        state, own = _state(graph, part, d), law.take(np.arange(part.start, part.stop))
        regimes[part] = own.regime(state) if regime is None else regime[part]
        rows[part, 2:6] = local_blocks(state, own, regimes[part]).reshape(-1, 4)
        rows[part, 6], rows[part, 7] = state.normal_force, state.shear_force

    with ThreadPoolExecutor(threads) as pool:
        for _ in pool.map(fill, range(0, count, BLOCK)):
            pass
    return CompiledPacking(
        rows=given(rows, np.float64),
        x=given(graph.x, np.float64),
        regime=given(regimes, np.int8),
        offsets=given(faces.offsets, np.int64),
        grains=given(faces.grains, np.int64),
        contacts=given(faces.contacts, np.int64),
        forward=given(faces.forward, np.bool_),
    )


def _state(graph: GrainGraph, part: slice, d: Floats) -> ContactState:
    i, j = graph.contacts[part].T
    length = np.hypot(d[:, 0], d[:, 1])
    n = d / length[:, None]
    return ContactState(
        length=length,
        n=n,
        t=np.column_stack([-n[:, 1], n[:, 0]]),
        normal_force=graph.normal_force[part],
        shear_force=graph.shear_force[part],
        radii_i=graph.radii[i],
        radii_j=graph.radii[j],
    )
