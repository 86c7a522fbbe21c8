"""Rates of a state under a control: those of the kernels, or of the closure system by numpy."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.linalg import block_diag

from loops.arrays import Floats
from loops.assembly import motions
from loops.closures.null_space import (
    AMBIGUITY_LIMIT,
    RESIDUAL_LIMIT,
    LeastSquares,
    solve_through_null_space,
)
from loops.closures.ring import BI, BJ, DNN, DTT, LENGTH, NX, NY, G
from loops.closures.spins import LoopSpin, gear_projector, spin_of_gradient
from loops.closures.system import closure_matrix, contact_springs, drive
from loops.graph import ContactState
from loops.laws.compiled import PressedContacts
from loops.laws.frictional import Regime, with_sides
from stability.paths import ring_rates as ring
from stability.paths.kernels import NO_FUNCTIONS, EventFunctions, answer, arrays_of, law_is_given
from stability.paths.model import PathModel, Unknowns, all_unknowns
from stability.paths.state import Mode, Rates, centres, closest_pair, with_forces
from stability.programmes import Programme

# Stresses of strains that mirrors in the axes keep apart, in 11, 12, 21, 22.
MIXED = np.array([0, 1, 1, 0]) != np.array([0, 1, 1, 0])[:, None]
# Gauge in which the loading parameter grows by one per unit of time, see `StateRates`.
UNIT_PARAMETER: Floats = np.array([0.0, 0.0, 0.0, 0.0, 1.0])


class Answers:
    """Rates and event functions in these regimes, as a segment asks for them.

    Kernels solve rings. What is no ring, or has null vectors, numpy solves by the closure system,
    and free spins where contacts roll against springs, slide or are open: moments on grains that
    roll along with each other may be left that nothing balances.
    """

    def __init__(
        self, model: PathModel, mode: Mode, programme: Programme,
        events: EventFunctions = NO_FUNCTIONS,
    ) -> None:  # fmt: skip
        self.model, self.mode, self.programme = model, mode, programme
        arrays = arrays_of(model, mode.regime, mode.side, programme, events)
        self.numbers, self.whole, self.p = arrays
        self.given = law_is_given(model)
        if type(programme) is not Programme:
            # Its equations are written as they are, see `reply`.
            self.p.codes[[ring.ISOCHORIC, ring.CAUCHY]] = -1

    @property
    def compiled(self) -> bool:
        """Whether kernels know all but null vectors."""
        return not self.given and type(self.programme) is Programme and self._by_ring

    @cached_property
    def contacts(self) -> ContactState:
        """Contacts of the state with their forces."""
        self._call(ring.GEOMETRY)
        model, table = self.model, self.p.table
        n, length, depth = table[:, NX : NY + 1].copy(), table[:, LENGTH], table[:, ring.OVERLAP]
        t, none = np.stack([-n[:, 1], n[:, 0]], axis=-1), np.zeros(len(n))
        T, (r_i, r_j) = self.p.shared[0, model.shears].copy(), model.radii[model.contacts].T
        bare = PressedContacts(length.copy(), n, t, none, T, r_i, r_j, depth=depth.copy())
        return with_forces(model.law, bare, self.mode)

    @cached_property
    def _by_ring(self) -> bool:
        model, regime = self.model, self.mode.regime
        if model.spins != "free" or not model.is_ring:
            return model.is_ring
        rolls = self.given and np.any(model.law.rolling_stiffness(self.contacts, regime))
        return not rolls and bool((regime == Regime.ELASTIC).all())

    def reply(self, what: int) -> None:
        """Answer what is asked for at the state and the gauge that are shared, see `Problem`."""
        p, y = self.p, self.p.shared[0, : self.model.size]
        p.shared[2], p.small[ring.SOLUTION, ring.TRUSTED] = np.nan, 1.0
        p.shared[2, -1] = 1.0
        if not np.isfinite(y).all():
            # Beside a singular state a trial may have left the numbers.
            return
        with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
            vars(self).pop("contacts", None)
            if type(self.programme) is not Programme:
                self._ask(ring.PLACE)
                H, P = p.small[[ring.H, ring.P], :4]
                stress, strain, rate = self.programme.equations(H, P)
                p.small[ring.STRESS : ring.STRESS + 4, :4] = stress
                p.small[ring.STRAIN : ring.STRAIN + 4, :4] = strain
                p.small[ring.RATE, :4] = rate
            if self._by_ring and self._ask(what):
                return
            if self._solve(what) or what != ring.RATES:
                self._ask(ring.SOLVED + what)
            if what == ring.VALUES and not self.model.is_ring:
                # The last event function, see `event_functions`.
                x = centres(self.model, y)
                p.shared[2, len(p.watch) - 1] = closest_pair(self.model, x)

    def _ask(self, what: int) -> bool:
        """Call the kernels, which know all but the forces of other laws; whether they answer."""
        if self.given and what < ring.SOLVED:
            self._give_law()
        self._call(what)
        return bool(self.p.shared[2, -1])

    def _call(self, what: int) -> None:
        answer().call(what, self.numbers.ctypes.data, self.whole.ctypes.data)

    def _give_law(self) -> None:
        """Write what the law makes of the contacts."""
        table, law, contacts = self.p.table, self.model.law, self.contacts
        sticking = np.full(len(table), Regime.ELASTIC, dtype=np.int8)
        elastic = law.local_stiffness(contacts, sticking)
        D = law.local_stiffness(self._sided(contacts), self.mode.regime)
        table[:, DNN : DTT + 1] = D.reshape(-1, 4)
        table[:, ring.NOW_KN], table[:, ring.NOW_KT] = elastic[:, 0, 0], elastic[:, 1, 1]
        table[:, ring.COUPLING], table[:, ring.STRENGTH] = elastic[:, 1, 0], law.strength(contacts)
        table[:, ring.NORMAL], table[:, ring.SHEAR] = contacts.normal_force, contacts.shear_force
        table[:, ring.OPENS] = -contacts.overlap - law.gap(contacts)
        table[:, G], table[:, BI], table[:, BJ] = law.shear_kinematics(contacts)

    def _sided(self, contacts: ContactState) -> ContactState:
        """Contacts whose `T` has the sign of the side on which they slide.

        One that slides from its first touch has a side before it has a shear force.
        """
        mode = self.mode
        return with_sides(contacts, np.where(mode.regime == Regime.SLIDING, mode.side, 0.0))

    def _solve(self, what: int) -> bool:
        """Solve the closure system for rates and tangent; whether the rates have one answer."""
        model, p, contacts = self.model, self.p, self.contacts
        self._ask(ring.PLACE)
        unit, solution, sided = model.stiffness, p.small[ring.SOLUTION], self._sided(contacts)
        matrix, A = closure_equations(model, p.small[ring.H, :4], sided, self.mode)
        if what >= ring.VALUES:
            tangent = p.small[ring.TANGENT : ring.TANGENT + 4, :4]
            tangent[:] = unit * stress_of_strain(matrix)
            if model.mirrors:
                # What is not a number stays so.
                tangent[MIXED] -= tangent[MIXED]
            solution[ring.BALANCE] = self._balance(matrix)
        fields = model.unknowns.fields
        system = self._controlled(matrix, model.unknowns)
        scale, rhs = np.abs(system[-1]).max(), np.zeros((len(system), 1))
        system[-1] /= scale
        rhs[-1] = 1.0 / scale
        found = solve_through_null_space(system, rhs, block_diag(fields[:8], 1.0))
        z = block_diag(fields, 1.0) @ found.x[:, 0]
        p.small[ring.H_RATE, :4], p.small[ring.P_RATE, :4] = z[:4], unit * z[4:8]
        solution[ring.PARAMETER_RATE] = solution[ring.PARAMETER_UNIT] * z[-1]
        solution[ring.CONDITION] = found.condition
        moved = A @ z[:4] + motions(z[8:-1, None], model.form.ends)[..., 0]
        moved *= model.length
        spins = moved[:, 2:] / model.radii[model.contacts]
        _, b_i, b_j = model.law.shear_kinematics(contacts)
        p.table[:, ring.EN] = (contacts.n * moved[:, :2]).sum(axis=1)
        p.table[:, ring.ET] = (contacts.t * moved[:, :2]).sum(axis=1)
        p.table[:, ring.SPUN] = b_i * spins[:, 0] + b_j * spins[:, 1]
        p.table[:, ring.SPIN_I : ring.SPIN_J + 1] = spins
        solution[ring.TRUSTED] = is_trusted(found)
        return is_trusted(found)

    def _controlled(self, matrix: Floats, unknowns: Unknowns) -> Floats:
        """Closure, control and gauge as one system.

        In a symmetric state only as many combinations of the control are kept as there are strains.
        The other rows agree with them, and near a singular state they hold nothing but the rounding
        of the forces times the compliance.
        """
        small, gauge = self.p.small, self.p.shared[1]
        control = small[ring.CONTROL : ring.CONTROL + 4]
        held = np.column_stack([control[:, :8] @ unknowns.fields[:8], control[:, 8]])
        if unknowns.strains < 4:
            held = np.linalg.svd(held)[0][:, : unknowns.strains].T @ held
        reduced = unknowns.rows @ matrix @ unknowns.fields
        equations = np.column_stack([reduced, np.zeros(len(reduced))])
        parameter = gauge[4] * small[ring.SOLUTION, ring.PARAMETER_UNIT]
        return np.vstack([equations, held, np.append(gauge[:4] @ unknowns.fields[:4], parameter)])

    def _balance(self, matrix: Floats) -> float:
        """Return what `balance_of_ring` does of a ring."""
        model = self.model
        open_or_long = (self.mode.regime == Regime.OPEN).any()
        open_or_long |= model.grain_count > ring.MOST_GRAINS
        if model.closure == "affine" or model.spins == "free" or open_or_long:
            return np.nan
        system = self._controlled(matrix, all_unknowns(len(matrix) - 4))
        sign, size = np.linalg.slogdet(system)
        return float(sign * np.exp(size / len(system)))


@dataclass(frozen=True, eq=False)
class StateRates:
    """State and regimes under a programme; derived quantities are computed on first use.

    `y` (Y,): Integrated variables, see `PathModel`. The gauge fixes the unit of time of the rates:
    its product with `(H', parameter')` is one.
    """

    model: PathModel
    y: Floats
    mode: Mode
    programme: Programme
    gauge: Floats

    @property
    def H(self) -> Floats:
        """(4,) displacement gradient."""
        return self.solved.small[ring.H, :4]

    @property
    def P(self) -> Floats:
        """(4,) nominal stress."""
        return self.solved.small[ring.P, :4]

    @property
    def parameter(self) -> float:
        """Loading parameter."""
        return float(self.y[-5])

    @cached_property
    def x(self) -> Floats:
        """(G, 2) centres."""
        return centres(self.model, self.y)

    @cached_property
    def answers(self) -> Answers:
        """Rates, contacts and events of this state by kernels or numpy, each computed when used."""
        answers = Answers(self.model, self.mode, self.programme)
        shared = answers.p.shared
        shared[0, : len(self.y)], shared[1, :5] = self.y, self.gauge
        return answers

    @cached_property
    def contacts(self) -> ContactState:
        """Contacts with their forces."""
        return self.answers.contacts

    @cached_property
    def solved(self) -> ring.Problem:
        """Contacts, rates and tangent of the state, as the kernels and numpy solve for them."""
        self.answers.reply(ring.LOOK)
        return self.answers.p

    @cached_property
    def raw_rates(self) -> Rates:
        """Rates in the unit of time of the gauge.

        The loading parameter is an unknown like the others, so a limit of the control
        (`parameter' = 0`) is an ordinary point unless the gauge is that parameter.
        """
        p, solution = self.solved, self.solved.small[ring.SOLUTION]
        en, et, spun, w_i, w_j, normal, shear = p.table[:, ring.EN : ring.SHEAR_RATE + 1].T
        nx, ny = p.table[:, NX], p.table[:, NY]
        return Rates(
            p.small[ring.H_RATE, :4], p.small[ring.P_RATE, :4],
            float(solution[ring.PARAMETER_RATE]), en, p.table[:, G] * et - spun, normal, shear,
            np.column_stack([nx * en - ny * et, ny * en + nx * et, w_i, w_j]),
            float(solution[ring.CONDITION]), bool(solution[ring.TRUSTED]),
        )  # fmt: skip

    @cached_property
    def rates(self) -> Rates:
        """Rates per unit length of the path in the space of `H`, `|H'| = 1`.

        The arc length is a regular parameter where the loading parameter turns back.
        """
        size = float(np.linalg.norm(self.raw_rates.H))
        # No strain at all: a loop that has collapsed to a line.
        return self.raw_rates.scaled(1.0 / size if size > 0.0 else np.nan)

    @cached_property
    def A(self) -> Floats:
        """(4, 4) macroscopic tangent, `P' = A H'`, in these regimes; nan if not trusted."""
        return self.solved.small[ring.TANGENT : ring.TANGENT + 4, :4]

    @cached_property
    def imbalance(self) -> float:
        """Largest force on a grain that `-P b_i` leaves unbalanced, over `kn` times length.

        Not a number under the affine closure, which does not balance the grains.
        """
        model = self.model
        if model.closure == "affine":
            return np.nan
        i, j = model.contacts.T
        f = self.contacts.forces
        unbalanced = -model.b @ self.P.reshape(2, 2).T
        np.add.at(unbalanced, i, -f)
        np.add.at(unbalanced, j, f)
        return float(np.abs(unbalanced).max() / (model.stiffness * model.length))


def closure_equations(
    model: PathModel, H: Floats, contacts: ContactState, mode: Mode
) -> tuple[Floats, Floats]:
    """Equations (4 + m, 8 + m) of the closure in one state, see `loops.closures.system`.

    Of the unknowns `(H', P'/kn, v)`; four equations of the control complete them. Also the motions
    (C, 4, 4) of the contacts that `H'` prescribes.
    """
    form, n = model.form, model.grain_count
    if model.spins == "affine":
        # A loop that has collapsed to a line has no rotation: not a number, and not trusted.
        row = spin_of_gradient(np.eye(2) - H.reshape(2, 2))
        row = np.where(np.isfinite(row), row, np.nan)
        form = replace(form, spin=LoopSpin(row, np.zeros(4)))
    S = contact_springs(contacts, model.law, mode.regime, model.spins) / model.stiffness
    A = drive(form)
    matrix = closure_matrix(form, S, A)
    felt = model.law.local_stiffness(contacts, mode.regime)[:, :, 1] != 0.0
    if model.spins == "free" and felt.any(axis=1).all():
        # On gear modes of all grains no moments act; those of a chain are loaded where it slides.
        about = model.contacts, model.radii, contacts, model.law, mode.regime
        matrix[-n:, -n:] += gear_projector(*about)[0]
    if model.closure == "traction":
        # The mean displacement is free: held at zero.
        for first in (4, 5):
            centres = slice(first, 4 + 2 * n, 2)
            matrix[centres, 4:][:, centres] += 1.0 / n
    return matrix, A


def stress_of_strain(matrix: Floats) -> Floats:
    """(4, 4) stress over `kn` per strain; nan if not trusted."""
    moving = matrix[:, 4:]
    found = solve_through_null_space(moving, -matrix[:, :4], np.eye(4, moving.shape[1]))
    return found.x[:4] if is_trusted(found) else np.full((4, 4), np.nan)


def is_trusted(found: LeastSquares) -> bool:
    """Whether a solve has exactly one answer."""
    return bool(found.residual <= RESIDUAL_LIMIT and found.ambiguity <= AMBIGUITY_LIMIT)
