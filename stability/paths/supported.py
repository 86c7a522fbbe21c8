"""Rates of a cluster with held grains and imposed motions."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from loops import ContactLaw, GrainGraph, Regime, Support, contact_state
from loops.arrays import Floats, Regimes
from loops.assembly import assemble_tangent, contact_kinematics, grain_ends, motions
from loops.closures.null_space import solve_through_null_space
from loops.errors import InputError
from loops.graph import ContactState, require_one_state
from loops.laws.frictional import edge_of, edge_rates, with_sides
from loops.shown import Shown
from stability.complementarity import Errors
from stability.paths.state_rates import is_trusted
from stability.regimes import EdgeProblem, EdgeRates, Slips, agreeing, edge_options, sides
from stability.regimes import Regimes as AgreeingRegimes

# Rounding of rates over the largest motion, which soft clusters amplify.
ROUNDED = 1e-12


@dataclass(frozen=True, eq=False, repr=False)
class SupportedRates(Shown):
    """Rates of a supported cluster in one combination of regimes, see `stability.regimes.Trial`.

    `regime` (C,); `motion` (G, 2) and `spin` (G,) rates of the grains; `un`, `ut` (C,) normal and
    shear displacement, positive when the contact opens and along `t`; `normal_force`,
    `shear_force` (C,) rates of `N` and `T`; `reaction` (G, 3) rates of the forces and moments that
    the supports add, zero where free.
    """

    regime: Regimes
    motion: Floats
    spin: Floats
    un: Floats
    ut: Floats
    normal_force: Floats
    shear_force: Floats
    reaction: Floats
    edge: EdgeRates
    vector: Floats
    trusted: bool


class SupportedCluster:
    """A supported cluster and its rate problem: regimes of contacts at the edge."""

    def __init__(self, graph: GrainGraph, law: ContactLaw, support: Support) -> None:
        require_one_state(graph)
        support.require(graph)
        self.graph, self.law = graph, law
        self.state = contact_state(graph)
        given = law.regime(self.state)
        edge = edge_of(law, self.state, given != Regime.OPEN)
        mu = np.broadcast_to(np.asarray(law.mu, dtype=float), given.shape)
        # The forces given decide, not the overlaps: a small one may be at yield.
        touching = edge.touching & (self.state.normal_force == 0.0)
        small = edge.apex & ~touching & (given == Regime.SLIDING) & (self.state.shear_force != 0.0)
        at_yield = edge.at_yield | small
        self.contacts = np.flatnonzero(at_yield | touching)
        self.base = np.where(at_yield | touching, Regime.ELASTIC, given).astype(np.int8)
        own = touching, at_yield, edge.apex & touching, mu == 0.0, self.state.shear_force
        self.options = edge_options(*own)[self.contacts]
        count, length = graph.grain_count, float(np.mean(graph.radii))
        # All centres, then all spins, in units in which every freedom is a length.
        self.unit = np.repeat([1.0, 1.0 / length], [2 * count, count])
        held, motion = support.held, support.motion
        self.free = ~np.concatenate([held[:, :2].ravel(), held[:, 2]])
        self.imposed = np.concatenate([motion[:, :2].ravel(), motion[:, 2]]) / self.unit
        # (C, 2, 3 G) rates (un, ut), and (C, 3 G) forces and moments of a unit of T.
        relative = motions(np.diag(self.unit), grain_ends(graph.contacts, count)[0])
        self.watched = contact_kinematics(self.state, law) @ relative
        push = np.column_stack([self.state.t, -self.state.arm_i, -self.state.arm_j])
        self.push = (push[:, None] @ relative)[:, 0]
        sticks = np.full(graph.contact_count, Regime.ELASTIC, dtype=np.int8)
        self.kn = law.local_stiffness(self.state, sticks)[:, 0, 0]

    @property
    def problem(self) -> EdgeProblem[SupportedRates]:
        """Rate problem: full solves where slips don't tell all."""
        return EdgeProblem(self.options, self.rates, few=0, own_slips=self.slips)

    def _stiffness(self, regime: Regimes, sided: ContactState) -> Floats:
        """Return the tangent (3 G, 3 G) of all freedoms."""
        graph = self.graph.replace(shear_force=sided.shear_force)
        K = assemble_tangent(graph, self.law, spins=True, regime=regime)
        return self.unit[:, None] * K * self.unit

    def _moved(self, K: Floats, loads: Floats) -> tuple[Floats, bool]:
        """Return motions (3 G, k) of the free freedoms under loads, and whether they are certain.

        Null vectors that no contact sees, as of a grain without contacts, are solved through.
        """
        free, out = self.free, np.zeros_like(loads)
        if not free.any():
            return out, True
        seen = self.watched.reshape(-1, len(free))[:, free]
        found = solve_through_null_space(K[np.ix_(free, free)], loads[free], seen)
        out[free] = found.x
        return out, is_trusted(found)

    def rates(self, regimes: Regimes) -> SupportedRates:
        """Solve for the free freedoms with these regimes."""
        graph, law, state, count = self.graph, self.law, self.state, self.graph.grain_count
        regime, side = self.base.copy(), np.zeros(graph.contact_count)
        regime[self.contacts], side[self.contacts] = np.abs(regimes), sides(regimes)
        sided = with_sides(state, side)
        K = self._stiffness(regime, sided)
        moved, trusted = self._moved(K, -(K @ self.imposed)[:, None])
        v = self.imposed + moved[:, 0]
        un, ut = (self.watched @ v).T
        D = law.local_stiffness(sided, regime)
        N, T = -(D @ np.stack([un, ut], axis=-1)[..., None])[..., 0].T
        _, shear, strength = edge_rates(law, state, side, un, ut)
        at, kn, reaction = self.contacts, self.kn, np.where(self.free, 0.0, K @ v) / self.unit
        error = ROUNDED * float(kn.max(initial=0.0) * np.abs(v).max())
        return SupportedRates(
            regime=regime,
            motion=v[: 2 * count].reshape(-1, 2),
            spin=(v * self.unit)[2 * count :],
            un=un,
            ut=ut,
            normal_force=N,
            shear_force=T,
            reaction=np.column_stack([reaction[: 2 * count].reshape(-1, 2), reaction[2 * count :]]),
            edge=EdgeRates(kn[at] * un[at], shear[at], strength[at], error),
            vector=np.concatenate([kn.mean() * self.imposed, kn * un, kn * ut, N, T]),
            trusted=trusted,
        )

    def slips(self, side: Regimes) -> Slips:
        """Return the problem of slips from one solve with all contacts at yield sticking."""
        at = self.contacts
        K = self._stiffness(self.base, self.state)
        loads = np.column_stack([-K @ self.imposed, -(side[:, None] * self.push[at]).T])
        moved, trusted = self._moved(K, loads)
        moved[:, 0] += self.imposed
        error = ROUNDED * self.kn.max(initial=0.0) * np.abs(moved).max(axis=0)
        signs = np.zeros(self.graph.contact_count)
        signs[at] = side
        un, ut = np.moveaxis(self.watched @ moved, 0, -1)
        _, shear, strength = edge_rates(self.law, self.state, signs, un, ut)
        w = (strength - signs * shear)[:, at].T
        M = w[:, 1:] + np.eye(len(at))
        return (w[:, 0], M, Errors(float(error[0]), error[1:])) if trusted else None


def supported_rates(
    graph: GrainGraph, law: ContactLaw, support: Support
) -> AgreeingRegimes[SupportedRates]:
    """Find the rates of a cluster under imposed motions, regimes of contacts at the edge included.

    See `rates_at`.
    """
    if not support.motion.any():
        raise InputError("motion", "zero everywhere", "an imposed motion", "Move a held grain.")
    cluster = SupportedCluster(graph, law, support)
    return replace(agreeing(cluster.problem), contacts=cluster.contacts)


def slip_problem(graph: GrainGraph, law: ContactLaw, support: Support) -> tuple[Floats, Floats]:
    """Complementarity problem `w = q + M z` of the contacts at yield of a supported cluster.

    `z >= 0` are the rates by which the shear forces would leave Coulomb's cone if the contacts
    stuck, `w >= 0` those of their distances from it, and one of both is zero (force per time).

    Parameters
    ----------
    graph, law, support
        As in `rates_at`.

    Returns
    -------
    (m,) and (m, m) array
        `q` and `M`, of the contacts at yield in the order of their numbers.

    Raises
    ------
    InputError
        As `rates_at`, and if a contact may part, or a mechanism moves while all stick.

    Examples
    --------
    A disc pressed on a held one and moved along it: one contact, which slides.

    >>> from loops import GrainGraph, LinearFrictional, Support
    >>> from stability import slip_problem
    >>> pair = GrainGraph(x=[[0, 0], [1, 0]], radii=[0.5] * 2, contacts=[[0, 1]],
    ...     normal_force=[1e-3], shear_force=[5e-4])
    >>> support = Support([True, True], [[0, 0, 0], [0, -1, 0]])
    >>> q, M = slip_problem(pair, LinearFrictional(1.0, 1.0, 0.5), support)
    >>> q.tolist(), M.tolist()
    ([-1.0], [[1.0]])
    """
    problem = SupportedCluster(graph, law, support).problem.slips
    if problem is None:
        where, received = "contacts at the edge", "one that may part, or a mechanism that moves it"
        expected, remedy = "contacts that stick or slide", "Ask rates_at, which tries all regimes."
        raise InputError(where, received, expected, remedy)
    return problem[:2]
