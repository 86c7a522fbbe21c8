"""Everything there is to know of one state of a path, for its record and for its events."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from loops.arrays import Floats
from loops.contact_state import ContactState
from loops.laws.frictional import edge_rates
from loops.laws.protocol import Regime
from stability.paths.equations import (
    Equations,
    closure_equations,
    closure_kind,
    control_system,
    is_trusted,
    solve_rates,
    stress_of_strain,
)
from stability.paths.model import PathModel
from stability.paths.rates import Rates, contact_rates, forces, power, stress, velocities
from stability.paths.state import (
    Mode,
    PathState,
    centres,
    contacts_of,
    displacement_gradient,
    pack,
    with_signs,
)
from stability.paths.unknowns import Kind
from stability.programmes import Programme

# Loops longer than this are not searched for branching points.
MOST_GRAINS = 60


@dataclass(frozen=True, eq=False)
class Look:
    """A state in given regimes under a programme, with what follows from it when it is asked.

    The gauge fixes the unit of time of the rates: a row on `(H', parameter')` that is one.
    """

    model: PathModel
    state: PathState
    mode: Mode
    programme: Programme
    gauge: Floats

    @cached_property
    def H(self) -> Floats:
        """(4,) displacement gradient."""
        return displacement_gradient(self.model, self.state.place)

    @cached_property
    def P(self) -> Floats:
        """(4,) nominal stress."""
        return stress(self.model, self.contacts)

    @cached_property
    def x(self) -> Floats:
        """(G, 2) centres."""
        return centres(self.model, self.state.place)

    @cached_property
    def contacts(self) -> ContactState:
        """Contacts with their forces."""
        return contacts_of(self.model, self.state, self.mode)

    @cached_property
    def signed(self) -> ContactState:
        """Contacts with the signs of `T` that the law reads."""
        return with_signs(self.contacts, self.mode)

    @cached_property
    def kind(self) -> Kind:
        """Closure equations that serve."""
        return closure_kind(self.model, self.signed, self.mode.regime)

    @cached_property
    def equations(self) -> Equations:
        """Those of the closure."""
        return self._equations(self.kind)

    def _equations(self, kind: Kind) -> Equations:
        return closure_equations(self.model, self.H, self.signed, self.mode.regime, kind)

    @cached_property
    def raw_rates(self) -> Rates:
        """Rates in the unit of time of the gauge.

        The loading parameter is an unknown like the others, so a limit of the control
        (`parameter' = 0`) is an ordinary point unless the gauge is that parameter.
        """
        model, law, equations = self.model, self.model.law, self.equations
        unknowns, control = model.unknowns[self.kind].rates, self.programme.equations(self.H)
        z, parameter, found = solve_rates(model, equations.matrix, unknowns, control, self.gauge)
        motion = model.length * (equations.motion @ z)
        if model.spins != "blocked":
            motion[:, 2:] /= model.radii[model.contacts]
        D = law.local_stiffness(self.signed, self.mode.regime)
        return Rates(
            z[:4],
            z[4:8] * model.stiffness,
            parameter,
            *contact_rates(model, self.contacts, D, motion),
            motion,
            np.inf if found is None else float(found.condition),
            is_trusted(found),
        )

    @cached_property
    def rates(self) -> Rates:
        """Rates per unit length of the path in the space of `H`, `|H'| = 1`.

        The arc length is a regular parameter where the loading parameter turns back.
        """
        return self.raw_rates.scaled(1.0 / float(np.linalg.norm(self.raw_rates.H)))

    @cached_property
    def y_rates(self) -> Floats:
        """Right-hand side `y'` per unit length of the path; not numbers if it is not trusted."""
        model, rates = self.model, self.rates
        place = rates.H if model.closure == "affine" else velocities(model, rates)
        work = power(model, self.mode, self.contacts, rates)
        y = pack(place, rates.shear_force, rates.parameter, work)
        return y if rates.trusted else np.full_like(y, np.nan)

    @cached_property
    def A(self) -> Floats:
        """(4, 4) macroscopic tangent, `P' = A H'`, in these regimes; nan if not trusted."""
        blocks = self.model.unknowns[self.kind].tangent
        parts = [stress_of_strain(self.equations.matrix, unknowns) for unknowns in blocks]
        return np.asarray(sum(parts[1:], parts[0]) * self.model.stiffness)

    @cached_property
    def slip(self) -> Floats:
        """(C,) how fast contacts at yield would leave the cone if they stuck.

        Positive when a contact must slide, negative when it must not; minus infinity where it never
        slides.
        """
        side = np.where(self.mode.side != 0.0, self.mode.side, np.sign(self.contacts.shear_force))
        rates, law = self.rates, self.model.law
        _, sticking, strength = edge_rates(law, self.signed, side, rates.un, rates.ut)
        return np.asarray(np.where(side == 0.0, 1.0, side) * sticking - strength)

    @cached_property
    def branching(self) -> float:
        """A number that changes its sign where other paths branch off.

        The determinant of the grains' balance, control and gauge together, its root of the order of
        their number. At a limit of the control it does not vanish.
        """
        model = self.model
        small = model.grain_count <= MOST_GRAINS and (self.mode.regime != Regime.OPEN).all()
        if model.closure == "affine" or model.spins == "free" or not small:
            return np.nan
        matrix, everything = self._equations("saddle").matrix, model.unknowns["saddle"].everything
        control = self.programme.equations(self.H)
        system, _ = control_system(model, matrix, everything, control, self.gauge)
        sign, size = np.linalg.slogdet(system)
        return float(sign * np.exp(size / len(system)))

    @cached_property
    def imbalance(self) -> float:
        """Largest force on a grain that `-P b_i` leaves unbalanced, over `kn` times length.

        Not a number under the affine closure, which does not balance the grains.
        """
        model = self.model
        if model.closure == "affine":
            return np.nan
        i, j = model.contacts.T
        f = forces(self.contacts)
        unbalanced = -model.b @ self.P.reshape(2, 2).T
        np.add.at(unbalanced, i, -f)
        np.add.at(unbalanced, j, f)
        return float(np.abs(unbalanced).max() / (model.stiffness * model.length))
