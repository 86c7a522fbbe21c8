"""What a loop is: grains, contacts, laws, assembly, stress and the macroscopic tangent."""

from typing import TYPE_CHECKING

from loops.lazy import lazy_face

if TYPE_CHECKING:
    from loops.assembly import assemble_sparse_tangent, assemble_tangent
    from loops.closures import (
        Closure,
        MacroTangent,
        Spins,
        affine_tangent,
        macroscopic_tangent,
        traction_tangent,
    )
    from loops.contact_matching import ContactMatch, match_contacts
    from loops.contact_state import ContactState, contact_state
    from loops.contact_tangent import contact_tangent, translational_blocks
    from loops.crossings import crossing_contacts_to_drop, find_crossings
    from loops.errors import InputError
    from loops.exchange import from_networkx, to_networkx
    from loops.fabric import axial_mean, direction_tensors, edge_tensors, mean_tensor, principal
    from loops.faces import FaceKind, Faces, euler_check, faces_by_order, find_faces, outline_area
    from loops.force_chains import ForceChains, force_chains, loop_chain_contacts
    from loops.geometry import (
        boundary_vectors,
        polygon_area,
        polygon_centroid,
        polygon_perimeter,
        polygon_shape,
        reference_volume,
    )
    from loops.graph import GrainGraph, branch_vectors, contact_frame, reference_branch_vectors
    from loops.laws import (
        ContactLaw,
        FrictionalLaw,
        HertzMindlin,
        LinearFrictional,
        Regime,
        RollingResistance,
    )
    from loops.loop_batches import LoopBatch, loop_batches
    from loops.loop_strain import best_fit_strain, loop_strain, rotation_and_stretch
    from loops.loop_tangents import loop_tangents
    from loops.pruning import prune_dangling
    from loops.stress import contact_forces, love_weber_stress, nominal_stress
    from loops.tracking import Fate, LoopFates, exchange_counts, exchange_matrix, loop_fates

__all__ = [
    "Closure",
    "ContactLaw",
    "ContactMatch",
    "ContactState",
    "FaceKind",
    "Faces",
    "Fate",
    "ForceChains",
    "FrictionalLaw",
    "GrainGraph",
    "HertzMindlin",
    "InputError",
    "LinearFrictional",
    "LoopBatch",
    "LoopFates",
    "MacroTangent",
    "Regime",
    "RollingResistance",
    "Spins",
    "affine_tangent",
    "assemble_sparse_tangent",
    "assemble_tangent",
    "axial_mean",
    "best_fit_strain",
    "boundary_vectors",
    "branch_vectors",
    "contact_forces",
    "contact_frame",
    "contact_state",
    "contact_tangent",
    "crossing_contacts_to_drop",
    "direction_tensors",
    "edge_tensors",
    "euler_check",
    "exchange_counts",
    "exchange_matrix",
    "faces_by_order",
    "find_crossings",
    "find_faces",
    "force_chains",
    "from_networkx",
    "loop_batches",
    "loop_chain_contacts",
    "loop_fates",
    "loop_strain",
    "loop_tangents",
    "love_weber_stress",
    "macroscopic_tangent",
    "match_contacts",
    "mean_tensor",
    "nominal_stress",
    "outline_area",
    "polygon_area",
    "polygon_centroid",
    "polygon_perimeter",
    "polygon_shape",
    "principal",
    "prune_dangling",
    "reference_branch_vectors",
    "reference_volume",
    "rotation_and_stretch",
    "to_networkx",
    "traction_tangent",
    "translational_blocks",
]

lazy_face(__name__, __file__)
