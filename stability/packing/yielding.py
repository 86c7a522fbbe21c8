"""Controls of rates, and the complementarity problem of contacts at yield under one of them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from loops.arrays import Floats
from loops.errors import InputError
from stability.programmes import NOTHING
from stability.spectra import subspace_basis

# Entries of `M`, one less what the packing gives way, below this are rounding (rows: 9e-16).
ROUNDED = 1e-13


class MixedControl(NamedTuple):
    """`stress @ P' + strain @ H' = rate`, four rows of either or of both; 11, 12, 21, 22."""

    stress: Floats
    strain: Floats
    rate: Floats

    def matrix(self, tangent: Floats) -> Floats:
        """Return what the strain rate of a packing with this tangent (4, 4) is multiplied by."""
        return self.stress @ tangent + self.strain

    def require_regular(self, tangent: Floats) -> None:
        """Raise `InputError` where stress rates leave strain rates of this tangent (4, 4) open."""
        rows = self.matrix(tangent)
        rows = rows / np.maximum(np.linalg.norm(rows, axis=1, keepdims=True), 1e-300)
        if np.linalg.cond(rows) > 1.0 / ROUNDED:
            received = "stress rates that do not determine the strain rates"
            raise InputError("P", received, "a sample that is stiff in all directions", "Give H.")

    def strains(self, tangent: Floats, offset: Floats = NOTHING) -> Floats:
        """Return strain rates (4,) at which the stress rate is `tangent @ H' + offset`."""
        right = self.rate - self.stress @ offset
        return np.asarray(np.linalg.solve(self.matrix(tangent), right))


class Edge(NamedTuple):
    """Contacts at yield in a linear packing: rates at which they leave the friction limit, or slip.

    Of them all under unit strains (m, 4) and unit slips (m, k); the stress rates (4, 4), (4, k) of
    these, and the motions under unit slips, in columns; `left` is the largest share of their loads
    that no motion balances. Then rates (m,) and stress rates (4,) of a load that is there besides.
    """

    of_strain: Floats
    of_slip: Floats
    stress: Floats
    stress_of_slip: Floats
    motion: Floats
    left: float = 0.0
    of_load: Floats | float = 0.0
    stress_of_load: Floats = NOTHING

    def problem(self, control: MixedControl) -> tuple[Floats, Floats]:
        """Return `q` and `M` of `w = q + M z`, strain that the stress drives eliminated."""
        still = control._replace(rate=np.zeros((4, 1)))
        driven = self.of_strain @ still.strains(self.stress, self.stress_of_slip)
        M = self.of_slip + driven
        M = np.where(np.abs(M) < ROUNDED * (1.0 + np.abs(driven)), 0.0, M)
        h = control.strains(self.stress, self.stress_of_load)
        return self.of_strain @ h + self.of_load, M


def component_control(strain: ArrayLike, stress: ArrayLike | None = None) -> MixedControl:
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
    by_stress = np.diag(1.0 * driven.ravel())
    return MixedControl(by_stress, np.eye(4) - by_stress, np.where(driven, P, H).ravel())


def direction_control(direction: Floats, subspace: str, driven: str) -> MixedControl:
    """Return the control that drives strain or stress along a direction of a subspace.

    Strain outside of it is zero.
    """
    basis = subspace_basis(subspace)
    m = len(basis)
    # The rest of an orthonormal basis.
    rows = np.vstack([basis, np.linalg.svd(basis)[2][m:]])
    of_stress = np.diag((np.arange(4) < m) * float(driven == "stress"))
    rate = np.append(direction, np.zeros(4 - m))
    return MixedControl(of_stress @ rows, rows - of_stress @ rows, rate)
