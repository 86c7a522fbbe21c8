"""What the rate problem answers in each direction, one solution or several."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Answer:
    """Solutions in each of D directions, batch axes `...` first.

    Attributes
    ----------
    count : (..., D) array of int
        0 for none, 1, or 2 for several.
    work : (..., D, 2) array
        Smallest and largest W2 of the solutions, per unit strain rate; NaN where there is none.
    cosine : (..., D, 2) array
        Normalised second-order work of the same two solutions.
    regime : (..., D, C) array of int8
        Regimes of the solution with the smallest W2; -1 where there is none.
    """

    count: NDArray[np.int64]
    work: Floats
    cosine: Floats
    regime: NDArray[np.int8]


def one_answer(directions: Floats, stress: Floats, regime: NDArray[np.int8]) -> Answer:
    """Answer with one solution, of the stress rates (..., D, m), in each direction."""
    work, cosine = works(directions, stress)
    return Answer(
        count=np.ones(work.shape, dtype=np.int64),
        work=np.stack([work, work], axis=-1),
        cosine=np.stack([cosine, cosine], axis=-1),
        regime=regime,
    )


def works(directions: Floats, stress: Floats) -> tuple[Floats, Floats]:
    """W2 and its normalised form, 0 where there is no stress rate, along unit directions."""
    work = (directions * stress).sum(axis=-1)
    size = np.linalg.norm(stress, axis=-1)
    cosine = np.divide(work, size, out=np.zeros_like(work), where=size != 0.0)
    return work, np.clip(cosine, -1.0, 1.0)
