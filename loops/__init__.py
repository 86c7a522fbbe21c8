"""What a loop is: grains, contacts, laws, assembly, stress and the macroscopic tangent."""

from loops.assembly import assemble_sparse_tangent, assemble_tangent
from loops.closures import (
    MacroTangent,
    affine_tangent,
    macroscopic_tangent,
    traction_tangent,
)
from loops.contact_state import ContactState, contact_state
from loops.contact_tangent import contact_tangent, translational_blocks
from loops.crossings import find_crossings
from loops.errors import InputError
from loops.exchange import from_networkx, to_networkx
from loops.faces import FaceKind, Faces, euler_check, faces_by_order, find_faces
from loops.geometry import (
    boundary_vectors,
    polygon_area,
    polygon_centroid,
    polygon_perimeter,
    polygon_shape,
    reference_volume,
)
from loops.graph import (
    GrainGraph,
    branch_vectors,
    contact_frame,
    reference_branch_vectors,
)
from loops.laws import ContactLaw, HertzMindlin, LinearFrictional, Regime, RollingResistance
from loops.loop_batches import LoopBatch, loop_batches
from loops.outline import outline_area
from loops.planarity import crossing_contacts_to_drop
from loops.pruning import prune_dangling
from loops.stress import contact_forces, love_weber_stress, nominal_stress

__all__ = [
    "ContactLaw",
    "ContactState",
    "FaceKind",
    "Faces",
    "GrainGraph",
    "HertzMindlin",
    "InputError",
    "LinearFrictional",
    "LoopBatch",
    "MacroTangent",
    "Regime",
    "RollingResistance",
    "affine_tangent",
    "assemble_sparse_tangent",
    "assemble_tangent",
    "boundary_vectors",
    "branch_vectors",
    "contact_forces",
    "contact_frame",
    "contact_state",
    "contact_tangent",
    "crossing_contacts_to_drop",
    "euler_check",
    "faces_by_order",
    "find_crossings",
    "find_faces",
    "from_networkx",
    "loop_batches",
    "love_weber_stress",
    "macroscopic_tangent",
    "nominal_stress",
    "outline_area",
    "polygon_area",
    "polygon_centroid",
    "polygon_perimeter",
    "polygon_shape",
    "prune_dangling",
    "reference_branch_vectors",
    "reference_volume",
    "to_networkx",
    "traction_tangent",
    "translational_blocks",
]
