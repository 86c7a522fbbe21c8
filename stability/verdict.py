"""Stability of tangents: the verdict on one of them, and modes and cones of many at once."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal, NamedTuple, TypeVar, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from loops import MacroTangent
from loops.arrays import Floats
from loops.errors import InputError, number
from loops.shown import Shown
from stability.second_order_work import plane_cone, unstable_fraction
from stability.spectra import (
    RTOL,
    as_operator,
    flutter_pairs,
    operator_norm,
    restrict,
    spectrum,
    symmetric_modes,
    symmetric_spectrum,
)

VerdictStatus = Literal["stable", "unstable", "undetermined"]
Loss = Literal["none", "divergence", "flutter"]
_Array = TypeVar("_Array", bound=np.ndarray[Any, Any])


@dataclass(frozen=True, eq=False, repr=False)
class Verdict(Shown):
    """Verdict on the stability of a tangent on a named subspace.

    `status` refers to second-order work (44): stable if W2 > 0 in every direction. `divergence` and
    `flutter` refer to the spectrum of K, the loss under dead loads. Bromwich's inequality keeps a
    stable operator from divergence; it does not keep it from flutter.

    Attributes
    ----------
    status : {'stable', 'unstable', 'undetermined'}
        Undetermined within the tolerance, or when the operator is not finite.
    margin : float
        `lambda_min(Ks)/|K|`, dimensionless, `|K|` the Frobenius norm; 0 for the zero operator.
    tolerance : float
        Half-width of the undetermined band of `margin`: `rtol` plus the error over `|K|`.
    witness : ndarray, shape (m,)
        Unit direction of lambda_min(Ks) in the components of the subspace.
    subspace : str
        'diagonal', 'symmetric', 'full', or 'given' for an array judged as it came.
    divergence : bool
        K is singular within the tolerance, or has a negative real eigenvalue.
    flutter : bool
        K has a complex pair beyond the tolerance (see `flutter_pairs`).
    eigenvalues : ndarray of complex, shape (m,)
        Of K, in its unit: force per length for a tangent.
    symmetric_eigenvalues : ndarray, shape (m,)
        Of Ks, ascending, in the unit of K.
    kn : float or None
        Mean normal stiffness that `over_kn` divides by.
    """

    status: VerdictStatus
    margin: float
    tolerance: float
    witness: Floats
    subspace: str
    divergence: bool
    flutter: bool
    eigenvalues: NDArray[np.complex128]
    symmetric_eigenvalues: Floats
    kn: float | None = None

    @property
    def lambda_min(self) -> float:
        """Smallest eigenvalue of Ks, in the unit of K: `margin` is this over `|K|`."""
        return float(self.symmetric_eigenvalues[0])

    @property
    def over_kn(self) -> float:
        """Smallest eigenvalue over the mean kn, as tables of loops have it; nan without a kn."""
        return float("nan") if self.kn is None else self.lambda_min / self.kn

    @property
    def mode(self) -> Loss:
        """Loss shown by the spectrum of K; divergence is named first when both are there."""
        if self.divergence:
            return "divergence"
        return "flutter" if self.flutter else "none"

    def facts(self) -> dict[str, object]:
        """Facts shown at the prompt and in a notebook."""
        return {
            "status": self.status,
            "subspace": self.subspace,
            "lambda_min (unit of K)": f"{self.lambda_min:.6g}",
            **({} if self.kn is None else {"lambda_min/kn": f"{self.over_kn:.6g}"}),
            "margin lambda_min/|K|": f"{self.margin:.6g}",
            "tolerance": f"{self.tolerance:.2g}",
            "loss in the spectrum of K": self.mode,
        }

    def __str__(self) -> str:
        direction = ", ".join(f"{component:.3g}" for component in self.witness)
        losses = [name for name in ("divergence", "flutter") if getattr(self, name)]
        return (
            f"{self.status} ({self.subspace}): lambda_min/|K| = {self.margin:.4g} "
            f"(tolerance {self.tolerance:.1g}) along ({direction}); "
            f"spectrum of K: {' and '.join(losses) or 'no loss'}"
        )


def judge(
    K: ArrayLike | MacroTangent,
    subspace: str | None = None,
    rtol: float = RTOL,
    error: float | None = None,
    kn: float | None = None,
) -> Verdict:
    """Judge one operator.

    Definiteness comes from the eigenvalues of Ks on the whole subspace: pairs of directions would
    not do. The entries are taken as known to `rtol |K|` and to the error of the solve they
    come from: lambda_min within their sum is undetermined. Theory, equation (6.10).

    Parameters
    ----------
    K : array_like, shape (m, m), or (4, 4) with a subspace, or MacroTangent
        The operator as it stands, or the macroscopic tangent A to be restricted; with the tangent
        of a closure goes the error bound that its solver states.
    subspace : {'diagonal', 'symmetric', 'full'}, optional
        Where to restrict a macroscopic tangent. Left out: that of a `MacroTangent` is 'symmetric',
        strains without rotation of the loop; an array is judged as it is.
    rtol : float
        Tolerance relative to the Frobenius norm.
    error : float, optional
        Bound on the error of K, Frobenius, in its unit; that of a `MacroTangent` if left out,
        else 0.
    kn : float, optional
        Mean normal stiffness, `snapshot.mean_kn`: the verdict tells its smallest eigenvalue over
        it too, `over_kn`, which is the number of `loop_table`.

    Returns
    -------
    Verdict
        Undetermined, with NaN for its numbers, for an operator that is not finite.

    Raises
    ------
    InputError
        If K is a batch, is not square, or the subspace does not fit it.

    Examples
    --------
    The isotropically compressed diamond at 45 degrees has the eigenvalues 1 and kappa - E/(1 - E).

    >>> verdict = judge([[0.45, 0.55], [0.55, 0.45]])
    >>> verdict.status, verdict.mode, round(verdict.margin, 6)
    ('unstable', 'divergence', -0.099504)
    >>> print(judge([[3.0, 0.0], [0.0, 4.0]]))
    stable (given): lambda_min/|K| = 0.6 (tolerance 1e-12) along (1, 0); spectrum of K: no loss

    The tangent of a closure is judged on strains alone; among all four components is the rotation
    of the loop against grains whose spins are blocked.

    >>> from loops import LinearFrictional, affine_tangent
    >>> from patterns import regular_polygon
    >>> A = affine_tangent(regular_polygon(5, strain=0.2), LinearFrictional(kn=1.0, kt=0.2))
    >>> [(one.subspace, one.status) for one in (judge(A), judge(A, "full"))]
    [('symmetric', 'stable'), ('full', 'unstable')]
    """
    number("rtol", rtol, 0.0)
    known = 0.0 if error is None else number("error", error, 0.0)
    if kn is not None:
        number("kn", kn, 0.0, open_low=True)
    if isinstance(K, MacroTangent):
        # A batch is refused below, where its shape is known.
        known = float(np.max(K.error, initial=0.0)) if error is None else known
        K, subspace = K.matrix, "symmetric" if subspace is None else subspace
    operator = as_operator(K) if subspace is None else restrict(K, subspace)
    if operator.ndim != 2:
        received = f"a batch of shape {operator.shape}"
        raise InputError(
            "operator",
            received,
            "one operator",
            "Judge one of them, or take stability.statuses for all.",
        )
    values, vectors = symmetric_modes(operator)
    eigenvalues = spectrum(operator)
    norm = float(operator_norm(operator))
    status = cast(VerdictStatus, statuses(values[0], norm, rtol, known).item())
    tolerance = rtol + known / norm if norm > 0.0 else rtol
    pairs = flutter_pairs(operator, tolerance)
    # A stable Ks excludes divergence exactly, whatever round-off at the tolerance.
    singular = (eigenvalues.real <= tolerance * norm) & ~pairs
    return Verdict(
        status=status,
        margin=float(values[0]) / norm if norm != 0.0 else 0.0,
        tolerance=tolerance,
        witness=_read_only(vectors[:, 0]),
        subspace=subspace or "given",
        divergence=bool(singular.any()) and status != "stable",
        flutter=bool(pairs.any()),
        eigenvalues=_read_only(eigenvalues),
        symmetric_eigenvalues=_read_only(values),
        kn=kn,
    )


def statuses(
    lambda_min: ArrayLike, norm: ArrayLike, rtol: float = RTOL, error: ArrayLike = 0.0
) -> NDArray[np.str_]:
    """Status of many operators at once, by the rule of `judge`.

    Parameters
    ----------
    lambda_min : array_like, shape (...)
        Smallest eigenvalue of each Ks.
    norm : array_like, shape (...)
        Frobenius norm of each K, in the same unit.
    rtol : float
        Half-width of the undetermined band, relative to the norm.
    error : array_like, shape (...)
        Error bound of each K, added to the band, in the unit of K: `MacroTangent.error`.

    Returns
    -------
    ndarray of str, shape (...)
        'stable', 'unstable', or 'undetermined' (in the band, or not finite).

    Examples
    --------
    >>> statuses([0.2, -0.2, 1e-14, float("nan")], 1.0).tolist()
    ['stable', 'unstable', 'undetermined', 'undetermined']
    >>> statuses(-0.2, 1.0, error=[0.1, 0.3]).tolist()
    ['unstable', 'undetermined']
    """
    smallest, size = np.asarray(lambda_min, np.float64), np.asarray(norm, np.float64)
    bound = np.asarray(error, np.float64)
    known = np.isfinite(smallest) & np.isfinite(size) & np.isfinite(bound)
    band = rtol * np.where(known, size, 0.0) + np.where(known, bound, 0.0)
    decided = [known & (smallest > band), known & (smallest < -band)]
    return np.select(decided, ["stable", "unstable"], "undetermined")


def _read_only(array: _Array) -> _Array:
    array = array.copy()
    array.setflags(write=False)
    return array


class LoopStability(NamedTuple):
    """Stability of loops; not a number where the tangent is not finite.

    `eigenvalues` (L, 3): Of Ks in the symmetric subspace (11, 22, (12 + 21)/sqrt 2), ascending
    (unit of the tangent); `unstable_fraction` (L,): Share of the directions of that subspace with
    negative second-order work; `cone_opening` (L,): Opening of the cone of negative second-order
    work in the plane (11, 22), radians; 0 if none; `soft_angle` (L,): Direction of the softest
    mode, radians in (-pi/2, pi/2], see `soft_angle`.
    """

    eigenvalues: Floats
    unstable_fraction: Floats
    cone_opening: Floats
    soft_angle: Floats


def loop_stability(tangents: Floats, *, compiled: bool = False) -> LoopStability:
    """Judge tangents in the symmetric subspace."""
    if compiled:
        from stability.compiled.modes import loop_modes

        values, softest, opening = loop_modes(np.ascontiguousarray(tangents), True)
    else:
        values, vectors = symmetric_modes(restrict(tangents, "symmetric"))
        softest = vectors[..., :, 0]
        opening = plane_cone(restrict(tangents, "diagonal")).opening
    # Most loops are stable: nothing to integrate.
    fraction = np.where(np.isnan(values[..., 0]), np.nan, 0.0)
    negative = values[..., 0] < 0
    fraction[negative] = unstable_fraction(values[negative])
    return LoopStability(values, fraction, opening, soft_angle(softest))


def loop_spectra(tangents: Floats, *, compiled: bool = False) -> Floats:
    """(L, 3) eigenvalues of Ks in the symmetric subspace alone, as `loop_stability` has them."""
    if compiled:
        from stability.compiled.modes import loop_modes

        return np.asarray(loop_modes(np.ascontiguousarray(tangents), False)[0])
    return symmetric_spectrum(restrict(tangents, "symmetric"))


def soft_angle(directions: Floats) -> Floats:
    """Direction of a strain without a sign: the axis of its principal value of larger size.

    A mode is known up to its sign. With the sign that makes this principal value a compression, the
    angle is that of the axis of compression. Of a pure shear both principal values have the same
    size: the angle is then that of either.
    """
    trace = directions[..., 0] + directions[..., 1]
    sign = np.where(trace < 0, -1.0, 1.0)
    difference = sign * (directions[..., 0] - directions[..., 1])
    # Adding zero turns -0 into 0: an angle of -pi/2 would lie outside the range.
    shear = sign * np.sqrt(2.0) * directions[..., 2] + 0.0
    return np.asarray(0.5 * np.arctan2(shear, difference))
