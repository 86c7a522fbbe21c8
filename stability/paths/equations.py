"""The closure as linear equations between rates, `E z = 0`."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from loops.contact_state import ContactState
from loops.contact_tangent import (
    ContactTangent,
    contact_tangent,
    translational_blocks,
    translational_compliances,
)
from loops.laws.protocol import Regimes
from stability.paths.model import PathModel

Floats = NDArray[np.float64]

# Below this determinant of a contact's block, in units of kn^2, its compliance is not used.
SOFT_BLOCK = 1e-7


@dataclass(frozen=True, eq=False)
class Equations:
    """Closure equations `E z = 0` of the scaled unknowns `z = (H', P'/kn, rest)`.

    Attributes
    ----------
    matrix : (R, R + 4) array
        `E`; four control equations complete it.
    branch_rate : (C, 2, R + 4) array
        Branch rates `d' = branch_rate @ z`.
    spin : (G, R + 4) array
        Spins `w = spin @ z`.
    """

    matrix: Floats
    branch_rate: Floats
    spin: Floats


def closure_equations(
    model: PathModel, H: Floats, contacts: ContactState, regime: Regimes
) -> Equations:
    """Equations of the model's closure in one state.

    Parameters
    ----------
    model : PathModel
        Constants.
    H : (4,) array
        Displacement gradient, for the spin of the loop.
    contacts : ContactState
        Contacts.
    regime : (C,) array of int8
        Their regime.

    Returns
    -------
    Equations
    """
    if model.closure == "affine":
        return _affine(model, H, contacts, regime)
    if model.is_plain_ring:
        k = translational_blocks(contacts, model.law, regime)
        if (np.abs(np.linalg.det(k)) > SOFT_BLOCK * model.kn**2).all():
            return _ring(model, translational_compliances(contacts, model.law, regime))
    return saddle_equations(model, H, contacts, regime)


def loop_spin(H: Floats) -> Floats:
    """(4,) spin of the loop per component of `H'`: `w = (L21 - L12)/2`, `L = -H' F^-1`."""
    F = np.eye(2) - H.reshape(2, 2)
    inverse = np.array([[F[1, 1], -F[0, 1]], [-F[1, 0], F[0, 0]]])
    inverse /= F[0, 0] * F[1, 1] - F[0, 1] * F[1, 0]
    return 0.5 * np.array([inverse[0, 1], inverse[1, 1], -inverse[0, 0], -inverse[1, 0]])


def _affine(model: PathModel, H: Floats, contacts: ContactState, regime: Regimes) -> Equations:
    """`d' = -H' d0` and `P = (1/V0) sum f (x) d0`; with free spins the moments too."""
    grains, k_unit = model.grain_count, model.stiffness
    free = model.spins == "free"
    size = 8 + (grains if free else 0)
    branch_rate = np.zeros((model.contact_count, 2, size))
    branch_rate[:, 0, 0:2] = branch_rate[:, 1, 2:4] = -model.d0
    spin = np.zeros((grains, size))
    if model.spins == "blocked":
        k = translational_blocks(contacts, model.law, regime)
        force_rate = -k @ branch_rate
    else:
        if free:
            spin[:, 8:] = np.eye(grains)
        else:
            spin[:, :4] = loop_spin(H)
        blocks = contact_tangent(contacts, model.law, regime)
        force_rate = _force_rate(model, blocks, branch_rate, spin)
    matrix = np.zeros((size - 4, size))
    stress_rate = np.einsum("cir,cj->ijr", force_rate, model.d0).reshape(4, size)
    matrix[:4] = stress_rate / (model.volume * k_unit)
    matrix[:4, 4:8] -= np.eye(4)
    if free:
        matrix[4:] = _moments(model, blocks, branch_rate, spin) / (k_unit * model.volume)
    return Equations(matrix, branch_rate, spin)


def _ring(model: PathModel, compliance: Floats) -> Equations:
    """One redundant force `f^`: `d' = -k^-1 (f^ - P m)`, `sum d' = 0`, `V0 H = sum d' (x) m`."""
    L, V = model.length, model.volume
    m = model.m
    branch_rate = np.zeros((model.contact_count, 2, 10))
    soft = compliance * model.stiffness
    branch_rate[:, :, 4:8] = (soft[:, :, :, None] * m[:, None, None, :]).reshape(-1, 2, 4)
    branch_rate[:, :, 8:10] = -soft * L
    matrix = np.zeros((6, 10))
    matrix[:2] = branch_rate.sum(axis=0) / L
    matrix[2:] = np.einsum("cir,cj->ijr", branch_rate, m).reshape(4, 10) / V
    matrix[2:, :4] -= np.eye(4)
    return Equations(matrix, branch_rate, np.zeros((model.grain_count, 10)))


def saddle_equations(
    model: PathModel, H: Floats, contacts: ContactState, regime: Regimes
) -> Equations:
    """Grain by grain: `f` in balance with `-P b_i`, `V0 H = -sum u_i (x) b_i`, moments if free."""
    grains, L = model.grain_count, model.length
    places = slice(8, 8 + 2 * grains)
    free = model.spins == "free"
    size = 8 + (3 if free else 2) * grains
    i, j = model.contacts.T
    branch_rate = np.zeros((model.contact_count, 2, size))
    each = np.arange(model.contact_count)
    for axis in range(2):
        branch_rate[each, axis, 8 + 2 * i + axis] = -L
        branch_rate[each, axis, 8 + 2 * j + axis] = L
    spin = np.zeros((grains, size))
    if free:
        spin[:, 8 + 2 * grains :] = np.eye(grains)
    elif model.spins == "affine":
        spin[:, :4] = loop_spin(H)
    blocks = contact_tangent(contacts, model.law, regime)
    force_rate = _force_rate(model, blocks, branch_rate, spin)
    matrix = np.zeros((size - 4, size))
    balance = matrix[: 2 * grains]
    np.add.at(balance.reshape(grains, 2, size), i, -force_rate / (model.stiffness * L))
    np.add.at(balance.reshape(grains, 2, size), j, force_rate / (model.stiffness * L))
    for axis in range(2):
        balance[axis::2, 4 + 2 * axis : 6 + 2 * axis] -= model.b / L
        # The mean displacement is free: held at zero.
        balance[axis::2, 8 + axis : 8 + 2 * grains : 2] += 1.0 / grains
    gradient = matrix[2 * grains : 2 * grains + 4]
    gradient[:, :4] = np.eye(4)
    for a in range(2):
        gradient[2 * a : 2 * a + 2, places][:, a::2] = model.b.T / L
    if free:
        matrix[2 * grains + 4 :] = _moments(model, blocks, branch_rate, spin) / (
            model.stiffness * model.volume
        )
    return Equations(matrix, branch_rate, spin)


def _force_rate(
    model: PathModel, blocks: ContactTangent, branch_rate: Floats, spin: Floats
) -> Floats:
    """(C, 2, R) `f' = -k d' + q_i w_i + q_j w_j`."""
    i, j = model.contacts.T
    rolled = blocks.q_i[:, :, None] * spin[i, None, :] + blocks.q_j[:, :, None] * spin[j, None, :]
    return np.asarray(rolled - blocks.k @ branch_rate)


def _moments(model: PathModel, blocks: ContactTangent, branch_rate: Floats, spin: Floats) -> Floats:
    """(G, R) rate of the moment that each grain needs from outside."""
    i, j = model.contacts.T
    total = np.zeros((model.grain_count, branch_rate.shape[-1]))
    for grain, p, row in ((i, blocks.p_i, 0), (j, blocks.p_j, 1)):
        c = blocks.c[:, row]
        share = np.einsum("ck,ckr->cr", p, branch_rate)
        np.add.at(total, grain, share + c[:, :1] * spin[i] + c[:, 1:] * spin[j])
    return total
