"""The exact drained biaxial path of one diamond (Nicot et al. 2016, Figs. 6 and 8).

From the confined state A (isotropic strain, `T = 0`) `E1` grows under constant `s2`. The elastic
part is a quadrature, the sliding part is algebraic, `N = f/(sin a - s mu cos a)` with
`f = F2/(2 kn l0)`. The path is given over the branch angle, which determines the state.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from loops import LinearFrictional
from loops.arrays import Floats, Regimes
from loops.errors import InputError
from loops.graph import ContactState
from loops.validation import finite
from patterns.diamond.drained_end import (
    DrainedState,
    advance_shear,
    drained_end,
    drained_state,
    turning_stiffness,
)
from patterns.diamond.tangents import DiamondParameters


class PrintedRule(LinearFrictional):
    """Linear springs whose sliding contacts follow (8c) as printed while N falls.

    `T' = -zeta_n zeta_t zeta mu kn un'` with `zeta_n = sign(un')`: a contact that slides outward
    while N falls has `T' = -s mu N'`, `s = sign(T)`, so that `|T|` grows and leaves Coulomb's cone.
    Where N grows the rule is Coulomb's, `LinearFrictional`. `T` is integrated: it is no function of
    `N` (`keeps_strength`).

    Parameters
    ----------
    kn, kt, mu, shear_increment
        As in `loops.LinearFrictional`.

    Examples
    --------
    >>> from patterns.diamond import TABLE_1, PrintedRule, diamond
    >>> from stability import Stage, follow, programmes
    >>> import numpy as np
    >>> stages = [Stage(programmes.isotropic_strain(), "H11", 0.3),
    ...           Stage(programmes.drained_biaxial(), "H11", 0.5)]
    >>> path = follow(diamond(np.pi / 4), PrintedRule(1.0, TABLE_1.kappa, TABLE_1.mu), stages)
    >>> loaded = path.normal_force[:, 0] > 0  # at the end (2 N_B - N) / N, N_B = 0.2769
    >>> use = np.abs(path.shear_force / TABLE_1.mu)[loaded] / path.normal_force[loaded]
    >>> round(float(use[-1, 0]), 2)
    1.17
    """

    keeps_strength = False

    def local_stiffness(self, state: ContactState, regime: Regimes) -> Floats:
        """Sliding `[[kn, 0], [-s mu kn, 0]]`, the sign of Coulomb's law turned."""
        stiffness = super().local_stiffness(state, regime)
        # At the apex of the cone T carries a sign alone; loading from there, N grows.
        falls = np.abs(state.shear_force) > 1e-200
        stiffness[..., 1, 0] = np.where(falls, -1.0, 1.0) * stiffness[..., 1, 0]
        return stiffness


@dataclass(frozen=True, eq=False)
class DrainedPath:
    """A drained biaxial path and its events.

    `status`, `direction`: see `DrainedEnd`; `confined`, `end`: state A, and the end of the elastic
    part: B at yield, NaN if none; `snaps_back`: whether `E1` stops growing at the end, where K22
    changes its sign as the contacts start to slide, or vanishes ('limit'): the states beyond B then
    need another control than `E1`; `stick_angle`: angle at which sliding contacts stick again,
    radians, NaN if they slide on. It exists for a falling alpha alone, where N grows faster than
    the shear force of slip.
    """

    parameters: DiamondParameters
    status: str
    direction: int
    confined: DrainedState
    end: DrainedState
    snaps_back: bool
    stick_angle: float


def drained_path(parameters: DiamondParameters) -> DrainedPath:
    """Follow a diamond's drained biaxial path to the end of its elastic part."""
    p, zero = parameters, np.zeros(())
    end = drained_end(p.alpha0, p.kappa, p.phi, p.confinement)
    status, direction = str(end.status), int(end.direction)
    sticks = status == "yield" and direction < 0
    snaps_back = status == "limit"
    if status == "yield":
        # K22 of the sliding contacts at B has another sign than on the elastic path.
        f, B = np.asarray(p.confinement * np.sin(p.alpha0)), end.state
        lambda2 = np.asarray(-direction * p.mu * np.tan(B.alpha))
        snaps_back = bool(direction * turning_stiffness(B.alpha, f, B.T, lambda2) < 0.0)
    return DrainedPath(
        parameters=p,
        status=status,
        direction=direction,
        confined=drained_state(np.array(p.alpha0), np.array(p.confinement), zero, zero),
        end=end.state,
        snaps_back=snaps_back,
        stick_angle=_stick_angle(p, float(end.state.alpha)) if sticks else float("nan"),
    )


def drained_states_after_turn(
    path: DrainedPath, turn: ArrayLike
) -> tuple[DrainedState, NDArray[np.str_]]:
    """States after the branch has turned by `turn = alpha - alpha0`; 'elastic', 'sliding', 'open'.

    Turns run from 0 on in the path's direction; at B itself the state is still elastic. Exact to
    relative rounding errors also where stiff grains yield after a turn of 1e-9.
    """
    p, turn = path.parameters, _on_path(path, turn)
    T, regime = _shear_and_regime(path, turn.reshape(-1))
    alpha0, confinement = np.full(turn.shape, p.alpha0), np.full(turn.shape, p.confinement)
    state = drained_state(alpha0, confinement, turn, T.reshape(turn.shape))
    if np.any(state.length <= 0.0):
        met = float(np.max(state.alpha[state.length <= 0.0]))
        expected = "angles short of the one where the grains' centres meet (l = 0)"
        raise InputError("alpha", f"{met:.17g}", expected, "Stay closer to alpha0.")
    return state, regime.reshape(turn.shape)


def printed_states_after_turn(path: DrainedPath, turn: ArrayLike) -> DrainedState:
    """States where sliding contacts follow (8c) as printed, after the branch has turned by `turn`.

    Beyond B the printed rule adds `-mu N'` to `T` where alpha grows and N falls: with
    `T = T_B - mu (N - N_B)` balance (12b) gives `N (sin a + mu cos a) = f + (T_B + mu N_B) cos a`,
    and `|T|` leaves Coulomb's cone. Where alpha falls N grows, and the rule is Coulomb's.
    """
    exact, regime = drained_states_after_turn(path, turn)
    if path.direction < 0:
        return exact
    p, B = path.parameters, path.end
    f = p.confinement * np.sin(p.alpha0)
    held = B.T + p.mu * B.N
    N = (f + held * np.cos(exact.alpha)) / (np.sin(exact.alpha) + p.mu * np.cos(exact.alpha))
    T = np.where(regime == "sliding", held - p.mu * N, exact.T)
    return drained_state(np.asarray(p.alpha0), np.asarray(p.confinement), exact.turn, T)


def _on_path(path: DrainedPath, turn: ArrayLike) -> Floats:
    """Turns as an array, every one on the path."""
    turn, alpha0 = finite("turn", turn), path.parameters.alpha0
    last = 0.5 * np.pi if path.direction > 0 else 0.0
    inside = (turn * path.direction >= 0.0) & ((last - alpha0 - turn) * path.direction > 0.0)
    expected = f"angles from alpha0 = {alpha0:.17g} on, short of {last:.17g}"
    if path.status == "limit":
        inside &= turn <= path.end.turn
        expected += f", up to the limit of strain control at {float(path.end.alpha):.17g}"
    if not np.all(inside):
        received = alpha0 + float(np.atleast_1d(turn)[~np.atleast_1d(inside)][0])
        raise InputError("alpha", f"{received:.17g}", expected, "Move it.")
    return turn


def _shear_and_regime(path: DrainedPath, turn: Floats) -> tuple[Floats, NDArray[np.str_]]:
    """Shear force and regime after turns (n,): elastic from A, sliding from B, stuck again."""
    p, stick_turn = path.parameters, path.stick_angle - path.parameters.alpha0
    if path.status == "opening":
        return np.zeros_like(turn), np.full(turn.shape, "open")
    past_yield = (turn - path.end.turn) * path.direction > 0.0
    stuck = (turn - stick_turn) * path.direction > 0.0
    sliding = past_yield & ~stuck
    T = _elastic_shear(p, p.alpha0, 0.0, np.where(past_yield, 0.0, turn))
    T[sliding] = _sliding_shear(path, p.alpha0 + turn[sliding])
    stick_T = _sliding_shear(path, np.array([path.stick_angle]))[0]
    T[stuck] = _elastic_shear(p, path.stick_angle, stick_T, turn[stuck] - stick_turn)
    regime = np.where(sliding, "sliding" if p.confinement > 0.0 else "open", "elastic")
    return T, regime


def _elastic_shear(p: DiamondParameters, start: float, T: float, turn: Floats) -> Floats:
    """Shear force after turns (n,) from the angle `start`, where it was `T`."""
    same, f = np.ones_like(turn), p.confinement * np.sin(p.alpha0)
    return advance_shear(T * same, start * same, turn, f * same, p.kappa * same)


def _sliding_shear(path: DrainedPath, alpha: Floats) -> Floats:
    """`T = s mu N` with `N = f/(sin a - s mu cos a)`; zero without lateral force."""
    p, s = path.parameters, path.direction
    force = p.confinement * np.sin(p.alpha0) * np.sin(p.phi)
    return s * force / np.sin(alpha - s * p.phi) if force > 0.0 else np.zeros_like(alpha)


def _stick_angle(p: DiamondParameters, alpha_B: float) -> float:
    """Angle where slip of falling alpha stops, `kappa l = mu N cot(alpha + phi)`; NaN if none."""
    # Imported here, since it is slow to load and used by paths alone.
    from scipy.optimize import brentq

    f = p.confinement * np.sin(p.alpha0)

    def slip(theta: float) -> float:
        stiff = p.kappa * (np.sin(theta) - f * np.cos(p.phi)) * np.sin(theta)
        return float(stiff - f * np.sin(p.phi) * np.cos(theta))

    theta_B = alpha_B + p.phi
    last = max(p.phi, float(np.arcsin(f * np.cos(p.phi))))
    if slip(theta_B) <= 0.0:
        return alpha_B
    return brentq(slip, last, theta_B, xtol=1e-16) - p.phi if slip(last) < 0.0 else float("nan")
