"""Equation (8c) as printed: the rule of sliding contacts that leaves Coulomb's cone."""

from __future__ import annotations

import numpy as np

from loops import LinearFrictional
from loops.arrays import Floats, Regimes
from loops.graph import ContactState


class PrintedRule(LinearFrictional):
    """Linear springs whose sliding contacts follow (8c) as printed while N falls.

    `T' = -zeta_n zeta_t zeta mu kn un'` with `zeta_n = sign(un')`: a contact that slides outward
    while N falls has `T' = -s mu N'`, `s = sign(T)`, so that `|T|` grows and leaves Coulomb's cone.
    Where N grows the rule is Coulomb's, `LinearFrictional`. `T` is integrated: it is no function of
    `N` (`keeps_strength`).

    Parameters
    ----------
    kn, kt, mu, shear_increment
        As in `loops.LinearFrictional`.

    Examples
    --------
    >>> from loops import Scene
    >>> from patterns.diamond import TABLE_1, PrintedRule, diamond
    >>> from stability import Stage, follow, programmes
    >>> import numpy as np
    >>> stages = [Stage(programmes.isotropic_strain(), "H11", 0.3),
    ...           Stage(programmes.drained_biaxial(), "H11", 0.5)]
    >>> scene = Scene(diamond(np.pi / 4), PrintedRule(1.0, TABLE_1.kappa, TABLE_1.mu))
    >>> path = follow(scene, stages, closure="affine")
    >>> loaded = path.normal_force[:, 0] > 0  # at the end (2 N_B - N) / N, N_B = 0.2769
    >>> use = np.abs(path.shear_force / TABLE_1.mu)[loaded] / path.normal_force[loaded]
    >>> round(float(use[-1, 0]), 2)
    1.17
    """

    keeps_strength = False

    def local_stiffness(self, state: ContactState, regime: Regimes) -> Floats:
        """Sliding `[[kn, 0], [-s mu kn, 0]]`, the sign of Coulomb's law turned."""
        stiffness = super().local_stiffness(state, regime)
        # At the apex of the cone T carries a sign alone; loading from there, N grows.
        falls = np.abs(state.shear_force) > 1e-200
        stiffness[..., 1, 0] = np.where(falls, -1.0, 1.0) * stiffness[..., 1, 0]
        return stiffness
