"""The hexagon of the H-model as a grain graph."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from loops import GrainGraph, InputError
from patterns.diamond import overlap_ratio
from patterns.diamond.arguments import acute_angle, finite, positive
from patterns.diamond.arguments import strain as checked_strain
from patterns.polygons.ring import Floats, ring_contacts

# As alpha grows, branches (0, 1) and (3, 4) turn clockwise, (2, 3) and (5, 0) counter-clockwise;
# the graph counts T along the counter-clockwise tangent, the hexagon along growing alpha.
SHEAR_SIGNS = np.array([1.0, 0.0, -1.0, 1.0, 0.0, -1.0])
AXIAL = np.array([False, True, False, False, True, False])

# Strains of a hexagon that barely touches give an overlap of zero up to this rounding.
ROUNDING = 4.0 * np.finfo(np.float64).eps


def hexagon(
    alpha0: ArrayLike,
    *,
    E1: ArrayLike = 0.0,
    E2: ArrayLike = 0.0,
    E_axial: ArrayLike | None = None,
    T: ArrayLike = 0.0,
    radius: ArrayLike = 0.5,
    kn: ArrayLike = 1.0,
) -> GrainGraph:
    """The hexagon of the H-model: four branches at +-alpha to axis 1, two along it.

    Grains run counter-clockwise: 0 right, 1 and 2 above, 3 left, 4 and 5 below. Contacts 1 and 4
    are axial. In the reference six equal grains barely touch, all branches `l0 = 2 radius`; at
    60 degrees it is the regular hexagon. The strains give the extent, `L_k = L_k0 (1 - E_k)`;
    under an isotropic strain `E1 = E2` the hexagon is scaled. How `E1` is shared between axial
    and inclined branches is the hexagon's one inner freedom: evenly (the affine closure) unless
    `E_axial` says otherwise. Normal forces follow from the positions, `N = kn (l0 - l)`; whether
    they are in balance is for `hexagon_external_forces` to say.

    Parameters
    ----------
    alpha0 : (...) array
        Reference angle of the inclined branches to axis 1 in (0, pi/2), radians.
    E1, E2 : (...) array
        Strains of the extent below 1, compression positive.
    E_axial : (...) array, optional
        Strain of the axial branches below 1; `E1` if left out.
    T : (...) array
        Shear force in the inclined contacts, positive when alpha grows (force).
    radius : (...) array
        Radius of the grains (length).
    kn : (...) array
        Normal stiffness (force per length).

    Returns
    -------
    GrainGraph
        Centred on the origin; batch axes are the broadcast shape of the arguments.

    Raises
    ------
    InputError
        If an argument leaves its range, the strains open a contact, or the axial branches take
        up all of the length.

    Examples
    --------
    >>> import numpy as np
    >>> from patterns import hexagon
    >>> hexagon(np.pi / 3, E1=0.1, E2=0.1).normal_force.round(12).tolist()
    [0.1, 0.1, 0.1, 0.1, 0.1, 0.1]
    """
    axial = E1 if E_axial is None else E_axial
    alpha0, E1, E2, axial, T, radius, kn = np.broadcast_arrays(
        acute_angle("alpha0", alpha0),
        checked_strain("E1", E1),
        checked_strain("E2", E2),
        checked_strain("E_axial", axial),
        finite("T", T),
        positive("radius", radius),
        positive("kn", kn),
    )
    l0, cos, sin = 2.0 * radius, np.cos(alpha0), np.sin(alpha0)
    # Strain of the inclined branches along axis 1, from L10 E1 = 2 l0 cos(alpha0) E + l0 E_axial.
    inclined = E1 + (E1 - axial) / (2.0 * cos)
    if not (inclined < 1).all():
        raise InputError(
            "E1, E_axial",
            "axial branches as long as the hexagon",
            "a strain E1 that leaves room for the inclined branches",
            "Compress the axial branches more.",
        )
    overlap = np.where(AXIAL, axial[..., None], overlap_ratio(inclined, E2, alpha0)[..., None])
    if (overlap < -ROUNDING).any():
        raise InputError(
            "E1, E2, E_axial",
            f"strains that part the grains by {-float(overlap.min()):.3g} of the branch",
            "strains under which every contact still touches",
            "Compress the hexagon.",
        )
    return GrainGraph(
        x=_centres(l0 * (1 - axial), l0 * (1 - inclined) * cos, l0 * (1 - E2) * sin),
        x0=_centres(l0, l0 * cos, l0 * sin),
        radii=radius[..., None] * np.ones(6),
        contacts=ring_contacts(6),
        normal_force=(kn * l0)[..., None] * np.maximum(overlap, 0.0),
        shear_force=T[..., None] * SHEAR_SIGNS,
    )


def _centres(axial: Floats, along: Floats, across: Floats) -> Floats:
    """Centres (..., 6, 2) from the axial branch and the projections of an inclined one."""
    inner, outer, zero = 0.5 * axial, 0.5 * axial + along, np.zeros_like(axial)
    x = np.stack([outer, inner, -inner, -outer, -inner, inner], axis=-1)
    y = np.stack([zero, across, across, zero, -across, -across], axis=-1)
    return np.stack([x, y], axis=-1)
