"""The front door: `import grainloops as gl`; each name is loaded when it is first used.

Forces, stresses and strains are positive in compression, angles are in radians.
"""

from typing import TYPE_CHECKING

from loops.lazy import lazy_face

if TYPE_CHECKING:
    from loops import (
        FrictionalLaw,
        GrainGraph,
        HertzMindlin,
        InputError,
        LinearFrictional,
        Regime,
        RollingResistance,
        affine_tangent,
        contact_forces,
        contact_state,
        find_faces,
        from_networkx,
        loop_fates,
        loop_tangents,
        love_weber_stress,
        match_contacts,
        to_networkx,
        traction_tangent,
    )
    from patterns import (
        Snapshot,
        diamond,
        hexagon,
        loop_of_snapshot,
        polydisperse_polygon,
        random_loop,
        read_frames,
        read_snapshot,
        regular_polygon,
        sample_cell,
        sample_path,
        synthetic_network,
        write_snapshot,
    )
    from stability import (
        Programme,
        Stage,
        destabilising_control,
        directional_work,
        follow,
        judge,
        normalised_second_order_work,
        plane_cone,
        programmes,
        rates_at,
        restrict,
        rotate_tangent,
        second_order_work,
        spectrum,
        statuses,
        symmetric_spectrum,
        unstable_fraction,
    )
    from studies.frames import loop_table, path_table
    from studies.plots import plot_cone, plot_loop, plot_map, plot_path
    from studies.snapshot.source import planar
    from studies.version import __version__

__all__ = [
    "FrictionalLaw",
    "GrainGraph",
    "HertzMindlin",
    "InputError",
    "LinearFrictional",
    "Programme",
    "Regime",
    "RollingResistance",
    "Snapshot",
    "Stage",
    "__version__",
    "affine_tangent",
    "contact_forces",
    "contact_state",
    "destabilising_control",
    "diamond",
    "directional_work",
    "find_faces",
    "follow",
    "from_networkx",
    "hexagon",
    "judge",
    "loop_fates",
    "loop_of_snapshot",
    "loop_table",
    "loop_tangents",
    "love_weber_stress",
    "match_contacts",
    "normalised_second_order_work",
    "path_table",
    "planar",
    "plane_cone",
    "plot_cone",
    "plot_loop",
    "plot_map",
    "plot_path",
    "polydisperse_polygon",
    "programmes",
    "random_loop",
    "rates_at",
    "read_frames",
    "read_snapshot",
    "regular_polygon",
    "restrict",
    "rotate_tangent",
    "sample_cell",
    "sample_path",
    "second_order_work",
    "spectrum",
    "statuses",
    "symmetric_spectrum",
    "synthetic_network",
    "to_networkx",
    "traction_tangent",
    "unstable_fraction",
    "write_snapshot",
]

lazy_face(__name__, __file__)
