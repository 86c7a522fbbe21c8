"""The diamond pattern of Nicot et al. (2016), the verified special case: closed forms throughout.

Forces, stresses and strains are positive in compression, angles are radians, `T` is positive when
`alpha` grows. Numbers in parentheses are the paper's equations.
"""

from patterns.diamond.contact_work import work_compress_then_shear, work_shear_then_compress
from patterns.diamond.determinants import (
    determinant,
    determinant_elastic,
    determinant_sliding,
    drained_slope,
    geometric_asymmetry,
    geometric_softening,
    material_asymmetry,
)
from patterns.diamond.drained import (
    DrainedPath,
    drained_path,
    drained_states,
    drained_states_after_turn,
)
from patterns.diamond.drained_batch import DrainedEnd, drained_end
from patterns.diamond.drained_state import DrainedState
from patterns.diamond.force_tangents import (
    congruence,
    force_geometric_tangent,
    force_material_tangent,
    force_tangent,
    lagrangian_tangent,
)
from patterns.diamond.geometry import (
    branch_from_sides,
    contact_displacement_rates,
    contact_forces,
    external_forces,
    force_rates,
    side_lengths,
    side_rates,
)
from patterns.diamond.graph import diamond
from patterns.diamond.isotropic import (
    critical_strain,
    isotropic_determinant,
    isotropic_strain,
    isotropic_stress,
    isotropic_tangent,
)
from patterns.diamond.measures import (
    angle_from_strains,
    opposite_contact_strain,
    opposite_gaps,
    overlap_ratio,
    strains,
    stresses,
)
from patterns.diamond.moduli import elastic_moduli, sliding_moduli
from patterns.diamond.stress_tangents import geometric_tangent, material_tangent, tangent
from patterns.diamond.tables import TABLE_1, TABLE_2, DiamondParameters

__all__ = [
    "TABLE_1",
    "TABLE_2",
    "DiamondParameters",
    "DrainedEnd",
    "DrainedPath",
    "DrainedState",
    "angle_from_strains",
    "branch_from_sides",
    "congruence",
    "contact_displacement_rates",
    "contact_forces",
    "critical_strain",
    "determinant",
    "determinant_elastic",
    "determinant_sliding",
    "diamond",
    "drained_end",
    "drained_path",
    "drained_slope",
    "drained_states",
    "drained_states_after_turn",
    "elastic_moduli",
    "external_forces",
    "force_geometric_tangent",
    "force_material_tangent",
    "force_rates",
    "force_tangent",
    "geometric_asymmetry",
    "geometric_softening",
    "geometric_tangent",
    "isotropic_determinant",
    "isotropic_strain",
    "isotropic_stress",
    "isotropic_tangent",
    "lagrangian_tangent",
    "material_asymmetry",
    "material_tangent",
    "opposite_contact_strain",
    "opposite_gaps",
    "overlap_ratio",
    "side_lengths",
    "side_rates",
    "sliding_moduli",
    "strains",
    "stresses",
    "tangent",
    "work_compress_then_shear",
    "work_shear_then_compress",
]
