"""The diamond pattern of Nicot et al. (2016), the verified special case: closed forms throughout.

Forces, stresses and strains are positive in compression, angles are radians, `T` is positive when
`alpha` grows. Numbers in parentheses are the paper's equations.
"""

from patterns.diamond.drained import (
    DrainedPath,
    drained_path,
    drained_states,
    drained_states_after_turn,
    printed_states_after_turn,
)
from patterns.diamond.drained_end import DrainedEnd, DrainedState, drained_end
from patterns.diamond.geometry import (
    angle_from_strains,
    diamond,
    external_forces,
    opposite_gaps,
    overlap_ratio,
)
from patterns.diamond.printed_rule import PrintedRule
from patterns.diamond.tables import TABLE_1, TABLE_2, DiamondParameters
from patterns.diamond.tangents import (
    critical_strain,
    determinant_elastic,
    determinant_sliding,
    elastic_moduli,
    geometric_tangent,
    isotropic_strain,
    isotropic_stress,
    isotropic_tangent,
    material_tangent,
    sliding_moduli,
    tangent,
)

__all__ = [
    "TABLE_1",
    "TABLE_2",
    "DiamondParameters",
    "DrainedEnd",
    "DrainedPath",
    "DrainedState",
    "PrintedRule",
    "angle_from_strains",
    "critical_strain",
    "determinant_elastic",
    "determinant_sliding",
    "diamond",
    "drained_end",
    "drained_path",
    "drained_states",
    "drained_states_after_turn",
    "elastic_moduli",
    "external_forces",
    "geometric_tangent",
    "isotropic_strain",
    "isotropic_stress",
    "isotropic_tangent",
    "material_tangent",
    "opposite_gaps",
    "overlap_ratio",
    "printed_states_after_turn",
    "sliding_moduli",
    "tangent",
]
