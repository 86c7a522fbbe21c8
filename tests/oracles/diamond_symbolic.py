"""The diamond's tangents derived anew by sympy, from balance (12) and the contact law alone.

Nothing is taken from the package. `K~` comes from differentiating the external forces with
respect to the shortenings, `S = F/L0` and `E = Delta/L0` carry it over to stress and strain.
"""

from __future__ import annotations

import sympy as sp

L1, L2, L10, L20, kn = sp.symbols("L1 L2 L10 L20 k_n", positive=True)
kappa, mu, sign, N, T = sp.symbols("kappa mu s N T", real=True)

LENGTH = sp.sqrt(L1**2 + L2**2) / 2
ALPHA = sp.atan(L2 / L1)
COS, SIN = L1 / (2 * LENGTH), L2 / (2 * LENGTH)
F1 = 2 * (N * COS + T * SIN)
F2 = 2 * (N * SIN - T * COS)


def force_tangent(regime: str) -> sp.Matrix:
    """`dF/dDelta` as a matrix in `L1, L2, N, T, k_n` and the law's parameters."""
    columns = []
    for side in (L1, L2):
        length_rate, alpha_rate = -sp.diff(LENGTH, side), -sp.diff(ALPHA, side)
        N_rate = -kn * length_rate
        T_rate = kn * kappa * LENGTH * alpha_rate if regime == "elastic" else sign * mu * N_rate
        columns.append(
            [-sp.diff(F, side) + sp.diff(F, N) * N_rate + sp.diff(F, T) * T_rate for F in (F1, F2)]
        )
    return sp.Matrix(columns).T


def lagrangian_tangent(regime: str) -> sp.Matrix:
    """`dS/dE` with `S1 = F1/L20`, `S2 = F2/L10`, `Delta_k = L_k0 E_k`."""
    return sp.diag(1 / L20, 1 / L10) * force_tangent(regime) * sp.diag(L10, L20)


def stresses() -> tuple[sp.Expr, sp.Expr]:
    """Dimensionless stresses `S/kn` of the state."""
    return F1 / (L20 * kn), F2 / (L10 * kn)


def numeric(expression: sp.Expr | sp.Matrix, *names: sp.Symbol):
    """A numpy function of the expression in the order of `names`."""
    return sp.lambdify(names, expression, modules="numpy", cse=True)
