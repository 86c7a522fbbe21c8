"""The grain-level tangent of any contact graph: cycle, cycle with chords, packing."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy import sparse

from loops.arrays import Floats, Integers
from loops.contact_state import contact_state
from loops.contact_tangent import ContactTangent, contact_regime, contact_tangent
from loops.graph import GrainGraph, require_one_state
from loops.laws.protocol import ContactLaw


def assemble_tangent(
    graph: GrainGraph, law: ContactLaw, *, spins: bool = False, regime: ArrayLike | None = None
) -> Floats:
    """Dense grain-level tangent `K`: external force rates `F' = K v` that move the grains by `v`.

    Freedoms in the order `x_0, y_0, x_1, y_1, ...`, then the spins `w_0, w_1, ...`
    (counter-clockwise positive) if wanted; the forces in the same order, moments last. Each
    contact adds its block, with dead forces and moments in the current state; `K` is left
    nonsymmetric (Nicot et al. 2016, equation 20, for any graph).

    Parameters
    ----------
    graph : GrainGraph
        Grains and contacts, batch axes `...` allowed.
    law : ContactLaw
        Contact law.
    spins : bool
        Whether the spins are freedoms; otherwise they are blocked.
    regime : (..., C) array of Regime, optional
        Regime of each contact; read from the state by the law if left out.

    Returns
    -------
    (..., 2 G, 2 G) or (..., 3 G, 3 G) array
        The tangent (force per length; moments per angle in the last block).

    See Also
    --------
    assemble_sparse_tangent : the same as a sparse matrix, for packings.

    Examples
    --------
    >>> from loops import GrainGraph, LinearFrictional, assemble_tangent
    >>> pair = GrainGraph(x=[[0, 0], [1, 0]], radii=[0.5, 0.5], contacts=[[0, 1]])
    >>> assemble_tangent(pair, LinearFrictional(kn=1.0, kt=0.5)).tolist()[0]
    [1.0, 0.0, -1.0, 0.0]
    """
    element = _elements(graph, law, spins, regime)
    return assemble_elements(element, graph.contacts, graph.grain_count)


def assemble_sparse_tangent(
    graph: GrainGraph, law: ContactLaw, *, spins: bool = False, regime: ArrayLike | None = None
) -> sparse.csr_array:
    """Grain-level tangent of a packing as a sparse matrix; see `assemble_tangent`.

    Parameters
    ----------
    graph : GrainGraph
        Grains and contacts of one state (no batch axes).
    law : ContactLaw
        Contact law.
    spins : bool
        Whether the spins are freedoms; otherwise they are blocked.
    regime : (C,) array of Regime, optional
        Regime of each contact; read from the state by the law if left out.

    Returns
    -------
    scipy.sparse.csr_array
        (2 G, 2 G) or (3 G, 3 G) tangent.

    Raises
    ------
    InputError
        If the graph carries batch axes.

    Examples
    --------
    >>> from loops import GrainGraph, LinearFrictional, assemble_sparse_tangent
    >>> pair = GrainGraph(x=[[0, 0], [1, 0]], radii=[0.5, 0.5], contacts=[[0, 1]])
    >>> assemble_sparse_tangent(pair, LinearFrictional(kn=1.0, kt=0.5)).shape
    (4, 4)
    """
    require_one_state(graph)
    element = _elements(graph, law, spins, regime)
    freedoms = _freedoms(graph.contacts, graph.grain_count, spins)
    rows, columns = _places(freedoms)
    values = element.ravel()
    size = (3 if spins else 2) * graph.grain_count
    return sparse.coo_array((values, (rows, columns)), shape=(size, size)).tocsr()


def assemble_elements(element: Floats, contacts: Integers, grains: int) -> Floats:
    """Dense tangent (..., 2 G, 2 G) or (..., 3 G, 3 G) from the contacts' element matrices."""
    spins = element.shape[-1] == 6
    size = (3 if spins else 2) * grains
    rows, columns = _places(_freedoms(contacts, grains, spins))
    batch = element.shape[:-3]
    entries = np.arange(len(rows))
    # Summed by place: contacts share grains, and one may join a grain with its own image.
    gather = sparse.csr_array(
        (np.ones(len(rows)), (rows * size + columns, entries)), shape=(size * size, len(rows))
    )
    tangent = gather @ element.reshape(-1, len(rows)).T
    return np.ascontiguousarray(tangent.T).reshape(*batch, size, size)


def translational_elements(k: Floats) -> Floats:
    """(..., C, 4, 4): external force `-f` on grain j, `f` on i, `f' = -k d'`."""
    return np.concatenate(
        [np.concatenate([k, -k], axis=-1), np.concatenate([-k, k], axis=-1)], axis=-2
    )


def _elements(graph: GrainGraph, law: ContactLaw, spins: bool, regime: ArrayLike | None) -> Floats:
    state = contact_state(graph)
    return element_matrices(contact_tangent(state, law, contact_regime(state, law, regime)), spins)


def _freedoms(contacts: Integers, grains: int, spins: bool) -> Integers:
    """(C, 4) or (C, 6) freedoms of each contact's two grains."""
    i, j = contacts.T
    freedoms = np.stack([2 * i, 2 * i + 1, 2 * j, 2 * j + 1], axis=1)
    if spins:
        return np.column_stack([freedoms, 2 * grains + i, 2 * grains + j])
    return freedoms


def _places(freedoms: Integers) -> tuple[Integers, Integers]:
    """Rows and columns of the element matrices' entries, flattened."""
    size = freedoms.shape[1]
    rows = np.repeat(freedoms, size, axis=1).ravel()
    columns = np.tile(freedoms, (1, size)).ravel()
    return rows, columns


def element_matrices(tangent: ContactTangent, spins: bool) -> Floats:
    """(..., C, 4, 4) in the order x_i, y_i, x_j, y_j, or (..., C, 6, 6) with w_i, w_j after."""
    if not spins:
        return translational_elements(tangent.k)
    force = np.stack([tangent.q_i, tangent.q_j], axis=-1)
    moment = np.stack([tangent.p_i, tangent.p_j], axis=-2)
    shape = np.broadcast_shapes(tangent.k.shape[:-2], tangent.c.shape[:-2])
    element = np.zeros((*shape, 6, 6))
    element[..., :4, :4] = translational_elements(tangent.k)
    element[..., :4, 4:] = np.concatenate([force, -force], axis=-2)
    element[..., 4:, :4] = np.concatenate([-moment, moment], axis=-1)
    element[..., 4:, 4:] = tangent.c
    return element
