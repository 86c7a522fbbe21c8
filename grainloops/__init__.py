"""The front door: `import grainloops as gl`; each name is loaded when it is first used.

Forces, stresses and strains are positive in compression, angles are in radians.
"""

from typing import TYPE_CHECKING

from loops.lazy import SERVED, lazy_face

if TYPE_CHECKING:
    from grainloops import plot as plot
    from loops import CohesiveFrictional as CohesiveFrictional
    from loops import FrictionalLaw as FrictionalLaw
    from loops import GrainGraph as GrainGraph
    from loops import HertzMindlin as HertzMindlin
    from loops import InputError as InputError
    from loops import LinearFrictional as LinearFrictional
    from loops import Regime as Regime
    from loops import RollingResistance as RollingResistance
    from loops import Scene as Scene
    from loops import Support as Support
    from loops import affine_tangent as affine_tangent
    from loops import contact_state as contact_state
    from loops import find_faces as find_faces
    from loops import force_chains as force_chains
    from loops import from_networkx as from_networkx
    from loops import loop_tangents as loop_tangents
    from loops import love_weber_stress as love_weber_stress
    from loops import order_kinetics as order_kinetics
    from loops import to_networkx as to_networkx
    from loops import traction_tangent as traction_tangent
    from loops.closures.symbolic import symbolic_tangent as symbolic_tangent
    from patterns import Snapshot as Snapshot
    from patterns import diamond as diamond
    from patterns import planar as planar
    from patterns import polydisperse_polygon as polydisperse_polygon
    from patterns import random_loop as random_loop
    from patterns import read_frames as read_frames
    from patterns import read_snapshot as read_snapshot
    from patterns import regular_polygon as regular_polygon
    from patterns import sample_cell as sample_cell
    from patterns import sample_path as sample_path
    from patterns import snapshot_from_tables as snapshot_from_tables
    from patterns import synthetic_network as synthetic_network
    from patterns import write_snapshot as write_snapshot
    from patterns.one_loop import loop as loop
    from stability import Programme as Programme
    from stability import Stage as Stage
    from stability import destabilising_control as destabilising_control
    from stability import directional_work as directional_work
    from stability import follow as follow
    from stability import judge as judge
    from stability import plane_cone as plane_cone
    from stability import programmes as programmes
    from stability import rates_at as rates_at
    from stability import restrict as restrict
    from stability import rotate_tangent as rotate_tangent
    from stability import second_order_work as second_order_work
    from stability import symmetric_spectrum as symmetric_spectrum
    from stability import unstable_fraction as unstable_fraction
    from stability.material import LoopMaterial as LoopMaterial
    from stability.material import loops_of as loops_of
    from stability.material import march as march
    from stability.material import oriented as oriented
    from stability.packing import hold as hold
    from stability.packing import indicators as indicators
    from stability.packing import replay as replay
    from studies import __version__ as __version__
    from studies.domain import loop_domain as loop_domain
    from studies.evolve import evolve as evolve
    from studies.forecast import forecast as forecast
    from studies.frames import chain_table as chain_table
    from studies.frames import check as check
    from studies.frames import loop_table as loop_table
    from studies.frames import path_table as path_table
    from studies.frames import to_geodataframe as to_geodataframe
    from studies.frames import write_vtk as write_vtk
    from studies.one_loop import study as study
    from studies.probe import probe as probe
    from studies.series.tables import animate as animate
    from studies.series.tables import fates as fates
    from studies.series.tables import increments as increments
    from studies.series.tables import series as series
    from studies.series.tables import skill as skill
    from studies.snapshot.sample import fabric as fabric
    from studies.snapshot.sample import stress as stress
    from studies.sustain import sustain as sustain

# Words that are asked for, with the names to look at.
MEANT = {
    "read load open snapshot": "read_snapshot",
    "save write export": "write_snapshot",
    "sample example": "sample_path",
    "verdict verdicts stable is_stable": "judge; loop_table has one row a loop",
    "eigenvalues lambda_min": "symmetric_spectrum; loop_table has one row a loop",
    "tangent operator k": "affine_tangent, traction_tangent, loop_tangents",
    "cone cones": "plane_cone, plot.cone",
    "loops table orders loop_ids": "loop_table, loop",
    "in_packing packing place": "loop_table(snapshot, in_packing=True)",
    "work w2": "second_order_work, directional_work",
    "envelope rose map evolution": "plot.envelope, plot.rose, plot.map, plot.evolution",
    "gif movie video animation": "animate",
    "vtk paraview vtp": "write_vtk",
    "domain": "loop_domain, plot.domain",
    "path integrate solve": "follow",
    "predict next_state": "forecast, evolve, replay",
    "limits limit loads": "sustain",
    "rest relax equilibrium": "hold",
    "stresses sigma": "stress",
    "rates strain_rate": "rates_at",
    "kinetics tracking": "order_kinetics, fates",
    "chains": "force_chains, chain_table",
    "polygon hexagon pentagon ring": "regular_polygon, polydisperse_polygon, loop",
    "networkx": "from_networkx, to_networkx, loop",
    "law linear hertz rolling cohesive": "LinearFrictional, HertzMindlin, CohesiveFrictional, "
    "RollingResistance",
    "boundary cell walls": "Scene(graph, law, boundary); snapshot.scene has them",
    "material": "LoopMaterial",
}
SERVED.update(table="studies.results.table_of", plot="studies.results.plot_of")
lazy_face(__name__, MEANT)
