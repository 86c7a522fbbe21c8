"""What following a packing returns."""

from __future__ import annotations

from dataclasses import dataclass

from loops.arrays import Floats, Integers
from stability.packing.state import PackingState
from stability.paths.path import Event, PathStatus


@dataclass(frozen=True, eq=False)
class PackingPath:
    """What following a packing returns: a row at the start and wherever `rows` asks.

    Attributes
    ----------
    status : str
        'finished'; 'instabilities': stopped at the stated number of them, or at the first as asked;
        'control_limit': the control asks for ever more strain; 'no_solution': it moves nothing;
        'lost': forces or centres jumped, the system was singular, or the packing came to no rest
        after an instability; 'no_load': it has come apart. The last row is the state before.
    message : str
        The status in words.
    events : tuple of Event
        'yield', 'unloading', 'opening', 'closing', and 'instability': no regimes of the contact
        agree; `detail` has the mode, how it was passed and the energy that its grains released
        until the interval ended. `index` is the row before. Of an interval that was taken back
        none stay, unless the path is lost: those tell what led there, beyond the last row.
        Contacts are numbered as in the states: those of the graph first.
    parameter, stage : (R,) array
        Loading parameter since the start, and stage.
    H, P : (R, 4) array
        Displacement gradient and nominal stress, over the reference cell; 11, 12, 21, 22.
    states : tuple of PackingState
        The packing at every row.
    work : (R, 4) array
        External work `Int V0 P:H'`, of what was out of balance at the start as well; slip; what the
        law's shear increment leaves of `T` times the motion at the contact (`branch`: next to
        nothing); and the work of what is out of balance, at instabilities and by rattlers. The
        first is the change of `energy` and the other three, to rounding (Theory, equations
        (11.12) and (11.13)).
    energy : (R,) array
        Of the springs, `sum N^2/(2 kn) + T^2/(2 kt)`.
    imbalance : (R,) array
        Largest drift of a grain's resultant over the mean contact force.
    intervals : int
        Intervals walked.
    """

    status: PathStatus
    message: str
    events: tuple[Event, ...]
    parameter: Floats
    stage: Integers
    H: Floats
    P: Floats
    states: tuple[PackingState, ...]
    work: Floats
    energy: Floats
    imbalance: Floats
    intervals: int

    def __len__(self) -> int:
        return len(self.parameter)

    def of_kind(self, kind: str) -> tuple[Event, ...]:
        """Events of one kind."""
        return tuple(event for event in self.events if event.kind == kind)
