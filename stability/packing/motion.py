"""A motion of a packing from an equilibrium that was lost."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from loops.arrays import Floats, Integers
from loops.shown import Shown

MotionStatus = Literal["at rest", "no rest"]
# Grains that move by this share of the largest displacement take part in a mode.
TAKES_PART = 0.1


@dataclass(frozen=True, eq=False, repr=False)
class Motion(Shown):
    """A motion from an equilibrium that was lost, under a constant load.

    Attributes
    ----------
    status : {'at rest', 'no rest'}
        'at rest': the packing found another equilibrium under the same load. 'no rest': it strained
        by more than 0.02, or still moved after 60,000 steps.
    lost, load : float
        Stress along the direction, less that of the start, where the equilibrium was lost, and the
        load under which it moved: a two-hundredth more.
    cause : str
        Why the equilibrium was lost.
    contact : int
        Contact without agreeing regimes; -1 where the control met its limit.
    strain : (4,) array
        Displacement gradient of the cell in the motion, 11, 12, 21, 22.
    released : float
        Energy that damping took, and that the motion still had (force times length).
    kinetic : float
        Largest kinetic energy at a look at the motion, all grains having the mean mass of discs of
        unit density.
    steps : int
        Steps of the motion.
    displacement : (G, 2) array
        Of the grains beyond the affine motion until the strain was 2e-5, or until rest: the mode.
    opened, closed, slid : int
        Contacts that opened or closed in the mode, and that slide at its end and did not before.
    loop_work : (L,) array
        Area times additive work `w` of each loop in the mode (force times length).
    """

    status: MotionStatus
    lost: float
    load: float
    cause: str
    contact: int
    strain: Floats
    released: float
    kinetic: float
    steps: int
    displacement: Floats
    opened: int
    closed: int
    slid: int
    loop_work: Floats

    @property
    def grains(self) -> Integers:
        """Grains that move by at least a tenth of the largest displacement."""
        size = np.linalg.norm(self.displacement, axis=1)
        return np.flatnonzero(size >= TAKES_PART * size.max())
