"""The registry: every hard case of the theory note, section 10, by its name."""

from __future__ import annotations

from loops import InputError
from patterns.hard_cases import paths, scenes
from patterns.hard_cases.case import HardCase

EXPONENTS = range(1, 13)

HARD_CASES: tuple[HardCase, ...] = (
    HardCase(
        "flat-diamond",
        "branch angle near 0: entries of K from alpha0 to 1/alpha0",
        "tangent", "alpha0 (rad)", (1e-1, 1e-3, 1e-5, 1e-7, 1e-9),
        scenes.flat_diamond, {"affine": "sss??", "traction": "sss??"},
    ),
    HardCase(
        "steep-diamond",
        "branch angle near 90 degrees",
        "tangent", "90 deg - alpha0 (rad)", (1e-1, 1e-3, 1e-5, 1e-7, 1e-9),
        scenes.steep_diamond, {"affine": "sss??", "traction": "sss??"},
    ),
    HardCase(
        "soft-in-shear",
        "kappa near 0, N/l at half of it",
        "tangent", "kappa", (1e-1, 1e-4, 1e-8, 1e-11, 1e-13, 0.0),
        scenes.soft_in_shear, {"affine": "ssss??", "traction": "ssss??"},
    ),
    HardCase(
        "stiff-in-shear",
        "kappa above 1",
        "tangent", "kappa", (2.0, 1e3, 1e6, 1e9, 1e12),
        scenes.stiff_in_shear, {"affine": "sssss", "traction": "sssss"},
    ),
    HardCase(
        "frictionless",
        "mu = 0: every loaded contact slides",
        "tangent", "overlap", (1e-1, 1e-4, 1e-8, 1e-11, 1e-14),
        scenes.frictionless, {"affine": "uuuu?", "traction": "uuuu?", "regime": "sssss"},
    ),
    HardCase(
        "infinite-friction",
        "mu infinite: elastic whatever the shear force",
        "tangent", "T/(kn l0)", (0.0, 0.1, 1.0, 10.0),
        scenes.infinite_friction,
        {"affine": "ssuu", "traction": "ssuu", "regime": "eeee"},
    ),
    HardCase(
        "nearly-open",
        "N near 0: contacts about to open",
        "tangent", "overlap", (1e-2, 1e-8, 1e-12, 1e-15, 0.0),
        scenes.nearly_open, {"affine": "sssss", "traction": "sssss", "regime": "eeeee"},
    ),
    HardCase(
        "stiff-sliding-grains",
        "N/l down to 1e-12, every contact sliding",
        "tangent", "overlap", tuple(10.0**-k for k in EXPONENTS),
        scenes.stiff_sliding_grains, {"affine": "s" * 12, "traction": "u" * 12},
    ),
    HardCase(
        "stiff-sliding-diamond",
        "N/l down to 1e-12, a sliding loop with a cone under both closures",
        "tangent", "overlap", tuple(10.0**-k for k in EXPONENTS),
        scenes.stiff_sliding_diamond, {"affine": "u" * 12, "traction": "u" * 12},
    ),
    HardCase(
        "stiff-grains",
        "N/l down to 1e-12, nothing sliding",
        "tangent", "overlap", tuple(10.0**-k for k in EXPONENTS),
        scenes.stiff_grains, {"affine": "s" * 12, "traction": "s" * 12},
    ),
    HardCase(
        "next-to-yield",
        "T within 1e-14 of mu N, on either side and on it",
        "tangent", "T/(mu N) - 1", (-1e-8, -1e-12, -1e-14, 0.0, 1e-14),
        scenes.next_to_yield,
        {"affine": "suuuu", "traction": "suuuu", "regime": "essss", "edge": "nyyyy"},
    ),
    HardCase(
        "at-threshold",
        "det K through zero",
        "tangent", "E/E* - 1", (-1e-2, -1e-8, -1e-11, 0.0, 1e-11, 1e-8, 1e-2),
        scenes.at_threshold, {"affine": "sss?uuu", "traction": "sss?uuu"},
    ),
    HardCase(
        "squashed-hexagon",
        "nearly collinear branches: a loop almost without area",
        "tangent", "height", (1e-1, 1e-3, 1e-5, 1e-7, 1e-9),
        scenes.squashed_hexagon, {"affine": "sss??", "traction": "sss??"},
    ),
    HardCase(
        "unequal-sizes",
        "size ratios of 1e3 and more",
        "tangent", "ratio", (10.0, 1e3, 1e6),
        scenes.unequal_sizes, {"affine": "sss", "traction": "sss"},
    ),
    HardCase(
        "coincident-grains",
        "two centres at one place: no branch, no direction",
        "tangent", "distance", (1e-1, 1e-4, 1e-8, 1e-15, 0.0),
        scenes.coincident_grains, {"affine": "sssse", "traction": "sssse"},
    ),
    HardCase(
        "order",
        "loops of 3 to 200 grains",
        "tangent", "grains", (3, 4, 12, 50, 200),
        scenes.ring_of, {"affine": "susss", "traction": "suuuu"},
    ),
    HardCase(
        "gear-mode",
        "free spins: a null vector of the grains that the loop must not feel",
        "tangent", "grains", (3, 4, 6, 12, 200),
        scenes.freely_rolling, {"affine": "sssss", "traction": "ssuuu"},
    ),
    HardCase(
        "singular-contact",
        "a contact's own block is singular under the traction closure",
        "tangent", "kt/(N/l) - 1", (1e-2, 1e-6, 1e-12, 0.0, -1e-6),
        scenes.singular_contact, {"affine": "sssss", "traction": "sssss"},
    ),
    HardCase(
        "double-eigenvalue",
        "two eigenvalues of Ks that nearly coincide",
        "tangent", "split", (1e-2, 1e-8, 1e-14, 0.0),
        scenes.double_eigenvalue, {"affine": "ssss", "traction": "ssss"},
    ),
    HardCase(
        "parallel-half-edges",
        "branches that leave a grain in nearly the same direction",
        "faces", "units in the last place", (1e9, 1e3, 1.0, 0.0),
        scenes.parallel_half_edges, {"loops": "yyye"},
    ),
    HardCase(
        "yield-together",
        "all four contacts yield at once, and after a perturbation",
        "path", "shear at the start", (0.0, 1e-12, 1e-6),
        paths.all_yield_at_once, status="finished", events=("yield",),
        place=paths.yield_of_table_1,
    ),
    HardCase(
        "force-control",
        "limit point: the axial stress that drives the path has a maximum",
        "path", "confinement", (0.02, 0.1, 0.16),
        paths.falling_force, status="control_limit", events=("control_limit",),
        place=paths.peak,
    ),
    HardCase(
        "snap-back",
        "K22 through zero: the axial strain that drives the path turns back",
        "path", "confinement", (0.1, 0.3),
        paths.snapping_back, status="control_limit", events=("control_limit",),
        place=paths.turning_point,
    ),
    HardCase(
        "through-det-K",
        "det Ks and det K through zero on a path, down to kappa = 1e-6",
        "path", "kappa", (1e-6, 1e-3, 0.2, 2.0),
        paths.through_det_k, status="finished", events=("det_Ks_zero",),
        place=paths.threshold,
    ),
    HardCase(
        "parting",
        "N through zero: every contact opens at once",
        "path", "strain", (1e-2, 1e-8),
        paths.parting, status="finished", events=("opening",),
        place=paths.first_touch,
    ),
)  # fmt: skip


def hard_case(name: str) -> HardCase:
    """The hard case of that name."""
    for case in HARD_CASES:
        if case.name == name:
            return case
    known = ", ".join(case.name for case in HARD_CASES)
    raise InputError("hard case", repr(name), f"one of {known}", "Name one of these.")
