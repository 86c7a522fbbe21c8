"""A point of the path of a packing: its state between two intervals, which replace it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple, Self

import numpy as np

from loops.arrays import Flags, Floats, Regimes
from loops.contacts import AT_YIELD, Contacts
from stability.packing.regime_factor import ELASTIC, OPEN, SLIDING
from stability.path import Event
from stability.programmes import MixedControl, Stage

if TYPE_CHECKING:
    from stability.compiled.packing_system import Order
    from stability.path import Pathologies

# Pairs closer than this share of the mean diameter may close: they are listed, as open contacts.
MAY_CLOSE_GAP = 0.01
# Columns of `Path.work` after that of the control.
SLIP = 1
INCREMENT = 2
RELEASED = 3
# Largest change of the stress in an interval, over itself: beyond, the interval met a jump.
JUMP = 0.5
# Largest motion of a centre against the others in an interval, over the mean diameter.
LEAP = 0.02


class Leg(NamedTuple):
    """A stage on its way: strains, stresses and the loading parameter are measured from here."""

    number: int
    stage: Stage
    parameter: float
    H: Floats
    P: Floats


@dataclass(frozen=True, eq=False, repr=False)
class PackingPoint:
    """A packing on its path, with the rows and events so far.

    `regime` and `side` are of the pairs, then of their springs against rolling. Grains that carry
    nothing, `rattlers` (B,), go on by `coast` (B, 2) a unit of the loading parameter; up to
    `free_share` of the last interval none of them was caught. A load balances `load_share` of the
    resultants of the start, `carried` (B, 3). Centres have `wandered` so far since pairs were
    listed. `slowest` is the least strain speed of the stage; rows are left to record at the
    `targets` of its quantity. `order` is that of the factor before, `first_stress` the norm of the
    stress at the start.
    """

    state: Contacts
    regime: Regimes
    side: Floats
    rattlers: Flags
    carried: Floats
    leg: Leg
    coast: Floats
    F: Floats
    work: Floats
    first_stress: float
    free_share: float = 1.0
    load_share: float = 1.0
    wandered: float = 0.0
    parameter: float = 0.0
    intervals: int = 0
    slowest: float = np.inf
    targets: tuple[float, ...] = ()
    rows: tuple[dict[str, Any], ...] = ()
    events: tuple[Event, ...] = ()
    order: Order | None = None

    @classmethod
    def at_start(cls, state: Contacts, rattlers: Flags, stage: Stage, first_stress: float) -> Self:
        """Return the point at which a path starts, its grains without load out of the system."""
        leg = Leg(0, stage, 0.0, np.zeros(4), state.stress.ravel())
        found = *regimes_of(state), rattlers, state.resultants, leg, np.zeros_like(state.x)
        return cls(state, *found, np.eye(2), np.zeros(4), first_stress)

    def begun(self, number: int, stage: Stage) -> Self:
        """Measure strains, stresses and the loading parameter of a stage from here."""
        leg = Leg(number, stage, self.parameter, self.H, self.P)
        return replace(self, leg=leg, slowest=np.inf)

    def listed(self) -> Self:
        """Add the pairs that are close to the list, as open contacts."""
        state = self.state.with_near(self.listed_gap)
        springs, known = state.law.springs, len(self.regime)
        fresh = np.zeros((springs, len(state.contacts) - known // springs))
        regimes = np.hstack([self.regime.reshape(springs, -1), fresh + OPEN])
        regime = regimes.astype(np.int8).ravel()
        side = np.hstack([self.side.reshape(springs, -1), fresh]).ravel()
        return replace(self, state=state, regime=regime, side=side, wandered=0.0)

    # ---- geometry and forces

    @property
    def listed_gap(self) -> float:
        """Gap up to which pairs are listed."""
        return MAY_CLOSE_GAP * 2.0 * self.state.mean_radius

    @property
    def absent(self) -> Flags:
        """(C,) pairs of grains that carry nothing."""
        return np.asarray(self.rattlers[self.state.contacts].any(axis=1))

    @property
    def H(self) -> Floats:
        """(4,) displacement gradient."""
        return (np.eye(2) - self.F).ravel()

    @cached_property
    def P(self) -> Floats:
        """(4,) nominal stress over the reference cell."""
        return self._to_reference @ self.state.stress.ravel()

    @cached_property
    def _to_reference(self) -> Floats:
        """`P0 = (V/V0) P F^-T` on the components."""
        whole, now = (abs(float(np.linalg.det(c))) for c in (self.state.cell0, self.state.cell))
        return now / whole * np.kron(np.eye(2), np.linalg.inv(self.F))

    @cached_property
    def _turned(self) -> Floats:
        """`H0' = H' F` on the components."""
        return np.asarray(np.kron(np.eye(2), self.F.T))

    @property
    def load(self) -> Floats:
        """(B, 3) forces and moments that still balance resultants of the start."""
        return -self.load_share * self.carried

    @property
    def imbalance(self) -> Floats:
        """(B, 3) resultants that no load balances."""
        return self.state.resultants + self.load

    def jump_to(self, after: Contacts) -> str:
        """Tell the jump of the stress or of a centre in a short strain; empty if there is none."""
        # Near zero stress the change is measured by the stress of the start; contacts that pull
        # cancel others in the stress, and count besides.
        size = max(float(np.linalg.norm(self.state.stress)), self.first_stress) + self.state.pull
        change = np.linalg.norm(after.stress - self.state.stress) / size
        if not change < JUMP:
            return f"the stress jumped by {change:.2g} of what it was"
        beyond = after.x - self.state.x @ (after.cell @ np.linalg.inv(self.state.cell)).T
        carries = np.bincount(after.contacts[after.closed].ravel(), minlength=len(beyond)) > 1
        leap = np.abs(beyond[carries]).max(initial=0.0) / (2.0 * after.mean_radius)
        return f"a grain leapt by {leap:.2g} diameters" if leap > LEAP else ""

    # ---- the stage

    @property
    def quantity(self) -> float:
        """The quantity whose target ends the stage."""
        return self.leg.stage.value(self.H, self.P, self.parameter - self.leg.parameter)

    @property
    def done(self) -> Floats:
        """Change of the controlled values (4,) since the start of the stage."""
        values, leg = self.leg.stage.programme.values, self.leg
        return values(self.H, self.P) - values(leg.H, leg.P)

    def control(self, correction: float = 0.0) -> MixedControl:
        """The programme on rates in this geometry; its error is made good at a rate."""
        stress, strain, rate = self.leg.stage.programme.equations(self.H, self.P)
        if correction:
            asked = rate * (self.parameter - self.leg.parameter)
            rate = rate - correction * (self.done - asked)
        return MixedControl(stress @ self._to_reference, strain @ self._turned, rate)

    def control_to(self, parameter: float) -> MixedControl:
        """The whole change of stress and strain to a later loading parameter."""
        rate = self.leg.stage.programme.rate
        whole = rate * (parameter - self.leg.parameter) - self.done
        return self.control()._replace(rate=whole)

    def speed(self, strain_rate: Floats, stress_rate: Floats) -> float:
        """Return the rate of the stage's quantity under rates (4,) in this geometry."""
        rates = self._turned @ strain_rate, self._to_reference @ stress_rate
        return self.leg.stage.value(*rates, 1.0)

    # ---- what is kept of the path

    def with_events(self, events: Sequence[Event], released: Floats | None = None) -> Self:
        """Add events after this state, those of grains (B,) with the energy that these released."""
        left = None if released is None else released.copy()
        placed = []
        for event in events:
            if event.grains and left is not None:
                grains = list(event.grains)
                event = replace(event, released=float(left[grains].sum()))
                # The energy of a grain belongs to its first instability.
                left[grains] = 0.0
            parameter = self.parameter + event.parameter
            index = sum(one["parameter"] <= parameter for one in self.rows) - 1
            placed.append(replace(event, parameter=parameter, stage=self.leg.number, index=index))
        return replace(self, events=(*self.events, *placed)) if placed else self

    def recorded(self, **more: Pathologies) -> Self:
        """Add a row."""
        state = self.state
        row = {
            "parameter": self.parameter,
            "stage": self.leg.number,
            "H": self.H,
            "P": self.P,
            "states": state,
            "work": self.work,
            "energy": state.stored_energy,
            "imbalance": np.abs(self.imbalance)[:, :2].max() / state.mean_force,
        }
        return replace(self, rows=(*self.rows, row | more))


def regimes_of(state: Contacts) -> tuple[Regimes, Floats]:
    """Return regimes and sides: closed contacts on the friction limit slide, as their force."""
    law = state.law
    T = law.of_springs(state.shear_force, state.rolling_moment)
    most = law.of_springs(state.strength, state.rolling_strength)
    slides = np.abs(T) >= AT_YIELD * most
    closed = np.resize(state.closed, len(T))
    regime = np.where(closed, np.where(slides, SLIDING, ELASTIC), OPEN)
    return regime.astype(np.int8), np.sign(T)
