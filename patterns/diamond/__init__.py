"""The diamond pattern of Nicot et al. (2016) in closed form.

Forces, stresses and strains are positive in compression, angles are radians, `T` is positive when
`alpha` grows. Numbers in parentheses are the paper's equations.
"""

from patterns.diamond.closed_form import angle_from_strains as angle_from_strains
from patterns.diamond.closed_form import critical_strain as critical_strain
from patterns.diamond.closed_form import determinant_elastic as determinant_elastic
from patterns.diamond.closed_form import determinant_sliding as determinant_sliding
from patterns.diamond.closed_form import diamond as diamond
from patterns.diamond.closed_form import elastic_moduli as elastic_moduli
from patterns.diamond.closed_form import external_forces as external_forces
from patterns.diamond.closed_form import geometric_tangent as geometric_tangent
from patterns.diamond.closed_form import isotropic_strain_of_stress as isotropic_strain_of_stress
from patterns.diamond.closed_form import isotropic_tangent as isotropic_tangent
from patterns.diamond.closed_form import material_tangent as material_tangent
from patterns.diamond.closed_form import opposite_gaps as opposite_gaps
from patterns.diamond.closed_form import sliding_moduli as sliding_moduli
from patterns.diamond.closed_form import stress_of_isotropic_strain as stress_of_isotropic_strain
from patterns.diamond.closed_form import tangent as tangent
from patterns.diamond.printed_rule import PrintedRule as PrintedRule
from patterns.diamond.states import TABLE_1 as TABLE_1
from patterns.diamond.states import TABLE_2 as TABLE_2
from patterns.diamond.states import DiamondParameters as DiamondParameters
