"""First limits of one loop along straight programmes: a domain is many paths."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from loops import Scene, contact_state
from loops.arrays import Flags, Floats, Regimes
from loops.closures import Closure, Spins
from loops.laws.frictional import TOUCHING_RTOL, Regime
from stability.paths.loop_path import LoopPathOptions
from stability.paths.of_graph import follow_loop
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
# A normalised eigenvalue this small is zero.
SINGULAR_RTOL = 1e-12


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
        b, watched, graph = float(fan.programme[row]), ("diagonal", "symmetric"), fan.loop.graph
        load = CONTROLS[fan.control](np.cos(b), np.sin(b))
        end = fan.reach * (1.0 if fan.control == "strain" else STRESS_REACH)
        options = LoopPathOptions(spins=fan.spins, subspace=watched)
        stages = [Stage(load, "parameter", end)]
        path = follow_loop(fan.loop, stages, fan.closure, options, rows=1, stop=LAST)

        def record(kind: str, at: int) -> None:
            if not self.found[kind][row]:
                self.found[kind][row] = True
                H, P, x, regime = self.states[kind]
                H[row], P[row], x[row] = path.H[at], path.P[at], path.x[at]
                regime[row] = path.regime[at]

        # A path whose first tangent has no single value begins on a mechanism.
        for kind, measure in zip(SPECTRAL, stability_measures(path.A[0]), strict=True):
            if not measure > SINGULAR_RTOL:
                record(kind, 0)
        before, after = (contact_state(graph.replace(x=x)) for x in (graph.x, path.x[-1]))
        apart = [
            state.overlap < -TOUCHING_RTOL * state.touching_length for state in (before, after)
        ]
        if ((path.regime[0] == Regime.OPEN) & apart[1] & ~apart[0]).any():
            # Contacts that just touch part at once.
            record("opening", 0)
            return
        for event in path.events:
            lost = self.states["det_K_zero"].H[row]
            # Events of the state at which det K is lost still count.
            if self.found["det_K_zero"][row] and np.abs(lost - event.H).max() > SINGULAR_RTOL:
                break
            kind = "limit" if event.kind == "control_limit" else str(event.kind)
            if event.subspace == "symmetric":
                kind = "cone_opening" if kind == "det_Ks_zero" else ""
            if kind in LIMITS and event.cause != "stage_end":
                jumps = event.index + 1 < len(path) and (path.H[event.index + 1] == event.H).all()
                record(kind, event.index + int(jumps))
            if kind in ("opening", "limit"):
                break
        record("end", len(path) - 1)


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
