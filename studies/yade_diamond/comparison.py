"""Yade's forces against the closed forms, and the platform's own machinery against both."""

from __future__ import annotations

from typing import Any

import numpy as np

from loops import LinearFrictional, Regime, affine_tangent
from patterns import diamond
from patterns.diamond.strain_lines import Floats, LineStates, half_diagonals
from stability import Stage, follow, programmes, restrict
from studies.yade_diamond.probes import KAPPA, Probe, exact_states
from studies.yade_diamond.replay import replayed_shear

FORCES = ("F1", "F2", "N", "T")
# Shear forces below this part of N are the rounding of 15 recorded digits on a radial line.
ROUNDING = 1e-9


def compare(probe: Probe) -> dict[str, Any]:
    """Largest differences along one probe, over the largest value of each force on it.

    Parameters
    ----------
    probe : Probe
        From `read_probes`.

    Returns
    -------
    dict
        The probe; `error_F1` .. `error_T` of Yade against the exact states (T: NaN on lines that
        don't turn), `replay_T` of Yade's rule replayed against Yade, over the largest N.
    """
    exact = exact_states(probe)
    ours = external_and_contact_forces(probe, exact)
    rise, steps = float(probe.u[-1] - probe.u[0]), int(probe.steps[-1])
    replayed = replayed_shear(probe.line, rise, steps, probe.mu, probe.increment)
    floor = ROUNDING * float(exact.N.max())
    errors = {
        f"error_{name}": _relative(getattr(probe, name), ours[name], floor) for name in FORCES
    }
    return {
        "alpha0_deg": float(np.degrees(probe.alpha0)),
        "mu": probe.mu,
        "increment": probe.increment,
        "E0": probe.confinement,
        "angle_deg": float(np.degrees(probe.angle)),
        "steps": steps,
        "contacts": "sliding" if probe.slides else "sticking",
        **errors,
        "replay_T": float(np.abs(replayed[probe.steps] - probe.T).max() / probe.N.max()),
    }


def external_and_contact_forces(probe: Probe, state: LineStates) -> dict[str, Floats]:
    """Forces of exact states by the names of Yade's: `F1, F2, N, T`, over `kn l0`.

    Parameters
    ----------
    probe : Probe
        The path.
    state : LineStates
        States on it.

    Returns
    -------
    dict of str to ndarray
    """
    F1 = 2.0 * np.sin(probe.alpha0) * state.s1
    F2 = 2.0 * np.cos(probe.alpha0) * state.s2
    return {"F1": F1, "F2": F2, "N": state.N, "T": state.T}


def _relative(yade: Floats, ours: Floats, floor: float) -> float:
    size = np.abs(ours).max()
    return float(np.abs(yade - ours).max() / size) if size > floor else float("nan")


def platform_check(probe: Probe) -> dict[str, float]:
    """The platform's own machinery on one probe, against the closed forms.

    Parameters
    ----------
    probe : Probe
        From `read_probes`.

    Returns
    -------
    dict
        `rates`: largest difference of the stress rates of `loops.affine_tangent` from the
        derivatives of the closed forms; `path`: of the stresses that `stability.follow` reaches.
    """
    law = LinearFrictional(1.0, KAPPA, probe.mu, probe.increment)
    box = 2.0 * np.sin(2.0 * probe.alpha0)  # L10 L20, the paper's reference area
    exact = exact_states(probe)
    graph = diamond(probe.alpha0, E1=exact.E1, E2=exact.E2, T=exact.T)
    regime = np.where(probe.sliding, Regime.SLIDING, Regime.ELASTIC)[:, None] * np.ones(4, int)
    K = restrict(affine_tangent(graph, law, regime=regime, volume=box).matrix, "diagonal")
    # The line's direction per unit of u, as strain rates.
    strain_rate = -probe.line.direction / half_diagonals(probe.alpha0, 0.0, 0.0)
    rates = K @ strain_rate - stress_rates(probe, exact)
    programme = programmes.proportional_strain(np.cos(probe.angle), np.sin(probe.angle))
    amplitude = np.hypot(probe.E1[-1] - probe.E1[0], probe.E2[-1] - probe.E2[0])
    start = diamond(probe.alpha0, E1=probe.E1[0], E2=probe.E2[0])
    path = follow(start, law, Stage(programme, "parameter", float(amplitude)), volume=box)
    reached = path.P[-1, [0, 3]] - [exact.s1[-1], exact.s2[-1]]
    return {"rates": float(np.abs(rates).max()), "path": float(np.abs(reached).max())}


def stress_rates(probe: Probe, state: LineStates) -> Floats:
    """Derivatives (n, 2) of `s1`, `s2` along the line, from those of N, T and alpha.

    Parameters
    ----------
    probe : Probe
        The line and the law.
    state : LineStates
        States on it, arrays (n,).

    Returns
    -------
    rates : ndarray (n, 2)
        Per unit of `u`.
    """
    line, u = probe.line, probe.u
    N_rate = -u / state.length
    turn = line.sense * line.distance / state.length**2
    arm = 1.0 if probe.increment == "radii" else state.length
    friction = probe.mu if np.isfinite(probe.mu) else 0.0
    T_rate = np.where(probe.sliding, line.sense * friction * N_rate, KAPPA * arm * turn)
    along, across = N_rate + state.T * turn, T_rate - state.N * turn
    cos, sin = np.cos(state.alpha), np.sin(state.alpha)
    s1_rate = (along * cos + across * sin) / np.sin(probe.alpha0)
    s2_rate = (along * sin - across * cos) / np.cos(probe.alpha0)
    return np.stack([s1_rate, s2_rate], axis=-1)
