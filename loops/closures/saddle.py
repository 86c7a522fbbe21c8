"""The traction closure of any loop as a saddle system, through its null vectors."""

from __future__ import annotations

import numpy as np

from loops.arrays import Floats
from loops.geometry import boundary_vectors
from loops.null_space import LeastSquares, solve_through_null_space


def saddle_solve(
    tangent: Floats, x0: Floats, volume: Floats, spin: Floats | None = None
) -> tuple[Floats, Floats, LeastSquares]:
    """Traction tangent by `[K, B; B^T, 0] (u, P) = (-K_w w, -V0 H)`.

    Uniform nominal stress loads grain i by `F_i = -P B_i`; the polygon's displacement gradient is
    `H = -(1/V0) sum u_i (x) B_i` (theory note, section 4). Rigid translations, the gear mode and
    rolling mechanisms are null vectors; they are harmless unless they change `P`.

    Parameters
    ----------
    tangent : (..., 2 n, 2 n) or (..., 3 n, 3 n) array
        Grain-level tangent, with spins if they are relaxed or prescribed.
    x0 : (..., n, 2) array
        Reference centres of the ring (length).
    volume : (...) array
        Reference area V0 (length squared).
    spin : (..., 4) array, optional
        Prescribed spin of all grains per component of `H'`; relaxed to zero moment, or blocked if
        `tangent` has no spins, when left out.

    Returns
    -------
    matrix : (..., 4, 4) array
        `A` in the order (11, 12, 21, 22), whether or not it can be trusted.
    condition : (...) array
        Amplification of rounding errors of `K`, relative to the norm of `A`.
    solution : LeastSquares
        Status of the solve, in scaled unknowns.
    """
    grains, size = x0.shape[-2], tangent.shape[-1]
    length = np.sqrt(volume)
    kept = size if spin is None else 2 * grains
    # Scaled unknowns u/l, w and P/k make rows and columns comparable.
    scale = np.ones((*length.shape, size))
    scale[..., : 2 * grains] = length[..., None]
    scaled = scale[..., :, None] * tangent * scale[..., None, :]
    largest = np.abs(scaled).max(axis=(-2, -1))
    stiffness = np.where(largest > 0, largest, 1.0)
    k = scaled / stiffness[..., None, None]
    b = _boundary_matrix(x0 / length[..., None, None], kept)
    system = np.zeros((*k.shape[:-2], kept + 4, kept + 4))
    system[..., :kept, :kept] = k[..., :kept, :kept]
    system[..., :kept, kept:] = b
    system[..., kept:, :kept] = np.swapaxes(b, -1, -2)
    rhs = np.zeros((*k.shape[:-2], kept + 4, 4))
    rhs[..., kept:, :] = -np.eye(4)
    if spin is not None:
        columns = k[..., :kept, kept:].sum(axis=-1)
        rhs[..., :kept, :] = -columns[..., None] * spin[..., None, :]
    stress_rows = np.eye(kept + 4)[kept:]
    found = solve_through_null_space(system, rhs, stress_rows, _translations(grains, kept + 4))
    stress = found.x[..., kept:, :]
    # A soft loop of stiff contacts: the rounding of K weighs more in the smaller A.
    size = np.linalg.norm(stress, axis=(-2, -1))
    with np.errstate(divide="ignore"):
        condition = found.condition * np.maximum(1.0, 1.0 / size)
    # Where every contact is open the operator is zero and exact.
    empty = largest == 0
    stress = np.where(empty[..., None, None], 0.0, stress)
    condition = np.where(empty, 1.0, condition)
    return stress * (stiffness / volume)[..., None, None], condition, found


def _translations(grains: int, size: int) -> Floats:
    """(size, 2) orthonormal rigid translations: null vectors of the system and its transpose."""
    z = np.zeros((size, 2))
    z[0 : 2 * grains : 2, 0] = z[1 : 2 * grains : 2, 1] = grains**-0.5
    return z


def _boundary_matrix(x0: Floats, size: int) -> Floats:
    """(..., size, 4): force on the freedoms per component of P, `B_ib` at (i a, a b)."""
    vectors = boundary_vectors(x0)
    grains = x0.shape[-2]
    matrix = np.zeros((*x0.shape[:-2], size, 4))
    for a in range(2):
        matrix[..., a : 2 * grains : 2, 2 * a : 2 * a + 2] = vectors
    return matrix
