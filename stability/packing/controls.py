"""Controls of the rates of a packing: what of strain and stress is held or driven."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from loops.arrays import Flags, Floats, Integers
from loops.errors import InputError
from stability.packing.yielding import LinearAnswer, YieldResponse, complementary_rates
from stability.programmes import Programme
from stability.spectra import subspace_basis

# Entries of `M`, one less what the packing gives way, below this are rounding (rows: 9e-16).
ROUNDED = 1e-13


class HeldAndDriven(NamedTuple):
    """`held @ H' = strain`, `driven @ P' = stress`; all rows are orthonormal, in 11, 12, 21, 22."""

    held: Floats
    strain: Floats
    driven: Floats
    stress: Floats


class MixedControl(NamedTuple):
    """`stress @ P' + strain @ H' = rate`, rows of either or of both."""

    stress: Floats
    strain: Floats
    rate: Floats


Control = HeldAndDriven | MixedControl


def controlled(
    yielding: YieldResponse,
    active: Flags,
    answer: LinearAnswer,
    chosen: Integers,
    pair: tuple[Floats, Floats],
    control: Control,
) -> tuple[Floats, Floats]:
    """Return `q` and `M` of the chosen candidates, strain that the stress drives eliminated."""
    unit = complementary_rates(yielding, active, answer.relative)[chosen]
    matrix, stress = pair
    if isinstance(control, MixedControl):
        A = control.stress @ answer.stress + control.strain
        solved = np.linalg.solve(A, np.column_stack([control.rate, -control.stress @ stress]))
        q, driven = unit @ solved[:, 0], unit @ solved[:, 1:]
        M = matrix + driven
        return q, np.where(np.abs(M) < ROUNDED * (1.0 + np.abs(driven)), 0.0, M)
    held, B = control.held.T @ control.strain, control.driven
    imposed = control.stress - B @ answer.stress @ held
    solved = np.linalg.solve(B @ answer.stress @ B.T, np.column_stack([imposed, -B @ stress]))
    q, driven = unit @ (held + B.T @ solved[:, 0]), unit @ B.T @ solved[:, 1:]
    M = matrix + driven
    return q, np.where(np.abs(M) < ROUNDED * (1.0 + np.abs(driven)), 0.0, M)


def component_control(strain: ArrayLike, stress: ArrayLike | None) -> HeldAndDriven:
    """Return the control of components of `H'` where they are numbers, else of `P'`."""
    H = np.asarray(strain, dtype=float)
    P = np.zeros((2, 2)) if stress is None else np.asarray(stress, dtype=float)
    driven = np.isnan(H)
    if H.shape != (2, 2) or np.isinf(H).any():
        expected = "(2, 2) finite numbers, or nan for stress control"
        remedy = "Give a number for each component that is prescribed, nan for the others."
        raise InputError("strain_rate", f"{H.tolist()}", expected, remedy)
    if P.shape != (2, 2) or not np.isfinite(P[driven]).all():
        expected = "finite numbers of shape (2, 2) where the strain is nan"
        remedy = "Give zero to hold the stress."
        raise InputError("stress_rate", f"{P.tolist()}", expected, remedy)
    rows = np.eye(4)
    return HeldAndDriven(rows[~driven.ravel()], H[~driven], rows[driven.ravel()], P[driven])


def direction_control(direction: Floats, subspace: str, driven: str) -> HeldAndDriven:
    """Return the control that drives strain or stress along a direction of a subspace.

    Strain outside of it is zero.
    """
    basis = subspace_basis(subspace)
    rest = np.linalg.svd(basis)[2][len(basis) :]
    none = np.zeros(len(rest))
    if driven == "stress":
        return HeldAndDriven(rest, none, basis, direction)
    held = np.vstack([basis, rest])
    return HeldAndDriven(held, np.append(direction, none), np.empty((0, 4)), np.empty(0))


def control_of(programme: Programme, stress: Floats) -> Control:
    """Return the control of a programme in a first state; rows of strain or of stress apart."""
    stress, strain, rate = programme.equations(np.zeros(4), stress.ravel())
    driven, held = stress.any(axis=1), strain.any(axis=1)
    if (driven & held).any():
        return MixedControl(stress, strain, rate)
    return HeldAndDriven(
        *_orthonormal(strain[held], rate[held]), *_orthonormal(stress[driven], rate[driven])
    )


def _orthonormal(rows: Floats, values: Floats) -> tuple[Floats, Floats]:
    """Return equations `rows @ a = values` with orthonormal rows; as they are if they are so."""
    if np.array_equal(rows @ rows.T, np.eye(len(rows))):
        return rows, values
    Q, R = np.linalg.qr(rows.T)
    return np.ascontiguousarray(Q.T), np.linalg.solve(R.T, values)


def controlled_strain(answer: LinearAnswer, control: Control) -> Floats:
    """Return the strain rate (4,), its driven part as the stress asks for."""
    if isinstance(control, MixedControl):
        A = control.stress @ answer.stress + control.strain
        return np.asarray(np.linalg.solve(A, control.rate))
    held, B = control.held.T @ control.strain, control.driven
    imposed = control.stress - B @ answer.stress @ held
    return np.asarray(held + B.T @ np.linalg.solve(B @ answer.stress @ B.T, imposed))
