"""The macroscopic tangent operator with bounds on its error."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from loops.arrays import ROUNDING, Flags, Floats, all_finite, frobenius
from loops.errors import InputError
from loops.shown import Shown

Closure = Literal["affine", "traction"]
Spins = Literal["blocked", "affine", "free"]
# Limits within which a solve is trusted; see `MacroTangent`.
RESIDUAL_LIMIT = 1e-8
AMBIGUITY_LIMIT = 1e-6
# Beyond this share of the operator a bound of first order in rounding means nothing.
ERROR_LIMIT = 0.1


@dataclass(frozen=True, eq=False, repr=False)
class MacroTangent(Shown):
    """Macroscopic tangent `A` of a graph, `P' = A H'`, batch axes `...` first.

    Components in the order (11, 12, 21, 22); `P` is the nominal stress and `H` the displacement
    gradient on the reference, both positive in compression.

    Attributes
    ----------
    matrix : (..., 4, 4) array
        The operator (force per length). Not a number where `trusted` is false.
    closure : {'affine', 'traction'}
        How the surrounding medium drives the grains.
    spins : {'blocked', 'affine', 'free'}
        Rule of the grains' spins: held, turning with the loop, relaxed.
    volume : (...) array
        Reference area V0 (length squared).
    condition : (...) array
        Factor by which rounding of the data and of the solve is amplified, relative to the
        operator's norm: contacts that cancel, soft directions, gradients of a loop that left its
        reference, a polygon with next to no area, and the residual of the solve.
    residual : (...) array
        Relative residual of the solve; 0 where nothing is solved.
    trusted : (...) array of bool
        False where the solve has no answer (residual above 1e-8), more than one (a null vector of
        the system that changes the stress), or no digit left (error a tenth of the operator).
    sensitivity : (...) array
        Even loops with free spins: how far the smallest eigenvalue of Ks, in (11, 22) or in the
        symmetric subspace, goes to zero and beyond when two grains share the lever arms of their
        spins by the radii instead of by the point of contact, or the other way round, which
        moves them by less than the overlap (force per length). Loops of four change sign: their
        gear mode has next to no stiffness and next to no load. 0 where the change leads away
        from zero, and for odd loops.
    """

    matrix: Floats
    closure: Closure
    spins: Spins
    volume: Floats
    condition: Floats
    residual: Floats
    trusted: Flags
    sensitivity: Floats

    @property
    def rounding(self) -> Floats:
        """(...) bound on the error of the operator from rounding, `8 eps condition |A|`."""
        matrix = np.where(self.trusted[..., None, None], self.matrix, 0.0)
        size = frobenius(matrix)
        bound = ROUNDING * np.where(self.trusted, self.condition, 0.0) * size
        return np.where(self.trusted, bound, np.inf)

    @property
    def error(self) -> Floats:
        """(...) bound on the error of the operator, Frobenius (force per length).

        Bound on rounding plus `sensitivity`: an eigenvalue of Ks within it has no sign. Infinite
        where the operator is not trusted.
        """
        return self.rounding + self.sensitivity

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]:
        """The operator: numpy accepts a tangent as a matrix."""
        return np.array(self.matrix, dtype, copy=copy)

    def facts(self) -> dict[str, object]:
        """Names and values shown at the prompt and in a notebook."""
        good = f"{int(np.count_nonzero(self.trusted))} of {self.trusted.size}"
        condition = f"{np.max(self.condition, initial=1.0):.1e}"
        shape = self.matrix.shape
        return {"closure": self.closure, "spins": self.spins, "shape": shape, "trusted": good,
                "condition up to": condition}  # fmt: skip

    def __str__(self) -> str:
        good = int(np.count_nonzero(self.trusted))
        return (
            f"{self.closure} tangent, spins {self.spins}: {good} of {self.trusted.size} trusted, "
            f"condition up to {np.max(self.condition, initial=1.0):.1e}"
        )


def amplification(bound: Floats, matrix: Floats) -> Floats:
    """(...) error bound over rounding times the operator's norm, at least 1; 1 for a zero one."""
    size = ROUNDING * frobenius(matrix)
    with np.errstate(divide="ignore", invalid="ignore"):
        factor = np.where((size == 0) & (bound == 0), 1.0, bound / size)
    return np.where(np.isfinite(factor), np.maximum(factor, 1.0), np.inf)


def solved(
    matrix: Floats,
    closure: Closure,
    spins: Spins,
    volume: ArrayLike,
    condition: Floats,
    residual: ArrayLike = 0.0,
    ambiguity: ArrayLike = 0.0,
    sensitivity: ArrayLike = 0.0,
) -> MacroTangent:
    """Tangent from a solve; not a number where it is inconsistent, ambiguous or without a digit.

    `ambiguity` (...) is the largest relative stress of a null vector of the system.
    """
    trusted = all_finite(matrix)
    trusted &= (np.asarray(residual) <= RESIDUAL_LIMIT) & (np.asarray(ambiguity) <= AMBIGUITY_LIMIT)
    trusted &= ROUNDING * condition < ERROR_LIMIT
    matrix = np.where(trusted[..., None, None], matrix, np.nan)
    volume, condition, residual, sensitivity = (
        np.broadcast_to(a, trusted.shape) for a in (volume, condition, residual, sensitivity)
    )
    return MacroTangent(matrix, closure, spins, volume, condition, residual, trusted, sensitivity)


def check_choice(name: str, value: str, choices: tuple[str, ...]) -> None:
    """Raise `InputError` unless `value` is one of the choices."""
    if value not in choices:
        expected = " or ".join(repr(choice) for choice in choices)
        raise InputError(name, repr(value), expected, "Pick one of these.")
