"""The macroscopic tangent operator with what is known of its accuracy."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from loops.arrays import Flags, Floats
from loops.errors import InputError

Closure = Literal["affine", "traction"]
Spins = Literal["blocked", "affine", "free"]

# A solve is trusted while these hold; see `MacroTangent`.
RESIDUAL_LIMIT = 1e-8
AMBIGUITY_LIMIT = 1e-6

# Unit of rounding times what a few operations per entry make of it; against 50 digits the error of
# operators and eigenvalues stays below half of this times the condition.
ROUNDING = 8 * float(np.finfo(np.float64).eps)


@dataclass(frozen=True, eq=False)
class MacroTangent:
    """Macroscopic tangent `A` of a graph, `P' = A H'`, batch axes `...` first.

    Components in the order (11, 12, 21, 22); `P` is the nominal stress and `H` the displacement
    gradient on the reference, both positive in compression (theory note, section 4).

    Attributes
    ----------
    matrix : (..., 4, 4) array
        The operator (force per length). Not a number where `trusted` is false.
    closure : {'affine', 'traction'}
        How the surrounding medium drives the grains.
    spins : {'blocked', 'affine', 'free'}
        What the grains' spins do.
    volume : (...) array
        Reference area V0 (length squared).
    condition : (...) array
        Factor by which the solve may amplify rounding errors of its data, relative to the
        operator's norm; 1 where nothing is solved.
    residual : (...) array
        Relative residual of the solve; 0 where nothing is solved.
    trusted : (...) array of bool
        False where the solve has no answer (residual above 1e-8), more than one (a null vector of
        the system that changes the stress), or no digit left (`error` as large as the operator).
    """

    matrix: Floats
    closure: Closure
    spins: Spins
    volume: Floats
    condition: Floats
    residual: Floats
    trusted: Flags

    @property
    def error(self) -> Floats:
        """(...) bound on the error of the operator from rounding, Frobenius (force per length).

        `8 eps condition |A|`: an eigenvalue of Ks within it has no sign. Infinite where the
        operator is not trusted.
        """
        size = np.linalg.norm(
            np.where(self.trusted[..., None, None], self.matrix, 0.0), axis=(-2, -1)
        )
        bound = ROUNDING * np.where(self.trusted, self.condition, 0.0) * size
        return np.where(self.trusted, bound, np.inf)

    def __str__(self) -> str:
        good = int(np.count_nonzero(self.trusted))
        return (
            f"{self.closure} tangent, spins {self.spins}: {good} of {self.trusted.size} trusted, "
            f"condition up to {np.max(self.condition, initial=1.0):.1e}"
        )


def solved(
    matrix: Floats,
    closure: Closure,
    spins: Spins,
    volume: Floats,
    condition: Floats,
    residual: Floats,
    ambiguity: Floats,
) -> MacroTangent:
    """Tangent from a solve; not a number where it is inconsistent, ambiguous or without a digit.

    Parameters
    ----------
    matrix, closure, spins, volume, condition, residual
        As in `MacroTangent`.
    ambiguity : (...) array
        Largest relative stress of a null vector of the system, 0 if there is none.

    Returns
    -------
    MacroTangent
        With `trusted` filled in.
    """
    finite = np.isfinite(matrix).all(axis=(-1, -2))
    trusted = finite & (residual <= RESIDUAL_LIMIT) & (ambiguity <= AMBIGUITY_LIMIT)
    trusted = trusted & (ROUNDING * condition < 1.0)
    matrix = np.where(trusted[..., None, None], matrix, np.nan)
    volume = np.broadcast_to(volume, trusted.shape)
    return MacroTangent(matrix, closure, spins, volume, condition, residual, trusted)


def check_choice(name: str, value: str, choices: tuple[str, ...]) -> None:
    """Raise `InputError` unless `value` is one of the choices.

    Parameters
    ----------
    name : str
        Name of the argument.
    value : str
        What was given.
    choices : tuple of str
        What may be given.

    Raises
    ------
    InputError
        If it is none of them.
    """
    if value not in choices:
        expected = " or ".join(repr(choice) for choice in choices)
        raise InputError(name, repr(value), expected, "Pick one of these.")
