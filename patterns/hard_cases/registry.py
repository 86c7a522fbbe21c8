"""The registry: every hard case of docs/accuracy.md by its name."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from loops import InputError, LinearFrictional
from patterns.diamond import TABLE_1, DiamondParameters, diamond, drained_path
from patterns.hard_cases import scenes
from patterns.hard_cases.case import HardCase, Scene
from patterns.hard_cases.scenes import KAPPA, LAW, MU, on_diamond, path_of_diamond
from patterns.polygons import polydisperse_polygon, regular_polygon

OVERLAPS = tuple(10.0**-k for k in range(1, 13))
SMALL = (1e-1, 1e-3, 1e-5, 1e-7, 1e-9)
FLAT = np.radians(20.0)


def _tangent(
    name: str,
    description: str,
    parameter: str,
    values: tuple[float, ...],
    build: Callable[[float], Scene],
    affine: str,
    traction: str = "",
    **read: str,
) -> HardCase:
    """A case that ends in a tangent; without answers of its own, traction gives the affine ones."""
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
        lambda strain: scenes.loaded_hexagon(strain, 1.0), "s" * 12, "u" * 12,
    ),
    _tangent(
        "stiff-sliding-diamond",
        "N/l down to 1e-12, a sliding loop with a cone under both closures",
        "overlap", OVERLAPS, lambda strain: scenes.mobilised_diamond(strain, 1.0), "u" * 12,
    ),
    _tangent(
        "stiff-grains", "N/l down to 1e-12, nothing sliding", "overlap", OVERLAPS,
        lambda strain: scenes.loaded_hexagon(strain, 0.5), "s" * 12,
    ),
    _tangent(
        "next-to-yield", "T within 1e-14 of mu N, on either side and on it",
        "T/(mu N) - 1", (-1e-8, -1e-12, -1e-14, 0.0, 1e-14),
        lambda excess: scenes.mobilised_diamond(0.1, 1.0 + excess), "suuuu",
        regime="essss", edge="nyyyy",
    ),
    _tangent(
        "at-threshold", "det K through zero",
        "E/E* - 1", (-1e-2, -1e-8, -1e-11, 0.0, 1e-11, 1e-8, 1e-2),
        lambda excess: on_diamond(KAPPA / (1.0 + KAPPA) * (1.0 + excess)), "sss?uuu",
    ),
    _tangent(
        "squashed-hexagon", "nearly collinear branches: a loop almost without area",
        "height", SMALL, scenes.squashed_hexagon, "sss??",
    ),
    _tangent(
        "unequal-sizes", "size ratios of 1e3 and more", "ratio", (10.0, 1e3, 1e6),
        lambda ratio: Scene(
            polydisperse_polygon(0.5 * np.array([1.0, 1.0 / ratio, 1.1, 0.9, 1.2]), strain=0.05),
            LAW,
        ), "sss",
    ),
    _tangent(
        "coincident-grains", "two centres at one place: no branch, no direction",
        "distance", (1e-1, 1e-4, 1e-8, 1e-15, 0.0), scenes.coincident_grains, "sssse",
    ),
    _tangent(
        "order", "loops of 3 to 200 grains",
        "grains", (3, 4, 12, 50, 200),
        lambda order: Scene(regular_polygon(int(order), strain=0.25), LAW), "susss", "suuuu",
    ),
    _tangent(
        "gear-mode", "free spins: a null vector of the grains that the loop must not feel",
        "grains", (3, 4, 6, 12, 200),
        lambda order: Scene(regular_polygon(int(order), strain=0.1), LAW, spins="free"),
        "sssss", "ssuuu",
    ),
    _tangent(
        "singular-contact", "a contact's own block is singular under the traction closure",
        "kt/(N/l) - 1", (1e-2, 1e-6, 1e-12, 0.0, -1e-6),
        lambda excess: scenes.ring_with(6, 0.1 / 0.9 * (1.0 + excess)), "sssss",
    ),
    _tangent(
        "double-eigenvalue", "two eigenvalues of Ks that nearly coincide",
        "split", (1e-2, 1e-8, 1e-14, 0.0),
        lambda split: scenes.ring_with(5, KAPPA * (1.0 + split)), "ssss",
    ),
    HardCase(
        "parallel-half-edges", "branches that leave a grain in nearly the same direction",
        "faces", "units in the last place", (1e9, 1e3, 1.0, 0.0),
        scenes.parallel_half_edges, {"loops": "yyye"},
    ),
    HardCase(
        "yield-together", "all four contacts yield at once, and after a perturbation",
        "path", "shear at the start", (0.0, 1e-12, 1e-6),
        scenes.all_yield_at_once, status="finished", events=("yield",),
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
        lambda kappa: Scene(
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
