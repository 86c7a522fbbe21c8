"""Ways past an instability: what a packing does where no regimes of a contact agree.

All but springs on the ground, which act within an interval, are functions of the point at its end,
of the instability and of a control, and answer with how it was passed. One of your own can be given
to `follow` as `past`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

from loops.arrays import Floats
from loops.contacts import Contacts
from stability.packing.equations_of_motion import snap_through
from stability.packing.point import RELEASED, PackingPoint
from stability.packing.yielding import MixedControl
from stability.path import Event, How, Past


class Passed(NamedTuple):
    """Outcome of an instability: the state at rest behind it, or a message why there is none.

    `work` (4,) is that of the motion, as `Path.work`.
    """

    how: How
    state: Contacts | None = None
    work: Floats | None = None
    message: str = ""

    @property
    def released(self) -> float:
        """Energy that the motion released; nan if there was none."""
        return math.nan if self.work is None else float(self.work[RELEASED])


@dataclass(frozen=True)
class Viscous:
    """Drag the grains of the mode by springs on the ground; hold the contact if none is left.

    `stiffness` multiplies the springs of `strain_increment`.
    """

    stiffness: float = 1.0


# What is done past an instability; the control is the whole change of stress and strain ahead.
PassBy = Viscous | Callable[[PackingPoint, Event, MixedControl], Passed]


@dataclass(frozen=True)
class Dynamic:
    """Follow the equations of motion through the rest of the interval, then until rest.

    `damping` is Cundall's.
    """

    damping: float = 0.3

    def __call__(self, here: PackingPoint, instability: Event, control: MixedControl) -> Passed:
        """Return the packing at rest."""
        try:
            end, work = snap_through(here.state, here.load, control, self.damping)
            jump = here.jump_to(end)
            if jump:
                raise ArithmeticError(jump)
        except ArithmeticError as error:
            return Passed("lost", message=str(error))
        return Passed("replayed", end, work)


def stop(here: PackingPoint, instability: Event, control: MixedControl) -> Passed:
    """End the path at its first instability."""
    return Passed("stopped")


WAYS: dict[str, PassBy] = {"viscous": Viscous(), "dynamic": Dynamic(), "stop": stop}
# The same ways with three times the springs, and with a third of the damping: the stress of a path
# past instabilities is known to the difference (docs/knobs.md).
OTHER_WAYS: dict[PassBy, PassBy] = {
    Viscous(): Viscous(stiffness=3.0),
    Dynamic(): Dynamic(damping=0.1),
}


def past_of(way: Past | PassBy) -> PassBy:
    """Return the function for what is done past instabilities, which options give by its name."""
    return WAYS[way] if isinstance(way, str) else way
