"""What a tangent tells: spectra, second-order work, cones, the unstable fraction, verdicts.

Every function takes plain arrays with leading batch axes: a macroscopic tangent `A (..., 4, 4)` in
the component order (11, 12, 21, 22), or an operator `K (..., m, m)` already restricted.
"""

from typing import TYPE_CHECKING

from loops.lazy import lazy_face

if TYPE_CHECKING:
    from stability import programmes
    from stability.cones import PlaneCone, plane_cone
    from stability.control_programmes import strain_driven, stress_driven
    from stability.destabilising import LinearControl, destabilising_control, softening_control
    from stability.directional import (
        BranchFraction,
        DirectionalWork,
        branch_fraction,
        directional_work,
    )
    from stability.paths import Event, Path, follow, rates_at
    from stability.programmes import Programme, Stage
    from stability.rate_problem import RateProblem, RateSolution
    from stability.second_order_work import (
        PolarDiagram,
        alpha_e,
        normalised_second_order_work,
        polar_diagram,
        second_order_work,
    )
    from stability.spectra import (
        RTOL,
        bromwich_margin,
        flutter_pairs,
        operator_norm,
        spectrum,
        symmetric_modes,
        symmetric_part,
        symmetric_spectrum,
    )
    from stability.subspaces import COMPONENTS, restrict, rotate_tangent, subspace_basis
    from stability.unstable_fraction import imhof_fraction, unstable_fraction
    from stability.verdict import Verdict, judge, statuses

__all__ = [
    "COMPONENTS",
    "RTOL",
    "BranchFraction",
    "DirectionalWork",
    "Event",
    "LinearControl",
    "Path",
    "PlaneCone",
    "PolarDiagram",
    "Programme",
    "RateProblem",
    "RateSolution",
    "Stage",
    "Verdict",
    "alpha_e",
    "branch_fraction",
    "bromwich_margin",
    "destabilising_control",
    "directional_work",
    "flutter_pairs",
    "follow",
    "imhof_fraction",
    "judge",
    "normalised_second_order_work",
    "operator_norm",
    "plane_cone",
    "polar_diagram",
    "programmes",
    "rates_at",
    "restrict",
    "rotate_tangent",
    "second_order_work",
    "softening_control",
    "spectrum",
    "statuses",
    "strain_driven",
    "stress_driven",
    "subspace_basis",
    "symmetric_modes",
    "symmetric_part",
    "symmetric_spectrum",
    "unstable_fraction",
]

lazy_face(__name__, __file__)
