"""The grain-level tangent of any contact graph: cycle, cycle with chords, packing."""

from __future__ import annotations

from functools import lru_cache
from math import prod

import numpy as np
from numpy.typing import ArrayLike
from scipy import sparse

from loops.arrays import Floats, Integers
from loops.contact_state import contact_state
from loops.contact_tangent import contact_regime, contact_tangent
from loops.graph import GrainGraph, require_one_state
from loops.laws.protocol import ContactLaw

# Motion `r = (d', w_i, w_j)` of a contact from that of its grains, `x_i, y_i, x_j, y_j, w_i, w_j`.
RELATIVE = np.eye(4, 6, 2) - np.eye(4, 6) * [[1.0], [1.0], [0.0], [0.0]]


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
    return assembled(*_contacts(graph, law, spins, regime))


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
    return assembled_sparse(*_contacts(graph, law, spins, regime)).tocsr()


def grain_ends(contacts: Integers, grains: int, spins: bool = True) -> tuple[Integers, int]:
    """(C, 6) freedoms of each contact's grains, `x_i, y_i, x_j, y_j, w_i, w_j`, and their number.

    -1 stands for none.
    """
    i, j = contacts.T
    w_i, w_j = (2 * grains + i, 2 * grains + j) if spins else (np.full_like(i, -1),) * 2
    ends = np.stack([2 * i, 2 * i + 1, 2 * j, 2 * j + 1, w_i, w_j], axis=1)
    return ends, (3 if spins else 2) * grains


def assembled(S: Floats, ends: Integers, size: int, signed: bool = True) -> Floats:
    """`K = D^T S D`, (..., size, size), from contact tangents (..., C, 4, 4), `r = D v`.

    Not `signed`: with `|D|`, for sizes of terms.
    """
    _, gather = _maps(ends.tobytes(), size, signed)
    return _mapped(gather, S.reshape(*S.shape[:-3], -1)).reshape(*S.shape[:-3], size, size)


def assembled_sparse(S: Floats, ends: Integers, size: int) -> sparse.csc_array:
    """The same of one state as a sparse matrix."""
    elements = RELATIVE.T @ S @ RELATIVE
    rows, columns = np.repeat(ends, 6, axis=1), np.tile(ends, (1, 6))
    inside = (rows >= 0) & (columns >= 0)
    values = elements.reshape(len(elements), 36)[inside]
    places = (rows[inside], columns[inside])
    return sparse.coo_array((values, places), shape=(size, size)).tocsc()


def motions(v: Floats, ends: Integers) -> Floats:
    """`r = D v`, (..., C, 4, k), from k motions of the freedoms, (..., size, k)."""
    spread, _ = _maps(ends.tobytes(), v.shape[-2], True)
    r = _mapped(spread.T, np.swapaxes(v, -1, -2))
    return np.swapaxes(r, -1, -2).reshape(*v.shape[:-2], len(ends), 4, v.shape[-1])


def balancing(s: Floats, ends: Integers, size: int, signed: bool = True) -> Floats:
    """`D^T s`, (..., size, k): external forces that k sets `-s` (..., C, 4, k) ask for."""
    spread, _ = _maps(ends.tobytes(), size, signed)
    flat = s.reshape(*s.shape[:-3], 4 * len(ends), s.shape[-1])
    return np.swapaxes(_mapped(spread, np.swapaxes(flat, -1, -2)), -1, -2)


def _mapped(linear: sparse.csr_array, a: Floats) -> Floats:
    """A linear map of the last axis."""
    flat = np.ascontiguousarray(a.reshape(prod(a.shape[:-1]), a.shape[-1]).T)
    return np.ascontiguousarray((linear @ flat).T).reshape(*a.shape[:-1], linear.shape[0])


@lru_cache(maxsize=64)
def _maps(ends: bytes, size: int, signed: bool) -> tuple[sparse.csr_array, sparse.csr_array]:
    """`D^T` as a matrix (size, 4 C), and the map from the entries of all `S` to those of `K`."""
    at = np.frombuffer(ends, dtype=np.int64).reshape(-1, 6)
    relative = RELATIVE.T if signed else np.abs(RELATIVE.T)
    row, column = np.nonzero(relative)
    sign, freedom = relative[row, column], at[:, row]
    inside = freedom >= 0
    place = 4 * np.arange(len(at))[:, None] + column
    values = np.broadcast_to(sign, freedom.shape)[inside]
    spread = (values, (freedom[inside], place[inside]))
    both = inside[:, :, None] & inside[:, None, :]
    entry = size * freedom[:, :, None] + freedom[:, None, :]
    source = 4 * place[:, :, None] + column
    values = np.broadcast_to(np.multiply.outer(sign, sign), both.shape)[both]
    gather = (values, (entry[both], source[both]))
    return (
        sparse.coo_array(spread, shape=(size, 4 * len(at))).tocsr(),
        sparse.coo_array(gather, shape=(size * size, 16 * len(at))).tocsr(),
    )


def _contacts(
    graph: GrainGraph, law: ContactLaw, spins: bool, regime: ArrayLike | None
) -> tuple[Floats, Integers, int]:
    state = contact_state(graph)
    S = contact_tangent(state, law, contact_regime(state, law, regime))
    return S, *grain_ends(graph.contacts, graph.grain_count, spins)
