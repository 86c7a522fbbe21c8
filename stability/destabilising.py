"""Linear controls under which a loop loses strength: kinematic structural stability.

Under dead loads a loop is lost where det K = 0; under a linear constraint it may be lost earlier.
Let x be isotropic, `x . K x = 0`, and hold the strain combination along `K x`. Then x is free (it
is orthogonal to `K x`), and the stress rate `K x` that it causes is pure reaction: the tangent
projected on the remaining plane has x in its kernel. Such an x exists if and only if Ks is not
definite, so definiteness of Ks is stability under every linear control (Lerbet, Challamel, Nicot,
Darve).

In the orthonormal frame (y, n, Z) with n along the part of `K y` orthogonal to y, any direction y
has the stress rate `W2(y) y + |r| n` and none along Z. Holding the strain along n and the stress
along Z leaves y as the response, with the slope W2(y): zero for an isotropic y, falling inside the
cone.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from loops.arrays import Floats
from loops.errors import InputError, number
from loops.shown import Shown
from stability.programmes import Programme, combination
from stability.spectra import RTOL, as_operator, operator_norm, subspace_basis, symmetric_modes

ControlStatus = Literal["found", "definite", "singular", "undetermined"]


@dataclass(frozen=True, eq=False, repr=False)
class LinearControl(Shown):
    """A linear control of a loop and the response that it admits.

    Attributes
    ----------
    status : {'found', 'definite', 'singular', 'undetermined'}
        'definite': Ks is, and no linear control destabilises (a negative definite one is lost
        under none); 'singular': det K = 0, the loop is lost without any constraint;
        'undetermined': within the tolerance, or the operator is not finite. The arrays are NaN
        unless 'found'.
    direction : ndarray, shape (m,)
        Unit strain rate y that the control admits.
    held : ndarray, shape (m,)
        Unit combination of strains that is held, `held . e' = 0`.
    free : ndarray, shape (m - 2, m)
        Combinations of stresses that are held, `free @ s' = 0`, one a row.
    work : float
        `y . K y`, the slope of the conjugate stress `y . s` along y; zero if y is isotropic.
    reaction : float
        Stress rate along `held`.
    """

    status: ControlStatus
    direction: Floats
    held: Floats
    free: Floats
    work: float
    reaction: float


def destabilising_control(K: ArrayLike, rtol: float = RTOL) -> LinearControl:
    """The linear control that makes a loop with indefinite Ks lose its strength.

    Of the isotropic vectors `x = cos(b) v_min +- sin(b) v_max`, `tan(b)^2 = -lambda_min/lambda_max`
    with the extreme eigenvectors of Ks, the one whose `|K x|` is smaller is taken: the weaker
    reaction has to be held. In the plane these two are the edges of the cone.
    Theory, equation (6.11).

    Parameters
    ----------
    K : array_like, shape (m, m)
        Tangent on a subspace, `s' = K e'`, not symmetrised.
    rtol : float
        Uncertainty of the entries relative to the Frobenius norm.

    Returns
    -------
    LinearControl
        With `direction` isotropic: `constrained_tangent` is singular.

    Raises
    ------
    InputError
        If K is a batch or not square.

    Examples
    --------
    >>> control = destabilising_control([[2.0, 0.0], [0.0, -0.5]])
    >>> control.status, (control.direction * 5**0.5).round(12).tolist()
    ('found', [1.0, 2.0])
    >>> (control.held * 5**0.5).round(12).tolist(), round(control.work, 12) + 0.0
    ([2.0, -1.0], 0.0)
    >>> destabilising_control([[2.0, 0.0], [0.5, 1.0]]).status
    'definite'
    """
    operator = _one_operator(K)
    number("rtol", rtol, 0.0)
    status = control_status(operator, rtol)
    if status != "found":
        return no_control(status, len(operator))
    values, vectors = symmetric_modes(operator)
    low, high = np.sqrt(-values[0]), np.sqrt(values[-1])
    pair = np.stack(
        [high * vectors[:, 0] + low * vectors[:, -1], high * vectors[:, 0] - low * vectors[:, -1]]
    )
    pair /= np.linalg.norm(pair, axis=1, keepdims=True)
    reaction = np.linalg.norm(pair @ operator.T, axis=1)
    weaker = int(reaction[1] < reaction[0] * (1.0 - RTOL))
    return control_along(operator, _leading_positive(pair[weaker]), rtol)


def softening_control(
    K: ArrayLike, direction: ArrayLike | None = None, rtol: float = RTOL
) -> LinearControl:
    """The linear control under which the response is a given direction of negative W2.

    Driven along it, the conjugate stress falls at once with the slope `W2 < 0`, while the control
    of `destabilising_control` only has a peak in the state itself.

    Parameters
    ----------
    K : array_like, shape (m, m)
        Tangent on a subspace.
    direction : array_like, shape (m,), optional
        Strain rate y inside the cone; the direction of the smallest W2 if left out.
    rtol : float
        Uncertainty of the entries relative to the Frobenius norm.

    Returns
    -------
    LinearControl
        'definite' where Ks is positive definite, 'undetermined' within the tolerance.

    Raises
    ------
    InputError
        If K is a batch, or the direction is not inside the cone.

    Examples
    --------
    >>> control = softening_control([[1.0, 0.0], [0.5, 0.0]], [-1.0, 3.0])
    >>> control.status, round(control.work, 12)
    ('found', -0.05)
    """
    operator = _one_operator(K)
    values, vectors = symmetric_modes(operator)
    band = rtol * float(operator_norm(operator))
    if not values[0] < -band:
        known = np.isfinite(values[0]) and values[0] > band
        return no_control("definite" if known else "undetermined", len(operator))
    y = vectors[:, 0] if direction is None else np.asarray(direction, dtype=np.float64)
    if y.shape != (len(operator),) or not np.linalg.norm(y) > 0.0:
        expected = f"{len(operator)} components, not all zero"
        raise InputError("direction", str(y.tolist()), expected, "Give one strain rate.")
    y = y / np.linalg.norm(y)
    work = float(y @ operator @ y)
    if not work < -band:
        where, remedy = "direction", "Leave it out to take the direction of the smallest W2."
        received = f"{y.tolist()} with W2 = {work:.3g}"
        raise InputError(where, received, "a direction inside the instability cone, W2 < 0", remedy)
    return control_along(operator, y, rtol)


def control_status(K: ArrayLike, rtol: float = RTOL) -> ControlStatus:
    """Whether a linear control destabilises: 'found' if Ks is indefinite and K not singular."""
    operator = _one_operator(K)
    if not np.isfinite(operator).all():
        return "undetermined"
    band = rtol * float(operator_norm(operator))
    if np.linalg.svd(operator, compute_uv=False)[-1] <= band:
        return "singular"
    values, _ = symmetric_modes(operator)
    if values[0] > band or values[-1] < -band:
        return "definite"
    return "found" if values[0] < -band and values[-1] > band else "undetermined"


def constrained_tangent(K: ArrayLike, control: LinearControl) -> Floats:
    """The tangent projected on the strain rates that the control leaves, `Q K Q^T`."""
    Q = np.vstack([control.direction, control.free])
    return np.asarray(Q @ _one_operator(K) @ Q.T)


def control_along(operator: Floats, y: Floats, rtol: float = RTOL) -> LinearControl:
    """Control whose response is the unit vector y."""
    stress = operator @ y
    work = float(y @ stress)
    reaction = stress - work * y
    size = float(np.linalg.norm(reaction))
    # If K y is along y there is no reaction: any combination orthogonal to y may be held.
    idle = size <= rtol * float(operator_norm(operator))
    held = complement(y[None])[0] if idle else reaction / size
    held = held - (held @ y) * y
    held /= np.linalg.norm(held)
    return LinearControl("found", y, held, complement(np.stack([y, held])), work, size)


def complement(rows: Floats) -> Floats:
    """Orthonormal rows orthogonal to the given ones."""
    rest = np.linalg.svd(rows)[2][len(rows) :]
    return np.stack([_leading_positive(row) for row in rest]) if len(rest) else rest


def _leading_positive(vector: Floats) -> Floats:
    leading = np.argmax(np.abs(vector) >= 0.5 * np.abs(vector).max())
    return np.asarray(vector * np.sign(vector[leading]))


def no_control(status: ControlStatus, m: int) -> LinearControl:
    """Placeholder for a control where there is none."""
    empty = np.full(m, np.nan)
    rest = np.full((max(m - 2, 0), m), np.nan)
    return LinearControl(status, empty, empty, rest, float("nan"), float("nan"))


def _one_operator(K: ArrayLike) -> Floats:
    operator = as_operator(K)
    if operator.ndim != 2 or len(operator) < 2:
        expected = "one operator in two dimensions or more"
        raise InputError("operator", f"shape {operator.shape}", expected, "Take them in turn.")
    return operator


# ---- as loading programmes


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
        Strain rate, not zero; its sign is that of the motion along `direction`.

    Returns
    -------
    Programme

    Raises
    ------
    InputError
        If there is no control, or its dimension is not the subspace's.

    Examples
    --------
    >>> control = destabilising_control([[2.0, 0.0], [0.0, -0.5]])
    >>> (strain_driven(control, "diagonal").strain[:2, [0, 3]] * 5**0.5).round(12).tolist()
    [[1.0, 2.0], [2.0, -1.0]]
    """
    held, free, drive = _control_rows(control, subspace)
    strain = np.vstack([drive, held, np.zeros_like(free)])
    stress = np.vstack([np.zeros_like(drive), np.zeros_like(held), free])
    return combination(stress, strain, [rate, 0.0, 0.0, 0.0], "destabilising, strain-driven")


def _control_rows(control: LinearControl, subspace: str) -> tuple[Floats, Floats, Floats]:
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
