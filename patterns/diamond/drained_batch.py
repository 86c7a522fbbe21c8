"""The end of the elastic drained path for whole sweeps of diamonds (theory note section 5)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from patterns.diamond.arguments import (
    FloatArray,
    acute_angle,
    confining_strain,
    drained_kappa,
    friction_angle,
)
from patterns.diamond.drained_falling import falling_yield
from patterns.diamond.drained_growing import PathRows, growing_yield
from patterns.diamond.drained_limit import strain_limit
from patterns.diamond.drained_state import DrainedState, drained_state, turning_stiffness

# Rows whose quadrature nodes fit the processor's cache together.
_CHUNK = 4096


@dataclass(frozen=True, eq=False)
class DrainedEnd:
    """Where the elastic part of drained paths ends; arrays (...).

    Attributes
    ----------
    status : ndarray (...) of str
        'yield': all four contacts reach `|T| = mu N`, point B. 'opening': without confinement
        and with `phi <= alpha0` the contacts never carry force; the state is A. 'limit': K22
        vanishes before yield and `E1` cannot grow on (only for `kappa > 3`). 'none': no event
        before alpha reaches 90 degrees or the grains' centres meet.
    direction : ndarray (...)
        +1 where alpha grows, -1 where it falls (`K22 < 0` at A). Where `K22 = 0` at A both
        directions raise `E1`; +1 is followed.
    state : DrainedState
        The state there, NaN where the status is 'none'.
    """

    status: NDArray[np.str_]
    direction: FloatArray
    state: DrainedState


def drained_end(
    alpha0: ArrayLike, kappa: ArrayLike, phi: ArrayLike, confinement: ArrayLike
) -> DrainedEnd:
    """End of the elastic drained path, `E1' > 0` and `s2' = 0` from the confined state A.

    Exact up to rounding: quadrature of the closed form, Newton's method on the branch angle.

    Parameters
    ----------
    alpha0 : array_like (...)
        Reference angle in (0, pi/2), radians.
    kappa : array_like (...)
        Stiffness ratio `kt/kn` in [0, 1000]. The cost grows with it
        beyond 3, where the limit of strain control is looked for.
    phi : array_like (...)
        Contact friction angle in [0, pi/2], radians; pi/2 means that nothing slides.
    confinement : array_like (...)
        Isotropic strain at A in [0, 1).

    Returns
    -------
    DrainedEnd
        Arrays of the broadcast shape.

    Raises
    ------
    InputError
        If a parameter leaves its range.

    Examples
    --------
    Point B of Table 1:

    >>> end = drained_end(np.pi / 4, 0.2, np.radians(5.0), 0.3)
    >>> str(end.status), round(float(end.state.E1), 12), round(float(end.state.s1), 12)
    ('yield', 0.40973434897, 0.254009900083)
    """
    arguments = np.broadcast_arrays(
        acute_angle("alpha0", alpha0),
        drained_kappa("kappa", kappa),
        friction_angle("phi", phi),
        confining_strain("confinement", confinement),
    )
    shape, rows = arguments[0].shape, PathRows(*(a.reshape(-1) for a in arguments))
    chunks = range(0, max(rows.alpha0.size, 1), _CHUNK)
    parts = [_ends(rows.take(slice(start, start + _CHUNK))) for start in chunks]
    status, direction, turn, T = (
        np.concatenate([part[k] for part in parts]).reshape(shape) for k in range(4)
    )
    return DrainedEnd(status, direction, drained_state(arguments[0], arguments[3], turn, T))


def _ends(paths: PathRows) -> tuple[NDArray[np.str_], FloatArray, FloatArray, FloatArray]:
    """Status, direction, turn and shear force of one chunk."""
    zero = np.zeros_like(paths.alpha0)
    K22 = turning_stiffness(paths.alpha0, paths.f, zero, paths.kappa)
    direction = np.where(K22 < 0.0, -1.0, 1.0)
    unloaded = (paths.confinement == 0.0) & ((paths.phi <= paths.alpha0) | (paths.kappa == 0.0))
    at_once, never = unloaded | (paths.phi == 0.0), paths.phi == 0.5 * np.pi
    turn, T = np.where(at_once, 0.0, np.nan), np.where(at_once, 0.0, np.nan)
    for solver, sign in ((growing_yield, 1.0), (falling_yield, -1.0)):
        rows = np.flatnonzero((direction == sign) & ~at_once & ~never)
        turn[rows], T[rows] = solver(paths.take(rows))
    status = np.where(np.isnan(turn), "none", np.where(unloaded, "opening", "yield"))
    rows = np.flatnonzero((direction > 0.0) & ~at_once)
    end = np.where(np.isnan(turn), 0.5 * np.pi - paths.alpha0, turn)
    limit_turn, limit_T = strain_limit(paths.take(rows), end[rows])
    limited = np.isfinite(limit_turn)
    found = rows[limited]
    status[found], turn[found], T[found] = "limit", limit_turn[limited], limit_T[limited]
    return status, direction, turn, T
