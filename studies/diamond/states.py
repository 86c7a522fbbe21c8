"""States along the path of a diamond."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import ArrayLike, NDArray

from loops import GrainGraph
from patterns import diamond
from patterns.diamond import DiamondParameters as LoopParameters
from patterns.diamond import angle_from_strains, external_forces, opposite_gaps, overlap_ratio

Floats = NDArray[np.float64]
OPPOSITE = ((0, 2), (1, 3))


@dataclass(frozen=True, eq=False)
class States:
    """States of a diamond in the order of its path; arrays (n,), dimensionless (`kn = l0 = 1`).

    Attributes
    ----------
    stage : ndarray of str
        Stage of the programme, 'isotropic' or 'drained'.
    slip : ndarray
        What multiplies `mu` in the moduli of (20): 0 where contacts stick, `sign(T)` where they
        slide by Coulomb's law, `zeta_n zeta_t` where they slide by (8c) as printed.
    chords : ndarray (n, 2) of bool
        Whether the opposite grains on axis 1, and on axis 2, share an added contact.
    E1, E2 : ndarray
        Strains, compression positive.
    length, alpha : ndarray
        Branch length over `l0` and branch angle, radians.
    N, T : ndarray
        Contact forces over `kn l0`; N compression positive, T positive when alpha grows.
    s1, s2 : ndarray
        Stresses `S/kn`, compression positive, added contacts included.
    """

    stage: NDArray[np.str_]
    slip: Floats
    chords: NDArray[np.bool_]
    E1: Floats
    E2: Floats
    length: Floats
    alpha: Floats
    N: Floats
    T: Floats
    s1: Floats
    s2: Floats

    @property
    def regime(self) -> NDArray[np.str_]:
        """Regime of the four contacts, 'elastic' or 'sliding'."""
        return np.where(self.slip == 0.0, "elastic", "sliding")

    def take(self, rows: NDArray[np.intp] | Sequence[int] | slice) -> States:
        """The picked rows."""
        return States(*(getattr(self, field.name)[rows] for field in fields(self)))


def concatenate(parts: Sequence[States]) -> States:
    """States one after the other.

    Parameters
    ----------
    parts : sequence of States
        At least one.

    Returns
    -------
    States
    """
    columns = ([getattr(part, field.name) for part in parts] for field in fields(States))
    return States(*(np.concatenate(column) for column in columns))


def states_from_strains(
    loop: LoopParameters,
    E1: ArrayLike,
    E2: ArrayLike,
    T: ArrayLike = 0.0,
    *,
    stage: str = "isotropic",
    slip: float = 0.0,
    chords: tuple[bool, bool] = (False, False),
) -> States:
    """States of known strains and shear force: branch, forces and stresses follow.

    Parameters
    ----------
    loop : patterns.diamond.DiamondParameters
        The diamond.
    E1, E2, T : array_like (n,)
        Strains and shear force of the four contacts.
    stage : str
        Stage of the programme.
    slip : float
        See `States`.
    chords : tuple of bool
        Whether opposite grains share an added contact, on axis 1 and on axis 2. Its force is
        `-gap`: unloaded where they touch.

    Returns
    -------
    States

    Examples
    --------
    >>> from patterns.diamond import TABLE_1
    >>> from studies.diamond.states import states_from_strains
    >>> states_from_strains(TABLE_1, [0.0, 0.25], [0.0, 0.25]).length.tolist()
    [1.0, 0.75]
    """
    strains = np.atleast_1d(np.asarray(E1, dtype=np.float64)), np.atleast_1d(E2), np.atleast_1d(T)
    E1, E2, T = (np.array(a, dtype=np.float64) for a in np.broadcast_arrays(*strains))
    N, alpha = overlap_ratio(E1, E2, loop.alpha0), angle_from_strains(E1, E2, loop.alpha0)
    F1, F2 = external_forces(N, T, alpha)
    gap1, gap2 = opposite_gaps(E1, E2, loop.alpha0)
    F1, F2 = F1 - gap1 * chords[0], F2 - gap2 * chords[1]
    return States(
        stage=np.full(E1.shape, stage),
        slip=np.full(E1.shape, slip),
        chords=np.tile(np.array(chords), (E1.size, 1)),
        E1=E1,
        E2=E2,
        length=1.0 - N,
        alpha=alpha,
        N=N,
        T=T,
        s1=F1 / (2.0 * np.sin(loop.alpha0)),
        s2=F2 / (2.0 * np.cos(loop.alpha0)),
    )


def isotropic_states(
    loop: LoopParameters, E: ArrayLike, chords: tuple[bool, bool] = (False, False)
) -> States:
    """States under isotropic strain: `alpha = alpha0`, `T = 0`, stresses (39).

    Parameters
    ----------
    loop : patterns.diamond.DiamondParameters
        The diamond.
    E : array_like (n,)
        Isotropic strains in [0, 1).
    chords : tuple of bool
        As in `states_from_strains`.

    Returns
    -------
    States

    Examples
    --------
    >>> from patterns.diamond import TABLE_1
    >>> from studies.diamond.states import isotropic_states
    >>> isotropic_states(TABLE_1, [0.0, 0.25]).N.tolist()
    [0.0, 0.25]
    """
    E = np.atleast_1d(np.asarray(E, dtype=np.float64))
    t0, gaps = np.tan(loop.alpha0), np.stack(opposite_gaps(E, E, loop.alpha0), axis=-1)
    extra = np.where(chords, -gaps, 0.0)
    return States(
        stage=np.full(E.shape, "isotropic"),
        slip=np.zeros_like(E),
        chords=np.tile(np.array(chords), (E.size, 1)),
        E1=E,
        E2=E,
        length=1.0 - E,
        alpha=np.full(E.shape, loop.alpha0),
        N=E,
        T=np.zeros_like(E),
        s1=E / t0 + extra[:, 0] / (2.0 * np.sin(loop.alpha0)),
        s2=E * t0 + extra[:, 1] / (2.0 * np.cos(loop.alpha0)),
    )


def chord_forces(loop: LoopParameters, states: States) -> Floats:
    """Forces of added contacts over `kn l0`, zero where there is none.

    Parameters
    ----------
    loop : patterns.diamond.DiamondParameters
        The diamond.
    states : States
        Where.

    Returns
    -------
    ndarray (n, 2)
        On axis 1 and on axis 2, compression positive.
    """
    gaps = np.stack(opposite_gaps(states.E1, states.E2, loop.alpha0), axis=-1)
    return np.where(states.chords, np.maximum(-gaps, 0.0), 0.0)


def loop_graph(loop: LoopParameters, states: States) -> GrainGraph:
    """The grain graph of a diamond at states of its path.

    Parameters
    ----------
    loop : patterns.diamond.DiamondParameters
        The diamond.
    states : States
        Where.

    Returns
    -------
    GrainGraph
        Batch axis (n,). Where some state has added contacts there are six, (0, 2) and (1, 3) last.
    """
    graph = diamond(loop.alpha0, E1=states.E1, E2=states.E2, T=states.T)
    if not states.chords.any():
        return graph
    force = chord_forces(loop, states)
    return graph.replace(
        contacts=np.concatenate([graph.contacts, OPPOSITE]),
        normal_force=np.concatenate([graph.normal_force, force], axis=-1),
        shear_force=np.concatenate([graph.shear_force, 0.0 * force], axis=-1),
    )
