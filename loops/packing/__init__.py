"""A packing as one sparse linear system: carrying grains, matrix, factors, loops in place."""

from loops.packing.in_place import METHODS as METHODS
from loops.packing.in_place import LoopsInPlace as LoopsInPlace
from loops.packing.in_place import Method as Method
from loops.packing.in_place import loops_in_place as loops_in_place
from loops.packing.system import Carrying as Carrying
from loops.packing.system import Factor as Factor
from loops.packing.system import PackingSystem as PackingSystem
from loops.packing.system import PlaneContacts as PlaneContacts
from loops.packing.system import UpdatedFactors as UpdatedFactors
from loops.packing.system import balancing_forces as balancing_forces
from loops.packing.system import factorised as factorised
from loops.packing.system import in_freedoms as in_freedoms
from loops.packing.system import outline_grains as outline_grains
from loops.packing.system import packing_stress_rate as packing_stress_rate
from loops.packing.system import packing_system as packing_system
from loops.packing.system import plane_contacts as plane_contacts
from loops.packing.system import plane_stiffness as plane_stiffness
from loops.packing.system import relative_motion as relative_motion
from loops.packing.system import stiffness_matrix as stiffness_matrix
