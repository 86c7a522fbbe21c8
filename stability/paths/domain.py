"""First limits of one loop along straight programmes: a domain is many paths."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from loops import Scene
from loops.arrays import Flags, Floats, Regimes
from loops.closures import Closure, Spins
from loops.laws.frictional import Regime
from stability.path import Path
from stability.paths.loop_path import RELEASE, SINGULAR_RTOL, LoopPathOptions, follow_loop
from stability.paths.model import law_scale
from stability.programmes import Stage, proportional_strain, proportional_stress
from stability.spectra import operator_norm, restrict, symmetric_spectrum

Control = Literal["strain", "stress"]
CONTROLS = {"strain": proportional_strain, "stress": proportional_stress}
# Limits of a programme, in the order in which they are named.
SPECTRAL = ("cone_opening", "det_Ks_zero", "det_K_zero")
LIMITS = (*SPECTRAL, "yield", "opening", "branching", "limit")
# Events beyond which a programme is not followed.
LAST = ("det_K_zero", "opening")
# Stress over kn at which programmes of stress end, over their reach in strain.
STRESS_REACH = 5.0


@dataclass(frozen=True, eq=False)
class Fan:
    """Programmes `(cos b, sin b)` of the strains H11, H22 or stresses P11, P22, no shear strain.

    `loop`: Its grains, law and start; `programme` (B,): Angles b; `reach`: Strain at their ends.
    """

    loop: Scene
    closure: Closure
    spins: Spins
    control: Control
    programme: Floats
    reach: float


class States(NamedTuple):
    """One state a programme: `H`, `P` (B, 4), centres `x` (B, G, 2), `regime` (B, C)."""

    H: Floats
    P: Floats
    x: Floats
    regime: Regimes


@dataclass(frozen=True, eq=False)
class FanLimits:
    """First limits along the programmes of a fan, and their ends.

    `found` (B,) and `states` by kind: `LIMITS`, or 'end', the last state of a programme. Of a limit
    reached in a jump the regimes are those after it.
    """

    found: dict[str, Flags]
    states: dict[str, States]

    @classmethod
    def none(cls, fan: Fan) -> FanLimits:
        """No limit found on any programme."""
        B, graph, kinds = len(fan.programme), fan.loop.graph, (*LIMITS, "end")
        H, x = np.zeros((B, 4)), np.zeros((B, *graph.x.shape))
        regime = np.zeros((B, graph.contact_count), dtype=np.int8)
        none = {kind: np.zeros(B, dtype=bool) for kind in kinds}
        return cls(none, {k: States(H.copy(), H.copy(), x.copy(), regime.copy()) for k in kinds})

    def follow(self, fan: Fan, row: int) -> None:
        """Follow one programme to where det K is lost, a contact opens or its reach ends."""
        options = LoopPathOptions(fan.spins, ("diagonal", "symmetric"))
        b = float(fan.programme[row])
        load = CONTROLS[fan.control](np.cos(b), np.sin(b))
        end = fan.reach
        if fan.control == "stress":
            end *= STRESS_REACH * law_scale(fan.loop.contact_state, fan.loop.law)
        stages = [Stage(load, "parameter", end)]
        path = follow_loop(fan.loop, stages, fan.closure, options, rows=1, stop=LAST)
        for kind, at, values in limits_of(path):
            if not self.found[kind][row]:
                self.found[kind][row] = True
                H, P, x, regime = self.states[kind]
                H[row], P[row], x[row] = values
                regime[row] = path.regime[at]


def limits_of(path: Path) -> Iterator[tuple[str, int, tuple[ArrayLike, ...]]]:
    """Limits along a path: kind, row of its regimes, `H`, `P` and `x`."""

    def state(at: int) -> tuple[ArrayLike, ...]:
        return path.H[at], path.P[at], path.x[at]

    def parting(at: int) -> Flags:
        N, T = np.abs(path.normal_force[at]), np.abs(path.shear_force[at])
        closed = path.regime[at] != Regime.OPEN
        return np.asarray(closed & (N <= RELEASE * np.maximum(N, T).max()))

    # A path whose first tangent has no single value begins on a mechanism.
    stable = stability_measures(path.A[0]) > SINGULAR_RTOL
    begun = [kind for kind, holds in zip(SPECTRAL, stable, strict=True) if not holds]
    for kind in begun:
        yield kind, 0, state(0)
    lost = path.H[0] if "det_K_zero" in begun else None
    for event in path.events:
        # Events of the state at which det K is lost still count.
        if lost is not None and np.abs(np.subtract(lost, event.H)).max() > SINGULAR_RTOL:
            break
        kind, at = str(event.kind), event.index
        if kind == "control_limit":
            # A contact parts, and nothing goes on; or no regimes agree.
            kind = "opening" if parting(at)[list(event.contacts)].any() else "limit"
        if event.subspace == "symmetric":
            kind = "cone_opening" if kind == "det_Ks_zero" else ""
        if kind in LIMITS and event.cause != "stage_end":
            x, jumps = path.x[at], at + 1 < len(path) and (path.H[at + 1] == event.H).all()
            if kind == "branching":
                # Between two rows.
                way, whole = (np.linalg.norm(H - path.H[at]) for H in (event.H, path.H[at + 1]))
                x = x + way / whole * (path.x[at + 1] - x)
            yield kind, at + int(jumps), (event.H, event.P, x)
            lost = event.H if kind == "det_K_zero" else lost
        if kind in ("opening", "limit"):
            break
    if path.status == "lost" and parting(-1).any():
        # A contact that sticks parts while it carries a shear force.
        yield "opening", len(path) - 1, state(-1)
    yield "end", len(path) - 1, state(-1)


def stability_measures(A: Floats) -> Floats:
    """(3,) numbers of `SPECTRAL`, positive where stable, of a tangent (4, 4).

    Smallest eigenvalues of Ks over the norm of K, in `symmetric` and in (11, 22), and the smallest
    real part of those of K in (11, 22); not numbers without a tangent.
    """
    if not np.isfinite(A).all():
        return np.full(3, np.nan)
    whole, plane = restrict(A, "symmetric"), restrict(A, "diagonal")
    sizes = np.array([operator_norm(whole), operator_norm(plane), operator_norm(plane)])
    least = symmetric_spectrum(whole)[0], symmetric_spectrum(plane)[0]
    real = np.linalg.eigvals(plane).real.min()
    return np.asarray(np.array([*least, real]) / np.maximum(sizes, np.finfo(float).tiny))
