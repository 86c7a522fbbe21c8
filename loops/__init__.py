"""A loop: grains, contacts, laws, assembly, stress and the macroscopic tangent."""

from typing import TYPE_CHECKING

from loops.lazy import lazy_face

if TYPE_CHECKING:
    from loops.assembly import assemble_tangent as assemble_tangent
    from loops.assembly import contact_tangent as contact_tangent
    from loops.assembly import translational_blocks as translational_blocks
    from loops.boundary import Boundary as Boundary
    from loops.boundary import PlaneContacts as PlaneContacts
    from loops.boundary import boundary_of as boundary_of
    from loops.closures import Closure as Closure
    from loops.closures import MacroTangent as MacroTangent
    from loops.closures import Spins as Spins
    from loops.closures import affine_tangent as affine_tangent
    from loops.closures import macroscopic_tangent as macroscopic_tangent
    from loops.closures import traction_tangent as traction_tangent
    from loops.crossings import crossing_contacts_to_drop as crossing_contacts_to_drop
    from loops.crossings import find_crossings as find_crossings
    from loops.errors import InputError as InputError
    from loops.fabric import ForceChains as ForceChains
    from loops.fabric import axial_mean as axial_mean
    from loops.fabric import direction_tensors as direction_tensors
    from loops.fabric import edge_tensors as edge_tensors
    from loops.fabric import force_chains as force_chains
    from loops.fabric import mean_tensor as mean_tensor
    from loops.fabric import principal as principal
    from loops.faces import FaceKind as FaceKind
    from loops.faces import Faces as Faces
    from loops.faces import euler_check as euler_check
    from loops.faces import faces_by_order as faces_by_order
    from loops.faces import find_faces as find_faces
    from loops.faces import outline_area as outline_area
    from loops.geometry import boundary_vectors as boundary_vectors
    from loops.geometry import polygon_area as polygon_area
    from loops.geometry import polygon_centroid as polygon_centroid
    from loops.geometry import polygon_perimeter as polygon_perimeter
    from loops.geometry import polygon_shape as polygon_shape
    from loops.geometry import reference_volume as reference_volume
    from loops.graph import ContactState as ContactState
    from loops.graph import GrainGraph as GrainGraph
    from loops.graph import branch_vectors as branch_vectors
    from loops.graph import contact_frame as contact_frame
    from loops.graph import contact_state as contact_state
    from loops.graph import from_networkx as from_networkx
    from loops.graph import to_networkx as to_networkx
    from loops.kinetics import OrderKinetics as OrderKinetics
    from loops.kinetics import order_kinetics as order_kinetics
    from loops.laws.frictional import ContactLaw as ContactLaw
    from loops.laws.frictional import FrictionalLaw as FrictionalLaw
    from loops.laws.frictional import Regime as Regime
    from loops.laws.kinds import CohesiveFrictional as CohesiveFrictional
    from loops.laws.kinds import HertzMindlin as HertzMindlin
    from loops.laws.kinds import LinearFrictional as LinearFrictional
    from loops.laws.kinds import RollingResistance as RollingResistance
    from loops.loop_batches import LoopBatch as LoopBatch
    from loops.loop_batches import loop_batches as loop_batches
    from loops.loop_batches import loop_tangents as loop_tangents
    from loops.pruning import prune_dangling as prune_dangling
    from loops.quadrons import Quadrons as Quadrons
    from loops.quadrons import quadrons as quadrons
    from loops.scene import Scene as Scene
    from loops.stress_strain import best_fit_strain as best_fit_strain
    from loops.stress_strain import contact_forces as contact_forces
    from loops.stress_strain import loop_strain as loop_strain
    from loops.stress_strain import love_weber_stress as love_weber_stress
    from loops.stress_strain import nominal_stress as nominal_stress
    from loops.stress_strain import rotation_and_stretch as rotation_and_stretch
    from loops.support import Support as Support
    from loops.tracking import ContactMatch as ContactMatch
    from loops.tracking import Fate as Fate
    from loops.tracking import LoopFates as LoopFates
    from loops.tracking import exchange_counts as exchange_counts
    from loops.tracking import exchange_matrix as exchange_matrix
    from loops.tracking import loop_fates as loop_fates
    from loops.tracking import match_contacts as match_contacts

lazy_face(__name__)
