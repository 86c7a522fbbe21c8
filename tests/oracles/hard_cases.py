"""Registry of hard cases: states for every method, with the expected answers."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from loops import ContactLaw, GrainGraph, InputError, LinearFrictional, Regime
from patterns import diamond, polydisperse_polygon, regular_polygon
from tests.oracles.diamond import TABLE_1, DiamondParameters
from tests.oracles.drained import drained_path

# Letters of an answer, one for each value.
LETTERS = dict(s="stable", u="unstable", e="error", y="yes", n="no") | {"?": "undetermined"}


@dataclass(frozen=True, eq=False)
class CaseState:
    """A state to compute with; regimes are read from the state if None.

    `stages` of a path are a programme by its name, a quantity and the value at which it ends.
    """

    graph: GrainGraph
    law: ContactLaw
    regime: ArrayLike | None = None
    spins: Literal["blocked", "affine", "free"] = "blocked"
    stages: tuple[tuple[str, str, float], ...] = ()


@dataclass(frozen=True, eq=False)
class HardCase:
    """A named hard case (docs/evidence/accuracy.md).

    `values` of `parameter` go from mild to extreme, often beyond the reach of double precision;
    `build` makes the state of one, or raises `InputError` where there is none. `expected` has one
    letter a value: for tangents by closure, and `regime`, that of contact 0 as read from the state
    (`o` open, `e` elastic, `s` sliding); for faces `loops`, `e` where they are refused.
    Paths, under the affine closure, end with `status` after `events` of these kinds in this order;
    `place` is the exact `H11` of the last one, from closed forms.
    """

    name: str
    description: str
    kind: Literal["tangent", "path", "faces"]
    parameter: str
    values: tuple[float, ...]
    build: Callable[[float], CaseState]
    expected: Mapping[str, str] = field(default_factory=dict)
    status: str = ""
    events: tuple[str, ...] = ()
    place: Callable[[float], float] | None = None


# kt/kn of the cases.
KAPPA = 0.3
# Friction of the cases.
MU = 0.5
CASE_LAW = LinearFrictional(kn=1.0, kt=KAPPA, mu=MU)
RADII = (0.5, 0.6, 0.45, 0.55, 0.5, 0.4)
SPOKES = 24
# kappa and friction of Table 1 of Nicot et al. 2016.
KAPPA_1, MU_1 = 0.2, float(np.tan(np.radians(5.0)))


def on_diamond(
    strain: float, kappa: float = KAPPA, mu: float = MU, T: float = 0.0, alpha0: float = 0.6
) -> CaseState:
    """Diamond under an isotropic strain, and a shear force."""
    return CaseState(diamond(alpha0, E1=strain, E2=strain, T=T), LinearFrictional(1.0, kappa, mu))


def path_of_diamond(
    strain: float,
    programme: str,
    quantity: str,
    end: float,
    alpha0: float = 0.25 * np.pi,
    kappa: float = KAPPA_1,
) -> CaseState:
    """A path from an isotropic strain on."""
    start, law = diamond(alpha0, E1=strain, E2=strain), LinearFrictional(1.0, kappa, MU_1)
    return CaseState(start, law, stages=((programme, quantity, end),))


def all_yield_at_once(shear: float) -> CaseState:
    """Table 1 from A, with small, different shear forces in the four contacts."""
    scene = path_of_diamond(0.3, "drained_biaxial", "H11", 0.42)
    own = scene.graph.replace(shear_force=shear * np.array([1.0, -0.5, 0.25, 0.75]))
    return CaseState(own, scene.law, stages=scene.stages)


def mobilised_diamond(strain: float, mobilised: float) -> CaseState:
    """Diamond with `|T| = mobilised mu N`, of either sign."""
    loaded = diamond(0.6, E1=strain, E2=strain)
    signs = np.array([1.0, -1.0, 1.0, -1.0])
    return CaseState(
        loaded.replace(shear_force=MU * loaded.normal_force * mobilised * signs), CASE_LAW
    )


def loaded_hexagon(strain: float, mobilised: float) -> CaseState:
    """Irregular hexagon of overlap `strain` with `|T| = mobilised mu N`."""
    ring = polydisperse_polygon(RADII, strain=strain)
    sides = np.array([1.0, 1.0, -1.0, 1.0, -1.0, -1.0])
    return CaseState(ring.replace(shear_force=mobilised * MU * sides * ring.normal_force), CASE_LAW)


def squashed_hexagon(height: float) -> CaseState:
    """Hexagon flattened to `height`: all branches nearly on one line."""
    ring = regular_polygon(6, strain=0.05)
    flat = np.array([1.0, height])
    return CaseState(ring.replace(x=ring.x * flat, x0=ring.x0 * flat), CASE_LAW)


def ring_with(order: int, kt: float) -> CaseState:
    """Regular ring whose first contact has a shear stiffness of its own."""
    own = np.append(kt, np.full(order - 1, KAPPA))
    return CaseState(regular_polygon(order, strain=0.1), LinearFrictional(1.0, own, MU))


def coincident_grains(distance: float) -> CaseState:
    """Pentagon with the centre of grain 1 at `distance` from that of grain 0."""
    ring = regular_polygon(5, strain=0.05)
    x = ring.x.copy()
    x[1] = x[0] + np.array([0.0, distance])
    d = np.roll(x, -1, axis=0) - x
    overlap = np.maximum(1.0 - np.hypot(d[:, 0], d[:, 1]), 0.0)
    graph = GrainGraph(x, ring.radii, ring.contacts, normal_force=overlap)
    # All contacts are elastic, also the one whose branch grew longer.
    return CaseState(graph, CASE_LAW, regime=np.full(5, Regime.ELASTIC))


def parallel_half_edges(ulps: float, pairs: int = SPOKES) -> CaseState:
    """A hub with spokes in pairs, the two directions of a pair `ulps` units of rounding apart.

    Grain 2k + 1 lies on the unit circle, grain 2k + 2 twice as far out, its ordinate moved by so
    many units in the last place against the clock where the abscissa is the larger one, else its
    abscissa. The outer grain's contact comes first: a sort that keeps ties in order gets every
    pair wrong. With the rim the pairs make `2 pairs` loops of three; half of them are
    slivers.
    """
    angle = 2.0 * np.pi * (np.arange(pairs) + 0.37) / pairs
    near = np.column_stack([np.cos(angle), np.sin(angle)])
    far = 2.0 * near
    axis = (np.abs(near[:, 0]) > np.abs(near[:, 1])).astype(int)
    rows = np.arange(pairs)
    turn = np.where(axis == 1, np.sign(near[:, 0]), -np.sign(near[:, 1]))
    far[rows, axis] += turn * ulps * np.spacing(np.abs(far[rows, axis]))
    x = np.vstack([np.zeros((1, 2)), np.stack([near, far], axis=1).reshape(-1, 2)])
    first, second = 2 * rows + 1, 2 * rows + 2
    hub = np.zeros(pairs, dtype=int)
    one, two = [hub, hub, first, second], [second, first, second, np.roll(first, -1)]
    contacts = np.stack([np.concatenate(one), np.concatenate(two)], axis=1)
    graph = GrainGraph(x=x, radii=np.ones(len(x)), contacts=contacts)
    return CaseState(graph, LinearFrictional(kn=1.0, kt=0.5))


OVERLAPS = tuple(10.0**-k for k in range(1, 13))
SMALL = (1e-1, 1e-3, 1e-5, 1e-7, 1e-9)
FLAT = np.radians(20.0)


def _tangent(
    name: str,
    description: str,
    parameter: str,
    values: tuple[float, ...],
    build: Callable[[float], CaseState],
    affine: str,
    traction: str = "",
    **read: str,
) -> HardCase:
    """A case of a tangent; without `traction`, the expected letters are those of `affine`."""
    expected = {"affine": affine, "traction": traction or affine, **read}
    return HardCase(name, description, "tangent", parameter, values, build, expected)


def _end_of_drained(alpha0: float, kappa: float, phi: float, confinement: float) -> float:
    """`E1` where the contacts yield, from the exact drained path."""
    return float(drained_path(DiamondParameters(alpha0, kappa, phi, confinement)).end.E1)


HARD_CASES: tuple[HardCase, ...] = (
    _tangent(
        "flat-diamond", "branch angle near 0: entries of K from alpha0 to 1/alpha0",
        "alpha0 (rad)", SMALL, lambda alpha0: on_diamond(0.1, T=0.01, alpha0=alpha0), "sss??",
    ),
    _tangent(
        "steep-diamond", "branch angle near 90 degrees", "90 deg - alpha0 (rad)", SMALL,
        lambda gap: on_diamond(0.1, T=0.01, alpha0=0.5 * np.pi - gap), "sss??",
    ),
    _tangent(
        "soft-in-shear", "kappa near 0, N/l at half of it",
        "kappa", (1e-1, 1e-4, 1e-8, 1e-11, 1e-13, 0.0),
        lambda kappa: on_diamond(0.5 * kappa / (1.0 + 0.5 * kappa), kappa), "ssss??",
    ),
    _tangent(
        "stiff-in-shear", "kappa above 1", "kappa", (2.0, 1e3, 1e6, 1e9, 1e12),
        lambda kappa: on_diamond(0.1, kappa, T=0.01), "sssss",
    ),
    _tangent(
        "frictionless", "mu = 0: every loaded contact slides",
        "overlap", (1e-1, 1e-4, 1e-8, 1e-11, 1e-14),
        lambda strain: on_diamond(strain, mu=0.0), "uuuu?", regime="sssss",
    ),
    _tangent(
        "infinite-friction", "mu infinite: elastic whatever the shear force",
        "T/(kn l0)", (0.0, 0.1, 1.0, 10.0),
        lambda shear: on_diamond(0.1, mu=np.inf, T=shear), "ssuu", regime="eeee",
    ),
    _tangent(
        "nearly-open", "N near 0: contacts about to open",
        "overlap", (1e-2, 1e-8, 1e-12, 1e-15, 0.0), on_diamond, "sssss", regime="eeeee",
    ),
    _tangent(
        "stiff-sliding-grains", "N/l down to 1e-12, every contact sliding", "overlap", OVERLAPS,
        lambda strain: loaded_hexagon(strain, 1.0), "s" * 12, "u" * 12,
    ),
    _tangent(
        "stiff-sliding-diamond",
        "N/l down to 1e-12, a sliding loop with a cone under both closures",
        "overlap", OVERLAPS, lambda strain: mobilised_diamond(strain, 1.0), "u" * 12,
    ),
    _tangent(
        "stiff-grains", "N/l down to 1e-12, nothing sliding", "overlap", OVERLAPS,
        lambda strain: loaded_hexagon(strain, 0.5), "s" * 12,
    ),
    _tangent(
        "next-to-yield", "T within 1e-14 of mu N, on either side and on it",
        "T/(mu N) - 1", (-1e-8, -1e-12, -1e-14, 0.0, 1e-14),
        lambda excess: mobilised_diamond(0.1, 1.0 + excess), "suuuu",
        regime="essss", edge="nyyyy",
    ),
    _tangent(
        "at-threshold", "det K through zero",
        "E/E* - 1", (-1e-2, -1e-8, -1e-11, 0.0, 1e-11, 1e-8, 1e-2),
        lambda excess: on_diamond(KAPPA / (1.0 + KAPPA) * (1.0 + excess)), "sss?uuu",
    ),
    _tangent(
        "squashed-hexagon", "nearly collinear branches: a loop almost without area",
        "height", SMALL, squashed_hexagon, "sss??",
    ),
    _tangent(
        "unequal-sizes", "size ratios of 1e3 and more", "ratio", (10.0, 1e3, 1e6),
        lambda ratio: CaseState(
            polydisperse_polygon(0.5 * np.array([1.0, 1.0 / ratio, 1.1, 0.9, 1.2]), strain=0.05),
            CASE_LAW,
        ), "sss",
    ),
    _tangent(
        "coincident-grains", "two centres at one place: no branch, no direction",
        "distance", (1e-1, 1e-4, 1e-8, 1e-15, 0.0), coincident_grains, "sssse",
    ),
    _tangent(
        "order", "loops of 3 to 200 grains",
        "grains", (3, 4, 12, 50, 200),
        lambda order: CaseState(regular_polygon(int(order), strain=0.25), CASE_LAW),
        "susss", "suuuu",
    ),
    _tangent(
        "gear-mode", "free spins: a null vector of the grains that the loop must not feel",
        "grains", (3, 4, 6, 12, 200),
        lambda order: CaseState(regular_polygon(int(order), strain=0.1), CASE_LAW, spins="free"),
        "sssss", "ssuuu",
    ),
    _tangent(
        "singular-contact", "a contact's own block is singular under the traction closure",
        "kt/(N/l) - 1", (1e-2, 1e-6, 1e-12, 0.0, -1e-6),
        lambda excess: ring_with(6, 0.1 / 0.9 * (1.0 + excess)), "sssss",
    ),
    _tangent(
        "double-eigenvalue", "two eigenvalues of Ks that nearly coincide",
        "split", (1e-2, 1e-8, 1e-14, 0.0),
        lambda split: ring_with(5, KAPPA * (1.0 + split)), "ssss",
    ),
    HardCase(
        "parallel-half-edges", "branches that leave a grain in nearly the same direction",
        "faces", "units in the last place", (1e9, 1e3, 1.0, 0.0),
        parallel_half_edges, {"loops": "yyye"},
    ),
    HardCase(
        "yield-together", "all four contacts yield at once, and after a perturbation",
        "path", "shear at the start", (0.0, 1e-12, 1e-6),
        all_yield_at_once, status="finished", events=("yield",),
        # A shear force at the start moves it by as much.
        place=lambda shear: float(drained_path(TABLE_1).end.E1),
    ),
    HardCase(
        "force-control", "limit point: the axial stress that drives the path has a maximum",
        "path", "confinement", (0.02, 0.1, 0.16),
        lambda E: path_of_diamond(E, "force_control", "P11", 2.0),
        status="control_limit", events=("control_limit",),
        place=lambda E: _end_of_drained(0.25 * np.pi, TABLE_1.kappa, TABLE_1.phi, E),
    ),
    HardCase(
        "snap-back", "K22 through zero: the axial strain that drives the path turns back",
        "path", "confinement", (0.1, 0.3),
        lambda E: path_of_diamond(E, "drained_biaxial", "H11", 0.4, alpha0=FLAT, kappa=0.5),
        status="control_limit", events=("control_limit",),
        place=lambda E: _end_of_drained(FLAT, 0.5, np.radians(5.0), E),
    ),
    HardCase(
        "through-det-K", "det Ks and det K through zero on a path, down to kappa = 1e-6",
        "path", "kappa", (1e-6, 1e-3, 0.2, 2.0),
        lambda kappa: CaseState(
            diamond(0.25 * np.pi), LinearFrictional(1.0, kappa, MU),
            stages=(("isotropic_strain", "H11", min(2.0 * kappa / (1.0 + kappa), 0.9)),),
        ),
        status="finished", events=("det_Ks_zero",), place=lambda kappa: kappa / (1.0 + kappa),
    ),
    HardCase(
        "parting", "N through zero: every contact opens at once", "path", "strain", (1e-2, 1e-8),
        lambda E: path_of_diamond(E, "isotropic_extension", "H11", -E, alpha0=0.7),
        status="finished", events=("opening",),
        # Grains just touch in the reference.
        place=lambda strain: 0.0,
    ),
)  # fmt: skip


def hard_case(name: str) -> HardCase:
    """The hard case of that name."""
    for case in HARD_CASES:
        if case.name == name:
            return case
    known = ", ".join(case.name for case in HARD_CASES)
    raise InputError("hard case", repr(name), f"one of {known}", "Name one of these.")
