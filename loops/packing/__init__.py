"""A packing as one sparse linear system: carrying grains, matrix, factors, loops in place."""

from loops.boundary import PlaneContacts as PlaneContacts
from loops.boundary import outline_grains as outline_grains
from loops.boundary import plane_contacts as plane_contacts
from loops.boundary import plane_stiffness as plane_stiffness
from loops.packing.in_place import METHODS as METHODS
from loops.packing.in_place import LoopsInPlace as LoopsInPlace
from loops.packing.in_place import Method as Method
from loops.packing.in_place import loops_in_place as loops_in_place
from loops.system import REFINEMENTS as REFINEMENTS
from loops.system import Carrying as Carrying
from loops.system import Changed as Changed
from loops.system import Factor as Factor
from loops.system import System as System
from loops.system import balancing_forces as balancing_forces
from loops.system import factorised as factorised
from loops.system import in_freedoms as in_freedoms
from loops.system import packing_stress as packing_stress
from loops.system import packing_stress_rate as packing_stress_rate
from loops.system import packing_system as packing_system
from loops.system import relative_motion as relative_motion
from loops.system import stiffness_matrix as stiffness_matrix
