"""Contact laws: Coulomb friction on any normal force, regimes, and the edge between them."""

from __future__ import annotations

import copy
from dataclasses import dataclass, replace
from enum import IntEnum
from typing import Any, Literal, Self, TypeGuard, cast, get_args

import numpy as np
from numpy.typing import ArrayLike

from loops.arrays import Flags, Floats, Integers, Regimes
from loops.errors import InputError, check_choice, counted, short
from loops.graph import ContactState
from loops.shown import Shown
from loops.validation import fits, real

ShearIncrement = Literal["branch", "radii"]
ShearHistory = Literal["force", "displacement"]
# A contact within this fraction of its strength is at yield: paths stop at it to 1e-12.
AT_YIELD_RTOL = 1e-10
# A gap below this fraction of `r_i + r_j` is touching: centres far from the origin carry the
# rounding of their coordinates.
TOUCHING_RTOL = 1e-12
# Strength below this fraction of `kn (r_i + r_j)` is none: the apex of the cone.
APEX = 1e-9
# Shear force of a contact that slides at the cone's apex: its sign is all the law reads.
APEX_SHEAR = 1e-300
# Nodes and weights on [0, 1] for the energy of a normal force without a closed form.
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(16)
_NODES, _WEIGHTS = 0.5 * (_NODES + 1.0), 0.5 * _WEIGHTS


class Regime(IntEnum):
    """Regime of a contact.

    Attributes
    ----------
    OPEN, ELASTIC, SLIDING
        0: no force; 1: elastic, sticking; 2: slides at the strength of its law.

    Examples
    --------
    >>> from patterns import read_snapshot, sample_path
    >>> regime = read_snapshot(sample_path()).regime
    >>> int((regime == Regime.SLIDING).sum()), Regime(int(regime[0])).name
    (51, 'ELASTIC')
    """

    OPEN = 0
    ELASTIC = 1
    SLIDING = 2

    @classmethod
    def _missing_(cls, value: object) -> Self:
        raise InputError(
            "regime", short(value), "0 (open), 1 (elastic) or 2 (sliding)", "Correct it."
        )

    # Arrays ask for it at every comparison; an enum that lacks it takes 8 microseconds to say so.
    __array_ufunc__ = np.ndarray.__array_ufunc__


# Parameters by contact of a law that takes its contacts itself.
BY_CONTACT = ("kn", "kt", "mu", "k_r", "mu_r")


def require_law(law: object, contacts: tuple[int, ...] | None = None) -> None:
    """Raise `InputError` unless the law is derived from `FrictionalLaw`.

    Of contacts of this shape its parameters are numbers, or arrays with as many in the last axis.
    """
    if not isinstance(law, FrictionalLaw):
        received = f"the class {law.__name__}" if isinstance(law, type) else type(law).__name__
        expected = "a law derived from gl.FrictionalLaw"
        remedy = "Give gl.LinearFrictional(kn, kt, mu), say, or derive yours."
        raise InputError("contact law", "none" if law is None else received, expected, remedy)
    if contacts is None:
        return
    everything = type(law).take is FrictionalLaw.take
    for name, value in vars(law).items():
        if name == "law":
            require_law(value, contacts)
        elif (everything or name in BY_CONTACT) and not isinstance(value, str):
            _require_fit(f"{name} of the contact law", np.shape(value), contacts)


def _require_fit(name: str, shape: tuple[int, ...], contacts: tuple[int, ...]) -> None:
    """Raise `InputError` unless parameters are one for each state, or one for each contact."""
    # A number for all contacts of each state has an axis of one contact.
    if not fits(shape, contacts, 1) or (shape == (1,) and contacts[-1] != 1):
        received = counted(shape[-1], "value") if len(shape) == 1 else f"shape {shape}"
        expected = f"a number, or one for each of the {contacts[-1]} contacts of the graph"
        remedy = "Give law.take(kept), with the contacts that the graph has kept."
        raise InputError(name, received, expected, remedy)


class FrictionalLaw(Shown):
    """Base of contact laws: a normal force of the overlap, an elastic shear spring, friction.

    Local components are in the order (normal, tangential). The relative displacement rates are
    `un' = n . d'` and `ut' = g t . d' - (b_i w_i + b_j w_j)`, with `g`, `b_i`, `b_j` from
    `shear_kinematics` and `w` the grain spins (counter-clockwise positive). The force rates are
    `(N', T') = -D (un', ut')` with `D` from `local_stiffness`, and the rolling moment on grain j
    has the rate `-k_r (w_j - w_i)`. Forces are positive in compression. The edge of the law says
    which regimes are open to a contact: it opens where `gap` grows positive, closes where the
    grains touch, slides while `|T|` is at its `strength` and the slip dissipates.

    A law of your own gives `closed_force`, and `stiffnesses` unless they are its constants `kn` and
    `kt`; without a constant `kn` it is the slope of `closed_force`. Its parameters are attributes
    (numbers, or arrays with the contacts in the last axis), set by name when it is made. The rest
    has defaults: Coulomb's `strength` `mu N`, opening where the grains part (`gap`), no rolling
    spring.

    - elastic: `N' = -kn un'`, `T' = -kt ut'`;
    - sliding (`|T|` at the strength): `T' = s mu N'`, `s = sign(T)`, while the slip dissipates:
      sticking would leave the cone, `-s (ut' + s mu N'/kt) >= 0`;
    - open: `N = T = 0`.

    A law whose strength grows otherwise than as `mu N` overrides `strength` and, if its slope with
    N is not `mu`, `strength_slope`; one whose shear force changes with the overlap, `coupling`. All
    these are formulae of one contact, elementwise in numpy: where they use nothing but the law's
    parameters and `overlap`, `touching_length`, `length`, `radii_i`, `radii_j`, `normal_force`,
    `shear_force` of the state, the equations of motion compile them.

    Attributes
    ----------
    mu : float or (..., C) array
        Coefficient of friction; inf (the default) never slides, 0 slides freely.
    shear_increment : {'branch', 'radii'}
        What a turn of the branch by `d(alpha)` adds to `ut`: `l d(alpha)` (Nicot et al. 2016) or
        `(r_i + r_j) d(alpha)` (Yade's default).
    keeps_strength : bool
        Whether a path writes `T = s strength` into sliding contacts, or integrates `T'`.
    compiled : bool or None
        Whether the equations of motion compile a law of your own (2 to 3 s, once) or ask numpy in
        every step; by default they compile it where a run has 2,500 steps or more and numba can.

    Examples
    --------
    Grains that attract each other with a constant force while they touch:

    >>> from loops import FrictionalLaw, GrainGraph, contact_state
    >>> class Cohesive(FrictionalLaw):
    ...     def closed_force(self, state):
    ...         return self.kn * state.overlap - self.adhesion
    ...     def strength(self, state):
    ...         return self.mu * (state.normal_force + self.adhesion)
    >>> pair = GrainGraph(x=[[0, 0], [0.95, 0]], radii=[0.5, 0.5], contacts=[[0, 1]])
    >>> law = Cohesive(kn=1.0, kt=0.5, mu=0.3, adhesion=0.01)
    >>> law.normal_force(contact_state(pair)).round(12).tolist()
    [0.04]
    """

    mu: ArrayLike = np.inf
    shear_increment: ShearIncrement = "branch"
    keeps_strength: bool = True
    compiled: bool | None = None
    # For readers and checks of tables: the words that name the law beside its columns, None where
    # columns do not hold it; the power of the overlap that springs push with; `kn` and `kt` where
    # no state changes them; whether moduli give them; what a contact keeps as its `kt` changes;
    # whether contacts may pull, and by bonds that break for good; the largest pull, how much more
    # the springs of touching contacts push than `N`, and the strength without a force.
    table_words: dict[str, str] | None = None
    overlap_power: float | None = None
    constant_springs: tuple[Floats, Floats] | None = None
    of_moduli: bool = False
    shear_history: ShearHistory = "force"
    cohesive: bool = False
    bonded: bool = False
    adhesion: Floats | float = 0.0
    attraction: Floats | float = 0.0
    cohesion: Floats | float = 0.0

    def __init__(self, **parameters: ArrayLike) -> None:
        for name in {"kn", "kt", "mu"} & {*parameters}:
            expected = "a number, or one for each contact"
            parameter(name, parameters[name], expected, high=np.inf)
        checked_increment(parameters.get("shear_increment", self.shear_increment))  # type: ignore[arg-type]
        vars(self).update(parameters)

    def closed_force(self, state: ContactState) -> Floats:
        """`N` as a function of `state.overlap`, smooth beyond the opening: for you to write."""
        said = "write this method: N as a function of state.overlap"
        raise NotImplementedError(f"{type(self).__name__}.closed_force: {said}")

    def stiffnesses(self, state: ContactState) -> tuple[ArrayLike, ArrayLike]:
        """`kn = dN/d(overlap)` and `kt`, broadcastable to (..., C); by default its constants.

        Without a constant `kn` differences of `closed_force` over a thousandth of the overlap.
        """
        constants = vars(self)
        if "kt" not in constants:
            said = "give the law kt=..., or write this method: it returns kn and kt"
            raise NotImplementedError(f"{type(self).__name__}.stiffnesses: {said}")
        if "kn" in constants:
            return constants["kn"], constants["kt"]
        step = 1e-3 * np.maximum(np.abs(state.overlap), TOUCHING_RTOL * state.touching_length)
        # Central differences of the fourth order, over overlaps as they are rounded: 1e-12 is left.
        near = [_plain(state, state.length - k * step) for k in (1, -1, 2, -2)]
        N, overlap = ([f(one) for one in near] for f in (self.closed_force, lambda s: s.overlap))
        rise, run = (8.0 * (a - b) - (c - d) for a, b, c, d in (N, overlap))
        return rise / run, constants["kt"]

    def gap(self, state: ContactState) -> Floats:
        """`l - (r_i + r_j)`: a closed contact opens where its grains part."""
        return -state.overlap

    def strength(self, state: ContactState) -> Floats:
        """`mu N`; infinite where nothing slides."""
        mu = np.asarray(self.mu, dtype=float)
        finite = np.isfinite(mu)
        return np.where(finite, np.where(finite, mu, 0.0) * state.normal_force, np.inf)

    def strength_slope(self, state: ContactState) -> ArrayLike:
        """`dS/dN`, broadcastable to (..., C): `mu`."""
        return self.mu

    def coupling(self, state: ContactState) -> ArrayLike:
        """`-dT/dun` of a contact that sticks, broadcastable to (..., C): zero."""
        return 0.0

    def elastic_slip(self, T: Floats, kt: Floats) -> Floats:
        """Elastic displacement `ut` (C,) between two states, from their `T` and `kt` (2, C)."""
        return np.asarray((T[0] - T[1]) / kt.mean(axis=0))

    def normal_energy(self, state: ContactState) -> Floats:
        """`Int N d(overlap)` from the first touch, by Gauss's rule with 16 nodes."""
        touching = state.touching_length
        energy = np.zeros(np.broadcast_shapes(state.length.shape, touching.shape))
        for node, weight in zip(_NODES, _WEIGHTS, strict=True):
            at = _plain(state, touching - node * state.overlap)
            energy = energy + weight * self.closed_force(at)
        return energy * state.overlap

    def normal_force(self, state: ContactState) -> Floats:
        """`N` of the overlap, zero for an open contact."""
        return np.where(self.gap(state) > 0.0, 0.0, self.closed_force(state))

    def shear_kinematics(self, state: ContactState) -> tuple[Floats, Floats, Floats]:
        """`g = 1` and the lever arms (`branch`), or `g = (r_i + r_j)/l` and the radii (`radii`).

        Objectivity asks for `g l = b_i + b_j`.
        """
        if self.shear_increment == "radii":
            return state.touching_length / state.length, state.radii_i, state.radii_j
        return np.ones_like(state.length), state.arm_i, state.arm_j

    def local_stiffness(self, state: ContactState, regime: Regimes) -> Floats:
        """Elastic `[[kn, 0], [coupling, kt]]`; sliding `[[kn, 0], [s S' kn, 0]]`; open zero.

        `s = sign(T)`, and `S'` is the slope of the strength.
        """
        kn, kt = (np.asarray(k, dtype=float) for k in self.stiffnesses(state))
        mu = np.asarray(self.strength_slope(state), dtype=float)
        shape = np.broadcast(state.length, state.shear_force, regime, kn, kt, mu).shape
        stiffness = np.zeros((*shape, 2, 2))
        stiffness[..., 0, 0] = np.where(regime != Regime.OPEN, kn, 0.0)
        stiffness[..., 1, 1] = np.where(regime == Regime.ELASTIC, kt, 0.0)
        # A contact that never slides has infinite mu: keep it out of the product.
        friction = np.where((regime == Regime.SLIDING) & np.isfinite(mu), mu, 0.0)
        stiffness[..., 1, 0] = np.sign(state.shear_force) * friction * kn
        if type(self).coupling is not FrictionalLaw.coupling:
            sticks = regime == Regime.ELASTIC
            stiffness[..., 1, 0] += np.where(sticks, self.coupling(state), 0.0)
        return stiffness

    def rolling_stiffness(self, state: ContactState, regime: Regimes) -> Floats:
        """`k_r`, broadcastable to (..., C) (moment per angle): no rolling resistance."""
        return np.zeros(())

    def regime(self, state: ContactState, rates: tuple[Floats, Floats] | None = None) -> Regimes:
        """Regime of every contact, `Regime`, as int8 (..., C).

        Without rates, a contact is open when it carries no force and its gap is open, sliding when
        it is at yield, else elastic: just touching is elastic. With rates, a contact at yield
        slides only if the slip dissipates, and a touching contact opens if the branch lengthens.
        """
        unloaded = (state.normal_force <= 0) & (state.shear_force == 0)
        gap, band = self.gap(state), TOUCHING_RTOL * state.touching_length
        is_open = unloaded & (gap > band)
        # At its strength; without friction wherever it is loaded.
        limit = self.strength(state)
        at_yield = np.abs(state.shear_force) >= limit * (1.0 - AT_YIELD_RTOL)
        frictionless = (np.asarray(self.mu) == 0.0) & (state.normal_force > 0.0)
        slides = (at_yield & (limit > 0.0)) | frictionless
        if rates is not None:
            is_open = is_open | (unloaded & (gap >= -band) & (rates[0] > 0))
            sign = np.sign(state.shear_force)
            _, sticking, strength = edge_rates(self, state, sign, *rates)
            slides = slides & (sign * sticking - strength >= 0)
        regime = np.where(is_open, Regime.OPEN, np.where(slides, Regime.SLIDING, Regime.ELASTIC))
        return regime.astype(np.int8)

    def take(self, contacts: Integers | slice) -> Self:
        """Law of the picked contacts; parameters that are numbers stay numbers."""
        law = copy.copy(self)
        for name, value in vars(self).items():
            if isinstance(value, FrictionalLaw):
                vars(law)[name] = value.take(contacts)
            elif np.ndim(value) > 0 and not isinstance(value, str):
                vars(law)[name] = np.asarray(value)[..., contacts]
        return law

    def parted(self, opened: Flags) -> Self:
        """Law once these contacts (C,) have opened: the same, unless an opening breaks a bond."""
        return self


# What functions of contacts take.
ContactLaw = FrictionalLaw


def of_tables(law: object) -> TypeGuard[FrictionalLaw]:
    """Return whether the columns of a table hold a law."""
    return isinstance(law, FrictionalLaw) and law.table_words is not None


@dataclass(frozen=True, eq=False, repr=False)
class Edge(Shown):
    """Contacts whose regime the motion decides, (..., C) each."""

    at_yield: Flags  # closed and at the strength: sticks or slides
    touching: Flags  # where a contact opens or closes
    apex: Flags  # touching without strength: may slide to either side


def edge_of(
    law: ContactLaw, state: ContactState, closed: Flags, band: float = 1.0 - AT_YIELD_RTOL
) -> Edge:
    """Contacts at the edge of their law, from `band` of their strength on; `closed`: not open.

    Open contacts are judged by the forces that the state gives them: those at their closing.
    """
    mu, T = np.asarray(law.mu, dtype=float), np.abs(state.shear_force)
    cone = (mu > 0) & np.isfinite(mu)
    strength = law.strength(state)
    at_yield = closed & cone & (T > 0) & (T >= strength * band)
    gap = np.where(closed, law.gap(state), -state.overlap)
    touching = np.abs(gap) <= TOUCHING_RTOL * state.touching_length
    elastic = np.full(gap.shape, Regime.ELASTIC, dtype=np.int8)
    kn = law.local_stiffness(state, elastic)[..., 0, 0]
    apex = touching & cone & (strength <= APEX * kn * state.touching_length)
    return Edge(at_yield & ~apex, touching, apex)


def with_sides(state: ContactState, side: Floats) -> ContactState:
    """State whose `T` has the given signs where they are not zero: at the apex `T` is zero."""
    wrong = (side != 0.0) & (side * state.shear_force <= 0.0)
    if not wrong.any():
        return state
    return replace(state, shear_force=np.where(wrong, side * APEX_SHEAR, state.shear_force))


def edge_rates(
    law: ContactLaw, state: ContactState, side: Floats, un: Floats, ut: Floats
) -> tuple[Floats, Floats, Floats]:
    """Rates of `N`, of `T` if the contact sticks, and of the strength, for displacement rates.

    `side` is the sign of `T` on which a contact would slide; where it is 0 either side serves, as
    the friction limit is symmetric. The strength's rate is infinite where nothing slides.
    """
    side = np.where(side == 0.0, 1.0, side)
    shape = np.broadcast_shapes(un.shape, state.length.shape)
    stick = law.local_stiffness(state, np.full(shape, Regime.ELASTIC, dtype=np.int8))
    slide = law.local_stiffness(
        with_sides(state, side), np.full(shape, Regime.SLIDING, dtype=np.int8)
    )
    normal = -(stick[..., 0, 0] * un + stick[..., 0, 1] * ut)
    shear = -(stick[..., 1, 0] * un + stick[..., 1, 1] * ut)
    slid = -(slide[..., 1, 0] * un + slide[..., 1, 1] * ut)
    return normal, shear, np.where(np.isfinite(law.mu), side * slid, np.inf)


def _plain(state: ContactState, length: Floats) -> ContactState:
    """The same contacts with other branch lengths, overlaps included."""
    fields = {name: getattr(state, name) for name in ContactState.__dataclass_fields__}
    return ContactState(**{**fields, "length": length})


# ---- parameters: float arrays, checked once at the door

LARGEST = float(np.finfo(float).max)


def parameter(
    name: str, value: ArrayLike, expected: str, low: float = 0.0, *, above: bool = False,
    high: float = LARGEST,
) -> Any:  # fmt: skip
    """Return parameters from `low`, or `above` it, to `high` as an array, or raise `InputError`."""
    array = real(f"{name} of the contact law", value, expected=expected)
    ok = (array > low if above else array >= low) & (array <= high)
    if not ok.all():
        bad = str(array[~ok].flat[0])
        raise InputError(f"{name} of the contact law", bad, expected, "Correct it.")
    return array


def friction_of(mu: ArrayLike | None, phi: ArrayLike | None) -> ArrayLike | None:
    """Return the coefficient of friction, given as `mu` or by its angle `phi` (radians)."""
    if phi is None:
        return mu
    if mu is not None:
        raise InputError("mu, phi", "both", "one of them", "Leave one out.")
    expected = "an angle in radians, from 0 to pi/2: np.radians(30) for 30 degrees"
    return np.tan(parameter("phi", phi, expected, high=0.5 * np.pi))


def friction_and_increment(
    mu: ArrayLike, phi: ArrayLike | None, shear_increment: str
) -> dict[str, Any]:
    """Return what every law with friction has, or raise `InputError`."""
    expected = "a coefficient of friction, zero or more"
    if phi is not None:
        mu = cast(ArrayLike, friction_of(None if np.all(np.isinf(mu)) else mu, phi))
    mu = parameter("mu", mu, expected, high=np.inf)
    return {"mu": mu, "shear_increment": checked_increment(shear_increment)}


def checked_increment(increment: str) -> ShearIncrement:
    """Return a known shear increment, or raise `InputError`."""
    check_choice("shear_increment", increment, get_args(ShearIncrement))
    return cast(ShearIncrement, increment)
