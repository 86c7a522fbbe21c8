"""The traction closure of a plain ring by its one redundant force, O(n) per loop."""

from __future__ import annotations

import numpy as np

from loops.arrays import Floats, all_finite, frobenius
from loops.geometry import area_growth, from_centroid, outward, polygon_area


def force_method(compliance: Floats, x0: Floats, growth: Floats) -> tuple[Floats, Floats]:
    """Traction tangent (..., 4, 4) of rings with spins blocked, and its condition (...).

    Equilibrium leaves one unknown vector per loop, `f_c = f^ - P m_c` with
    `m_c = R (x0_c + x0_{c+1})/2`; closure of the ring gives the compliance

        C = (1/V0) [sum k^-1_ik m_j m_l - (sum k^-1 m_j)(sum k^-1)^-1(sum k^-1 m_l)]

    and `A = C^-1`, from 2x2 inverses alone; not finite if a block or C is singular.
    Theory, equation (4.11). `compliance` (..., n, 2, 2) and `growth` (..., n) are those of
    `translational_compliances`.

    A change of one compliance changes C by itself times `(m_c - g)^2`, `g` the change of the
    redundant force: the condition is the sum of these sizes over V0, times `|A|`. Counted in
    lengths of either axis's own: the flatness of a loop along an axis costs nothing there, only
    what rounding does to V0.
    """
    centred, volume = from_centroid(x0), np.abs(polygon_area(x0))
    m = outward(x0, 0.5 * (centred + np.roll(centred, -1, axis=-2)))
    scale = np.sqrt((m * m).mean(axis=-2))
    m = m / scale[..., None, :]
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        # single[i, a, j] = sum k^-1_ia m_j, and the ring's own compliance, sum k^-1.
        single = np.einsum("...cik,...cj->...ikj", compliance, m, optimize=True)
        closure = _inverse_2x2(compliance.sum(axis=-3))
        pair = m[..., :, None] * m[..., None, :]
        double = np.einsum("...cik,...cjl->...ijkl", compliance, pair, optimize=True)
        left = np.einsum("...iaj,...ab->...ijb", single, closure)
        right = np.einsum("...ijb,...bkl->...ijkl", left, single)
        c = (double - right).reshape(*compliance.shape[:-3], 4, 4) / volume[..., None, None]
        scaled = _inverse(c)
        size = frobenius(scaled)
        columns = np.concatenate([scale, scale], axis=-1)
        matrix = scaled / (columns[..., :, None] * columns[..., None, :])
        lever = frobenius(closure) * np.sqrt((single * single).sum(axis=(-3, -2, -1)))
        # The midpoints err by their mean distance from the centroid, one in these units.
        reach = np.linalg.norm(m, axis=-1) + lever[..., None] + 1.0
        terms = growth * frobenius(compliance) * reach * reach
        # The error of the scaled operator, in the norm of the operator itself.
        share = size / (scale.min(axis=-1) ** 2 * frobenius(matrix))
        condition = size * terms.sum(axis=-1) / volume * share + area_growth(x0)
    return matrix, np.where(np.isfinite(condition), condition, np.inf)


def ring_equations(compliance: Floats, m: Floats) -> tuple[Floats, Floats]:
    """The same as equations for `(H', P', f^')`, (6, 10), and the motions of the contacts.

    `d' = -k^-1 (f^' - P' m)`, (n, 4, 10) with the spins, which are blocked; `V0 H' = sum d' (x) m`
    and `sum d' = 0`. For one ring, `m` (n, 2) over `sqrt(V0)`.
    """
    motion = np.zeros((len(m), 4, 10))
    pressed = compliance[:, :, :, None] * m[:, None, None, :]
    motion[:, :2, 4:8], motion[:, :2, 8:] = pressed.reshape(-1, 2, 4), -compliance
    gradient = np.einsum("cir,cj->ijr", motion[:, :2], m).reshape(4, 10)
    gradient[:, :4] -= np.eye(4)
    return np.concatenate([gradient, motion[:, :2].sum(axis=0)]), motion


def _inverse_2x2(a: Floats) -> Floats:
    det = a[..., 0, 0] * a[..., 1, 1] - a[..., 0, 1] * a[..., 1, 0]
    adjugate = np.swapaxes(a[..., ::-1, ::-1], -1, -2) * [[1.0, -1.0], [-1.0, 1.0]]
    return np.asarray(adjugate / det[..., None, None])


def _inverse(c: Floats) -> Floats:
    """Inverse of each matrix of a batch; nan where one is singular or not finite."""
    usable = all_finite(c) & (np.linalg.det(np.nan_to_num(c)) != 0)
    safe = np.where(usable[..., None, None], c, np.eye(4))
    return np.where(usable[..., None, None], np.linalg.inv(safe), np.nan)
