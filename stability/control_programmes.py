"""Linear controls as loading programmes, so that a path can be followed under them."""

from __future__ import annotations

import numpy as np

from loops.arrays import Floats
from loops.errors import InputError
from stability.destabilising import LinearControl, complement
from stability.programmes import Programme, combination
from stability.subspaces import subspace_basis


def strain_driven(control: LinearControl, subspace: str, rate: float = 1.0) -> Programme:
    """The control as a loading programme driven by `direction . e' = rate`.

    Its response at the state is `rate * direction`; the strength `direction . s` has the slope
    `rate * work`. Strains outside the subspace are held.

    Parameters
    ----------
    control : LinearControl
        Found on that subspace.
    subspace : {'diagonal', 'symmetric', 'full'}
    rate : float
        Strain rate, not zero; its sign is the sense in which the path sets out.

    Returns
    -------
    Programme

    Raises
    ------
    InputError
        If there is no control, or its dimension is not the subspace's.

    Examples
    --------
    >>> from stability.destabilising import destabilising_control
    >>> control = destabilising_control([[2.0, 0.0], [0.0, -0.5]])
    >>> (strain_driven(control, "diagonal").strain[:2, [0, 3]] * 5**0.5).round(12).tolist()
    [[1.0, 2.0], [2.0, -1.0]]
    """
    held, free, drive = _rows(control, subspace)
    strain = np.vstack([drive, held, np.zeros_like(free)])
    stress = np.vstack([np.zeros_like(drive), np.zeros_like(held), free])
    return combination(stress, strain, [rate, 0.0, 0.0, 0.0], "destabilising, strain-driven")


def stress_driven(control: LinearControl, subspace: str, rate: float = 1.0) -> Programme:
    """The control as a loading programme driven by `direction . s' = rate`.

    Where the control loses its strength no such load can be added: `control_matrix` is singular.

    Parameters
    ----------
    control : LinearControl
        Found on that subspace.
    subspace : {'diagonal', 'symmetric', 'full'}
    rate : float
        Stress rate, not zero.

    Returns
    -------
    Programme

    Raises
    ------
    InputError
        As `strain_driven`.

    Examples
    --------
    >>> from stability.destabilising import destabilising_control
    >>> control = destabilising_control([[2.0, 0.0], [0.0, -0.5]])
    >>> (stress_driven(control, "diagonal").stress[0, [0, 3]] * 5**0.5).round(12).tolist()
    [1.0, 2.0]
    """
    held, free, drive = _rows(control, subspace)
    strain = np.vstack([np.zeros_like(drive), held, np.zeros_like(free)])
    stress = np.vstack([drive, np.zeros_like(held), free])
    return combination(stress, strain, [rate, 0.0, 0.0, 0.0], "destabilising, stress-driven")


def _rows(control: LinearControl, subspace: str) -> tuple[Floats, Floats, Floats]:
    """Held strains (those outside the subspace last), held stresses, driven direction: (., 4)."""
    basis = subspace_basis(subspace)
    if control.status != "found" or len(control.direction) != len(basis):
        raise InputError(
            "control",
            f"status {control.status!r}, {len(control.direction)} components",
            f"a control that was found, with the {len(basis)} components of {subspace!r}",
            "Restrict the tangent to this subspace first.",
        )
    held = np.vstack([control.held @ basis, complement(basis)])
    return held, control.free @ basis, (control.direction @ basis)[None]
