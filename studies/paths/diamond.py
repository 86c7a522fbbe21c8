"""The paper's diamond followed to A (isotropic strain) and B (drained), and its closed forms.

Strains and shear forces are those of the path; operators follow by the paper's closed forms. A
contact added between opposite grains lies along an axis, so that it neither turns nor shears: its
force is the overlap, and it adds `1/tan(alpha0)` to K11 or `tan(alpha0)` to K22.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import cached_property

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray

from loops import GrainGraph, Regime
from loops.arrays import Flags, Floats
from patterns.diamond import (
    DiamondParameters,
    angle_from_strains,
    determinant_elastic,
    determinant_sliding,
    elastic_moduli,
    external_forces,
    geometric_tangent,
    material_tangent,
    opposite_gaps,
    overlap_ratio,
    sliding_moduli,
)
from patterns.diamond.closed_form import (
    geometric_asymmetry,
    material_asymmetry,
    opposite_contact_strain,
)
from stability import (
    Path,
    PolarDiagram,
    alpha_e,
    directional_work,
    normalised_second_order_work,
    operator_norm,
    plane_cone,
    statuses,
)
from studies.paths.followed import Followed, follow_path, operator_diagram, plane_columns
from studies.paths.options import DiamondOptions

NAMED = {"det_K_zero": "I", "programme_change": "A", "yield": "B"}
DETERMINANTS = ("det_Ks_zero", "det_K_zero")
# Kinds of events in the summary; the remaining events of a path follow from these.
LISTED_KINDS = (
    "opposite_contact", *DETERMINANTS, "programme_change", "yield", "unloading", "opening",
    "control_limit",
)  # fmt: skip
# Rounding of the angle, within which opposite grains touch in the reference.
TOUCHING_ATOL = 4.0 * np.finfo(np.float64).eps
# Contacts are at yield if |T| lacks at most this share of mu N.
YIELD_RTOL = 1e-9
# Opposite grains on axis 1 and on axis 2.
OPPOSITE = ([0, 2], [1, 3])


@dataclass(frozen=True, eq=False)
class DiamondStates:
    """States of a diamond with their tangents; arrays (n, ...), radians.

    Forces are over `kn l0`, stresses over `kn`; T is positive when alpha grows. `added (n, 2)`
    tells whether the opposite grains on axis 1, and on axis 2, share a contact. The tangent
    `K (n, 2, 2)` of `s' = K E'` is `material + geometric` (25) to (28), an added contact being
    material; determinants (35), (36), and `det Ks = det K - ((K12 - K21)/2)^2`.
    """

    E1: Floats
    E2: Floats
    alpha: Floats
    N: Floats
    T: Floats
    s1: Floats
    s2: Floats
    sliding: Flags
    added: Flags
    K: Floats
    material: Floats
    geometric: Floats
    det_K: Floats
    det_Ks: Floats

    @property
    def length(self) -> Floats:
        """Branch length over `l0`."""
        return 1.0 - self.N

    @property
    def regime(self) -> NDArray[np.str_]:
        """Regime of the four contacts, 'elastic' or 'sliding'."""
        return np.where(self.sliding, "sliding", "elastic")

    def take(self, rows: NDArray[np.intp] | Sequence[int] | slice) -> DiamondStates:
        """States at these rows."""
        return DiamondStates(*(getattr(self, field.name)[rows] for field in fields(self)))


def diamond_states(
    loop: DiamondParameters,
    E1: ArrayLike,
    E2: ArrayLike,
    T: ArrayLike = 0.0,
    *,
    sliding: ArrayLike = False,
    added: ArrayLike = (False, False),
    N: Floats | None = None,
    s1: Floats | None = None,
    s2: Floats | None = None,
) -> DiamondStates:
    """States (n,) at strains and shear forces, their contacts sticking or sliding.

    Normal force and stresses follow in closed form unless they are given.
    """
    rows = [np.atleast_1d(np.asarray(value, dtype=float)) for value in (E1, E2, T)]
    E1, E2, T = np.broadcast_arrays(*rows)
    sliding = np.broadcast_to(np.asarray(sliding, dtype=bool), E1.shape)
    added = np.broadcast_to(np.asarray(added, dtype=bool), (E1.size, 2))
    alpha0, t0, alpha = loop.alpha0, np.tan(loop.alpha0), angle_from_strains(E1, E2, loop.alpha0)
    N = overlap_ratio(E1, E2, alpha0) if N is None else N
    overlap = -np.stack(opposite_gaps(E1, E2, alpha0), axis=-1) * added
    # Shares of the added contacts in the stresses: they don't turn with the branches.
    across1, across2 = (
        overlap[:, 0] / (2.0 * np.sin(alpha0)),
        overlap[:, 1] / (2.0 * np.cos(alpha0)),
    )
    F1, F2 = external_forces(N, T, alpha)
    s1 = F1 / (2.0 * np.sin(alpha0)) + across1 if s1 is None else s1
    s2 = F2 / (2.0 * np.cos(alpha0)) + across2 if s2 is None else s2
    turning = E1, E2, s1 - across1, s2 - across2
    # Friction may be infinite where nothing slides.
    sign, mu = np.where(T < 0.0, -1.0, 1.0), loop.mu if sliding.any() else 0.0
    pairs = zip(sliding_moduli(alpha, mu, sign), elastic_moduli(loop.kappa), strict=True)
    moduli = (np.where(sliding, slip, stick) for slip, stick in pairs)
    bare = material_tangent(E1, E2, alpha0, *moduli)
    geometric = geometric_tangent(*turning, alpha0)
    springs = np.stack([added[:, 0] / t0, added[:, 1] * t0], axis=-1)
    slip_det, stick_det = (
        determinant_sliding(*turning, alpha, mu, sign),
        determinant_elastic(*turning, alpha, loop.kappa),
    )
    ring = bare + geometric
    det_K = np.where(sliding, slip_det, stick_det) + springs.prod(axis=-1)
    det_K = det_K + springs[:, 0] * ring[:, 1, 1] + springs[:, 1] * ring[:, 0, 0]
    asymmetry = geometric_asymmetry(*turning, alpha)
    asymmetry = asymmetry + np.where(sliding, material_asymmetry(mu, sign), 0.0)
    material = bare + springs[:, :, None] * np.eye(2)
    return DiamondStates(
        *(E1, E2, alpha, N, T, s1, s2, sliding, added),
        *(material + geometric, material, geometric, det_K, det_K - (0.5 * asymmetry) ** 2),
    )


def state_columns(states: DiamondStates) -> pd.DataFrame:
    """Columns of a diamond's table that follow from its states alone."""
    cone = plane_cone(states.K)
    ray = cone.status == "ray"
    edges = np.where(ray[:, None], cone.axis[:, None], cone.edges)
    plane = plane_columns(states.K, states.det_K, states.det_Ks)
    parts = {"K": states.K, "Kmat": states.material, "Kgeo": states.geometric}
    columns = {
        "regime": states.regime,
        "E1": states.E1,
        "E2": states.E2,
        "alpha_deg": np.degrees(states.alpha),
        "l": states.length,
        "N": states.N,
        "T": states.T,
        "s1": states.s1,
        "s2": states.s2,
        **{f"{name}{i + 1}{j + 1}": part[:, i, j]
           for name, part in parts.items() for i in range(2) for j in range(2)},
        **plane,
        "status": statuses(plane["lambda_1"].to_numpy(), operator_norm(states.K)),
        "cone_edge_1_deg": np.degrees(edges[:, 0]),
        "cone_edge_2_deg": np.degrees(edges[:, 1]),
        "unstable_fraction": plane["cone_opening_deg"] / 180.0,
    }  # fmt: skip
    return pd.DataFrame(columns)


@dataclass(frozen=True, eq=False)
class FollowedDiamond(Followed):
    """A diamond's path; `marks` are I (det K = 0 in the confinement), A and B, where reached.

    `listed` are the events as (kind, row), every row the state as the path arrives there.
    """

    options: DiamondOptions
    loop: DiamondParameters
    states: DiamondStates
    listed: tuple[tuple[str, int], ...]

    @cached_property
    def energies(self) -> dict[str, Floats]:
        """`work` from outside, `stored` in the contacts and `dissipated`, over `kn L10 L20`."""
        path = self.path
        stored = path.normal_energy + path.tangential_energy
        given = {"work": path.work[:, 0], "stored": stored, "dissipated": path.work[:, 3]}
        return {name: values / path.volume for name, values in given.items()}

    @cached_property
    def beyond(self) -> DiamondStates | None:
        """State B with sliding contacts, as they are beyond it; None if the path has no B."""
        if "B" not in self.marks:
            return None
        row, states = self.marks["B"], self.states
        at = (states.E1[row], states.E2[row], states.T[row])
        return diamond_states(self.loop, *at, sliding=True, added=states.added[row])

    @cached_property
    def diagrams(self) -> dict[str, tuple[PolarDiagram, Flags]]:
        """Polar diagrams of the named states, and whether the contacts slide in each direction.

        At B the direction decides on the regime, elastic or sliding.
        """
        path, graph, diagrams = self.path, self.options.graph(), {}
        for name, row in self.marks.items():
            closed = path.regime[row] != Regime.OPEN
            here = GrainGraph(
                x=path.x[row],
                x0=graph.x,
                radii=graph.radii,
                contacts=path.contacts[closed],
                normal_force=path.normal_force[row, closed],
                shear_force=path.shear_force[row, closed],
            )
            one = operator_diagram(self.K[row])
            work = directional_work(here, self.options.law(), one.direction, volume=path.volume)
            diagrams[name] = (
                operator_diagram(self.K[row], work.normalised[:, 0]),
                work.regime[:, 0] == Regime.SLIDING,
            )
        return diagrams

    @cached_property
    def table(self) -> pd.DataFrame:
        """Table of the path, one row per state.

        `stage, regime`; `E1, E2, alpha_deg, l, N, T, s1, s2`; K, Kmat (27), Kgeo (28) by
        components; `det_K, det_Ks`; eigenvalues of Ks, `lambda_*`, and of K; `status` of the
        second-order work; the cone, angles from E1 towards E2; `loading_alphaE_deg, w2_loading`
        along the path's own direction; `gap_*` between opposite grains, `chord_*` forces of
        contacts added there; energies.
        """
        direction, chords = self.direction, on_axes(self.path, self.path.normal_force)
        gaps = opposite_gaps(self.E1, self.E2, self.loop.alpha0)
        moves = np.isfinite(direction[:, 0])
        w2 = normalised_second_order_work(self.K, np.where(moves[:, None], direction, 1.0))
        alpha = alpha_e(np.arctan2(direction[:, 1], direction[:, 0]))
        more: dict[str, Floats] = {
            "loading_alphaE_deg": np.degrees(alpha),
            "w2_loading": np.where(moves, w2, np.nan),
            **{f"gap_{axis}": gap for axis, gap in enumerate(gaps, start=1)},
            **{f"chord_{axis}": chords[:, axis - 1] for axis in (1, 2)},
            **self.energies,
        }
        table = state_columns(self.states).assign(**more)
        table.insert(0, "stage", self.stage)
        return table


def follow_diamond(options: DiamondOptions) -> FollowedDiamond:
    """Follow a diamond through the whole programme.

    >>> found = follow_diamond(DiamondOptions(table=1))
    >>> {name: round(float(found.E1[row]), 6) for name, row in found.marks.items()}
    {'I': 0.166667, 'A': 0.3, 'B': 0.409734}
    """
    path, loop = follow_path(options), options.parameters
    states = diamond_states(
        *(loop, path.H[:, 0], path.H[:, 3], path.shear_force[:, 0]),
        sliding=path.regime[:, 0] == Regime.SLIDING,
        added=on_axes(path, path.regime != Regime.OPEN) > 0.0,
        N=path.normal_force[:, 0],
        s1=path.P[:, 0],
        s2=path.P[:, 3],
    )
    listed, marks = listed_events(options, path, states), dict[str, int]()
    for kind, row in listed:
        name = NAMED.get(kind)
        if name and name not in marks and (name != "I" or path.stage[row] == 0):
            marks[name] = row
    operators = states.K, states.det_K, states.det_Ks
    return FollowedDiamond(options, path, marks, *operators, loop, states, listed)


def listed_events(
    options: DiamondOptions, path: Path, states: DiamondStates
) -> tuple[tuple[str, int], ...]:
    """Events of the summary as (kind, row), each once; A is among them however the path ends."""
    loop, listed = options.parameters, list[tuple[str, int]]()
    apart = np.array(touching_strains(loop)) >= 0.0
    for event in path.events:
        row = event.index
        if event.kind == "opposite_contact" and not apart[event.contacts[0]]:
            continue
        jumps = event.kind in DETERMINANTS and event.detail.startswith("jump")
        if event.kind not in LISTED_KINDS or jumps or (event.kind, row) in listed:
            continue
        at_yield = abs(states.T[row]) >= loop.mu * states.N[row] * (1.0 - YIELD_RTOL)
        if event.kind == "control_limit" and event.contacts and at_yield:
            listed.append(("yield", row))
        listed.append((event.kind, row))
    if len(options.stages()) == 1:
        return (*listed, ("programme_change", 0), ("opening", 0))
    if min(loop.kappa, loop.mu) == 0.0:
        # Without shear stiffness or friction det K = -N/l: never positive.
        listed = [*((kind, 0) for kind in DETERMINANTS), *listed]
    if loop.mu == 0.0:
        at_A = next(k for k, (kind, _) in enumerate(listed) if kind == "programme_change")
        listed.insert(at_A + 1, ("yield", listed[at_A][1]))
    return tuple(listed)


def touching_strains(loop: DiamondParameters) -> tuple[float, float]:
    """Strains E1 and E2 at which the opposite grains on axis 1, and on axis 2, meet.

    `1 - l0/L10` and `1 - l0/L20`; negative where the grains overlap from the start.
    """
    on1, on2 = (1.0 - 0.5 / length for length in (np.cos(loop.alpha0), np.sin(loop.alpha0)))
    first = float(opposite_contact_strain(loop.alpha0))
    # At 45 degrees both pairs meet at once, whatever the rounding of sine and cosine.
    on1, on2 = (first if abs(E - first) <= TOUCHING_ATOL else float(E) for E in (on1, on2))
    return tuple(0.0 if abs(E) <= TOUCHING_ATOL else E for E in (on1, on2))  # type: ignore[return-value]


def on_axes(path: Path, values: NDArray[np.generic]) -> Floats:
    """(R, 2) values of the contacts added on axis 1 and on axis 2, zero where there is none."""
    columns = np.zeros((len(path), 2))
    for axis, grains in enumerate(OPPOSITE):
        here = np.flatnonzero((np.sort(path.contacts, axis=1) == grains).all(axis=1))
        columns[:, axis] = values[:, here].sum(axis=1)
    return columns
