"""The paper's equations, each against an independent derivation: how far the two lie apart."""

from __future__ import annotations

from studies.paper.contact_equations import contact_residuals
from studies.paper.tangent_equations import tangent_residuals


def equation_residuals() -> dict[str, float]:
    """Largest difference of each group of equations from its independent derivation.

    Returns
    -------
    dict of str to float
        By the equations' numbers; relative where the quantity has a size of its own.

    Examples
    --------
    >>> from studies.paper.equations import equation_residuals
    >>> max(equation_residuals().values()) < 1e-11
    True
    """
    return contact_residuals() | tangent_residuals()
