"""Wrong arguments of every name of the front door end in one clear error."""

import inspect
from functools import cache
from operator import attrgetter

import numpy as np
import pandas as pd
import pytest

import grainloops as gl
from loops import loop_fates, match_contacts
from tests.packings import LAW, jammed

RAGGED, NAN = [[1.0], [1.0, 2.0]], float("nan")
# What no argument of a kind can be; None only where it is not the default.
WRONG = {
    "sample": (None, 3, "grains.csv", [1, 2]),
    "graph": (None, 3, "grains.csv", [1, 2]),
    "result": (None, 3, "a", [1, 2]),
    "number": (None, "a", "0.1", [1.0, 2.0], 1j, NAN, {}),
    "count": (None, "a", 1.5, -1, [3], True, NAN, {}),
    "place": (None, "a", 1.5, [3], NAN, {}),
    "choice": (None, "nonsense", 3, ["affine"], {}),
    "array": (None, "a", ["0.1"], RAGGED, [1j], [None], {}, NAN),
    "shaped": (None, "a", ["0.1"], RAGGED, [1j], [None], {}, NAN, np.ones((7, 4))),
    "flags": (None, "a", RAGGED, [1j], [0.5], np.ones((7, 4))),
    "ids": (None, "a", RAGGED, [1j], [0.5], [None], {}),
    "path": (None, 3, ["a"], "no/such/file.csv", {}),
    "name": (3, ["a"], {}),
    "law": ("linear", 3.0, [LAW], {}),
    "list": (None, 3, "a", [None], [], {}),
    "share": ("a", "0.1,b", [0.1, 0.2, 0.3], -0.1, 1.5, 1j, NAN, {}),
    "size": (None, "a", 1.5, -1, [1.5], NAN, {}),
    "pairs": (None, 3, "a", [None], [(1,)], [(1, 2)]),
    "call": (3, "a", [1]),
    "table": (None, 3, "a", [1, 2]),
    "column": (None, 3, "nothing", [None], {}),
    "columns": (3, "a", ["a"], {"x": [3]}),
}


@cache
def made(name):
    """Return what calls share."""
    return {
        "sample": lambda: gl.read_snapshot(gl.sample_path()),
        "ring": lambda: gl.regular_polygon(5, strain=0.02),
        "loop": lambda: gl.Scene(made("ring"), LAW),
        "packing": lambda: gl.Scene(jammed(16, 2), LAW),
        "stage": lambda: gl.Stage("isotropic_strain", "H11", 0.05),
        "path": lambda: gl.follow(made("loop"), made("stage"), closure="affine"),
        "tangent": lambda: gl.affine_tangent(made("loop")),
        "K": lambda: np.array([[1.0, 0.2], [0.1, -0.5]]),
        "set": lambda: gl.oriented(made("ring"), 2),
        "material": lambda: gl.LoopMaterial(made("set"), None, LAW),
        "fates": lambda: _fates(made("sample")),
        "tables": lambda: made("sample").tables(),
        "evolution": lambda: pd.DataFrame({"shear_strain": [0.0, 1.0], "q_over_p": [0.1, 0.3]}),
    }[name]()


def _fates(one):
    match = match_contacts(one.graph, one.ids, one.graph, one.ids)
    return loop_fates(match, one.faces, one.faces)


# One right call a name, and the kind of each argument; "" for those that nothing can be wrong with.
PACKING = {"scene": "packing"}
LAW_OF_FILE = (
    "kn:number kt:number mu:number phi:number shear_increment:choice law:choice young:number "
    "poisson:number shear_history:choice adhesion:number cohesion:number"
)
READ = (
    "contacts:path cell:shaped cells:path format:choice columns:columns periodic:choice strict: "
    + LAW_OF_FILE
)
MASSES = "mass:shaped inertia:shaped velocity:shaped spin:shaped"
EVOLVED = (
    "subject:sample programme:choice to:number inertial_number:number progress:call axis:count "
    "by:choice rows:count interval:number instabilities:count past:choice damping:number "
)
CALLS = {
    "CohesiveFrictional": (
        {"kn": 1.0, "kt": 0.5},
        "kn:array kt:array mu:array adhesion:array cohesion:array bonded: shear_increment:choice "
        "phi:array",
    ),
    "FrictionalLaw": (
        {"kn": 1.0, "kt": 0.5},
        "kn:array kt:array mu:array shear_increment:choice",
    ),
    "GrainGraph": (
        {"x": [[0.0, 0], [0.9, 0]], "radii": [0.5, 0.5], "contacts": [[0, 1]]},
        "x:shaped radii:shaped contacts:ids normal_force:shaped shear_force:shaped x0:shaped "
        "images:ids cell:shaped cell0:shaped regime:flags rolling_moment:shaped",
    ),
    "HertzMindlin": (
        {"young": 1.0, "poisson": 0.2},
        "young:array poisson:array mu:array shear_increment:choice shear_history:choice "
        "ratio:array phi:array",
    ),
    "LinearFrictional": (
        {"kn": 1.0, "kt": 0.5},
        "kn:array kt:array mu:array shear_increment:choice phi:array",
    ),
    "LoopMaterial": (
        {"loops": "set", "law": LAW},
        "loops:list weights:shaped law:law closure:choice threads:count",
    ),
    "Programme": (
        {"name": "own", "stress": np.zeros((4, 4)), "strain": np.eye(4), "rate": [1.0, 0, 0, 0]},
        "name:name stress:shaped strain:shaped rate:shaped isochoric_row:count cauchy_row:count "
        "fluid_bulk_modulus:number",
    ),
    "Regime": ({"value": 1}, "value:place"),
    "RollingResistance": ({"law": LAW, "k_r": 0.1}, "law:law k_r:array mu_r:array"),
    "Scene": ({"graph": "ring", "law": LAW}, "graph:graph law:law boundary:result ids:place"),
    "Stage": (
        {"programme": "drained_biaxial", "quantity": "H11", "target": 0.1},
        "programme:choice quantity:choice target:number fallback:",
    ),
    "Support": ({"held": [True, True]}, "held:flags motion:shaped"),
    "affine_tangent": (
        {"graph": "ring", "law": LAW},
        "graph:graph law:law spins:choice regime:flags volume:array",
    ),
    "chain_table": ({"snapshot": "sample"}, "snapshot:sample"),
    "check": ({"snapshot": "sample"}, "snapshot:sample"),
    "contact_state": ({"graph": "ring"}, "graph:graph"),
    "destabilising_control": ({"K": "K"}, "K:shaped rtol:number"),
    "diamond": (
        {"alpha0": 0.6},
        "alpha0:array E1:array E2:array T:array radius:array kn:array",
    ),
    "directional_work": (
        {"graph": "ring", "law": LAW, "directions": [[1.0, 0.0]], "closure": "affine"},
        "graph:graph law:law directions:shaped closure:choice spins:choice subspace:choice "
        "regime:flags volume:array",
    ),
    "evolve": ({"subject": "packing", "to": 1e-5, "rows": 1}, EVOLVED + "spread: pathologies:"),
    "fabric": ({"snapshot": "sample"}, "snapshot:sample"),
    "fates": ({"before": "sample", "after": "sample"}, "before:sample after:sample"),
    "find_faces": ({"graph": "ring"}, "graph:graph compiled:"),
    "follow": (
        {"scene": "loop", "stages": "stage", "closure": "affine"},
        "scene:sample stages:list closure:choice rows:count max_steps:count spins:choice "
        "model:choice",
    ),
    "force_chains": ({"graph": "ring"}, "graph:graph angle:number least:count"),
    "forecast": (
        {"subject": "packing", "to": 1e-5, "spread": False, "rows": 1},
        EVOLVED + "spread:",
    ),
    "hold": (
        PACKING,
        f"scene:sample control:choice unbalanced:number damping:shaped {MASSES} most_steps:count",
    ),
    "increments": ({"before": "sample", "after": "sample"}, "before:sample after:sample"),
    "indicators": ({"scene": "packing"}, "scene:sample faces:result nonaffinity:shaped"),
    "judge": ({"K": "tangent"}, "K:shaped subspace:choice rtol:number error:number kn:number"),
    "from_networkx": ({"network": gl.to_networkx(gl.regular_polygon(5))}, "network:graph"),
    "loop": (
        {"source": "sample", "number": 62},
        "source:sample number:count law:law tolerance:number",
    ),
    "loop_domain": (
        {"loop": "loop", "closure": "affine", "directions": 4},
        "loop:sample closure:choice spins:choice control:choice directions:count progress:call",
    ),
    "loop_table": (
        {"snapshot": "sample"},
        "snapshot:sample in_packing: hold: input_error:share",
    ),
    "loop_tangents": (
        {"graph": "ring", "law": LAW, "closure": "affine"},
        "graph:graph law:law faces:result closure:choice spins:choice",
    ),
    "loops_of": ({"snapshot": "sample"}, "snapshot:sample orders:ids count:count"),
    "love_weber_stress": ({"graph": "ring"}, "graph:graph volume:array"),
    "march": (
        {"material": "material", "stages": "stage", "steps": 2},
        "material:result stages:list steps:count",
    ),
    "order_kinetics": ({"intervals": ["fates"]}, "intervals:list time:shaped"),
    "oriented": ({"loop": "ring", "count": 2}, "loop:graph count:count"),
    "path_table": ({"path": "path"}, "path:result"),
    "planar": ({"snapshot": "sample"}, "snapshot:sample where: drop:"),
    "plane_cone": ({"K": "K"}, "K:shaped rtol:number"),
    "polydisperse_polygon": ({"radii": [0.5, 0.4, 0.5]}, "radii:array strain:array kn:array"),
    "probe": (
        {**PACKING, "directions": 4},
        "scene:sample directions:shaped control:choice subspace:choice yield_band:number "
        "hold:choice",
    ),
    "random_loop": (
        {"order": 5},
        "order:count seed:count convex: polydispersity:number strain:array mu:number "
        "radius:number kn:number size:size",
    ),
    "rates_at": (
        {"scene": "packing", "programme": "drained_biaxial"},
        "scene:sample programme:choice H:shaped P:shaped regime:choice closure:choice "
        "spins:choice yield_band:number starts:count",
    ),
    "read_frames": ({"path": gl.sample_path()}, "path:path " + READ),
    "read_snapshot": ({"path": gl.sample_path()}, "path:path frame:place " + READ),
    "regular_polygon": (
        {"order": 5},
        "order:count orientation:choice strain:array radius:number kn:array",
    ),
    "replay": (
        {**PACKING, "strain": 1e-6 * np.eye(2)},
        f"scene:sample strain:shaped inertial_number:number steps:count duration:number "
        f"time_step:number {MASSES} shares:shaped damping:number viscous:number balanced: "
        "rows:count",
    ),
    "restrict": ({"A": np.eye(4), "subspace": "diagonal"}, "A:shaped subspace:choice"),
    "rotate_tangent": ({"A": np.eye(4), "angle": 0.1}, "A:shaped angle:array"),
    "sample_cell": ({}, ""),
    "sample_path": ({}, "name:path"),
    "second_order_work": ({"K": "K", "direction": [1.0, 0.0]}, "K:shaped direction:shaped"),
    "series": ({"snapshots": ["sample"]}, "snapshots:list cells:path"),
    "skill": (
        {"pairs": [("sample", "sample")], "indicator": lambda one: one.faces.loops},
        "pairs:pairs indicator:call",
    ),
    "snapshot_from_tables": (
        {"grains": "grains", "contacts": "contacts"},
        "grains:table contacts:table walls:table cell:shaped columns:columns strict: "
        f"periodic:choice {LAW_OF_FILE}",
    ),
    "stress": ({"snapshot": "sample"}, "snapshot:sample"),
    "study": (
        {"source": "sample", "number": 62, "in_packing": False},
        "source:sample number:count out:name closure:choice programme:choice end:number "
        "in_packing: named:name progress:call",
    ),
    "sustain": (
        {"scene": "packing", "directions": [[1.0, 0.0]], "largest": 1e-4, "spread": False},
        "scene:sample directions:shaped subspace:choice largest:number interval:number "
        "large:number most_snaps:count spread: hold:choice progress:call",
    ),
    "symbolic_tangent": ({"graph": "ring", "law": LAW}, "graph:graph law:law closure:choice"),
    "symmetric_spectrum": ({"K": "K"}, "K:shaped"),
    "synthetic_network": (
        {"grains": 16},
        "grains:count seed:count periodic: cell:shaped coordination:number jitter:number "
        "friction:number",
    ),
    "to_geodataframe": ({"snapshot": "sample"}, "snapshot:sample table:table"),
    "to_networkx": ({"graph": "ring"}, "graph:graph"),
    "traction_tangent": (
        {"graph": "ring", "law": LAW},
        "graph:graph law:law spins:choice regime:flags volume:array",
    ),
    "unstable_fraction": ({"eigenvalues": [1.0, -0.5]}, "eigenvalues:array"),
    "write_snapshot": ({"path": "grains.csv", "snapshot": "sample"}, "path:path snapshot:sample"),
}


# Programmes and figures; the sizes of a figure are not checked, and axes are matplotlib's.
AXIS = "axis:count rate:number"
CALLS |= {
    "Snapshot": (
        {
            "graph": "ring",
            "law": LAW,
            "regime": [1] * 5,
            "ids": [0, 1, 2, 3, 4],
            "wall_contacts": 0,
            "notes": (),
        },
        "graph:graph law:law regime:flags ids:ids wall_contacts: notes: walls: step: findings: "
        "rotation: lacks: mass: time: velocity: spin: periodic:",
    ),
    "programmes.isotropic_strain": ({}, "rate:number"),
    "programmes.isotropic_stress": ({}, "rate:number"),
    "programmes.proportional_strain": ({"H11": 1.0, "H22": 0.5}, "H11:number H22:number"),
    "programmes.proportional_stress": ({"P11": 1.0, "P22": 0.5}, "P11:number P22:number"),
    "programmes.drained_biaxial": ({}, AXIS),
    "programmes.oedometric": ({}, AXIS),
    "programmes.cauchy_drained": ({}, AXIS),
    "programmes.biaxial": ({}, AXIS),
    "programmes.undrained": ({}, AXIS + " fluid_bulk_modulus:number"),
    "programmes.simple_shear": ({}, AXIS),
    "programmes.combination": (
        {"stress": np.zeros((4, 4)), "strain": np.eye(4), "rate": [1.0, 0, 0, 0]},
        "stress:shaped strain:shaped rate:shaped name:name",
    ),
    "animate": ({"snapshots": [], "folder": "out"}, "folder:name snapshots:list"),
    "plot.chains": ({"snapshot": "sample"}, "snapshot:sample"),
    "plot.eigenvalues": ({"snapshot": "sample"}, "snapshot:sample"),
    "plot.fates": ({"evolution": "evolution"}, "evolution:table"),
    "plot.orders": ({"snapshot": "sample"}, "snapshot:sample"),
    "plot.polar": ({"found": "probe"}, "found:result"),
    "plot.skill": ({"table": "evolution"}, "table:table"),
    "plot.stress_strain": ({"found": "evolution"}, "found:table"),
    "write_vtk": (
        {"folder": "out", "snapshot": "sample"},
        "folder:name snapshot:sample table:table",
    ),
    "plot.cone": ({"tangent": "tangent"}, "tangent:shaped"),
    "plot.domain": (
        {"loop": "loop", "closure": "affine", "directions": 4},
        "loop:sample closure:choice plane:choice spins:choice control:choice directions:count",
    ),
    "plot.envelope": (
        {"graph": "ring", "law": LAW, "closure": "affine"},
        "graph:graph law:law closure:choice spins:choice",
    ),
    "plot.evolution": ({"evolution": "evolution"}, "evolution:table y:column x:column"),
    "plot.figure_width": ({}, "name:choice"),
    "plot.loop": ({"graph": "ring"}, "graph:graph"),
    "plot.map": ({"snapshot": "sample"}, "snapshot:sample values:shaped label:"),
    "plot.path": ({"path": "path"}, "path:result x:column y:column"),
    "plot.rose": ({"snapshot": "sample"}, "snapshot:sample of:choice"),
}


def value_of(given):
    if isinstance(given, str) and given in ("grains", "contacts"):
        return made("tables")[given]
    if isinstance(given, list | tuple):
        return type(given)(map(value_of, given))
    try:
        return made(given) if isinstance(given, str) else given
    except KeyError:
        return given


def cases(name):
    """Every argument of a name with every value that it cannot have."""
    base, kinds = CALLS[name]
    taken = inspect.signature(called(name)).parameters
    for argument, kind in (pair.split(":") for pair in kinds.split()):
        known = taken.get(argument)
        # Options of `**how` have no annotation of their own.
        optional = known is None or known.kind is known.VAR_KEYWORD or known.default is None
        optional = optional or "None" in str(known.annotation)
        for wrong in WRONG[kind] if kind else ():
            if not (wrong is None and optional):
                yield base, argument, wrong


def called(name):
    return gl.Regime.__call__ if name == "Regime" else attrgetter(name)(gl)


def ask(name, base, argument, wrong):
    arguments = {key: value_of(value) for key, value in base.items()} | {argument: wrong}
    if name == "Regime":
        return gl.Regime(wrong)
    found = called(name)(**arguments)
    return list(found) if inspect.isgenerator(found) else found


@pytest.mark.parametrize("name", CALLS)
def test_one_line_says_what_came_and_what_was_expected(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for base, argument, wrong in cases(name):
        with pytest.raises(gl.InputError, match=r": got .*, expected .*\.$") as caught:
            ask(name, base, argument, wrong)
        assert len(str(caught.value)) < 500 and "\n" not in str(caught.value)
    assert not [*tmp_path.iterdir()]


def test_every_name_of_the_front_door_is_called():
    apart = {"__version__", "InputError", "plot", "programmes"}
    drawn = {f"plot.{name}" for name in gl.plot.__all__}
    named = {name for name in CALLS if name.startswith("programmes.")}
    assert {*CALLS} - named == {*gl.__all__} - apart | drawn
    assert {f"programmes.{make.__name__}" for make in gl.programmes.BY_NAME.values()} <= named
    for name, (_, kinds) in CALLS.items():
        listed = {pair.split(":")[0] for pair in kinds.split()}
        taken = {
            one.name
            for one in inspect.signature(called(name)).parameters.values()
            if one.kind not in (one.VAR_KEYWORD, one.VAR_POSITIONAL)
        }
        assert name == "Regime" or taken - {"self", "ax"} <= listed, name
