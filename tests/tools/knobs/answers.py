"""Quick answers of every kind, numbers and words by name; `name~` is the stated error of `name`.

Small packings, and two real states: 2,000 grains that Yade brought to rest under dead load, and a
state of the sample series. An entry without a stated error is held to a millionth of its largest
value; words and counts to the letter.
"""

from __future__ import annotations

import pickle
import sys
from collections.abc import Callable
from functools import cache
from itertools import pairwise
from typing import Any
from unittest.mock import patch

import numpy as np

import grainloops as gl
import loops.compiled
from loops import LinearFrictional, Scene, find_crossings, find_faces
from loops.compiled.network import following_half_edges
from loops.in_place import loops_in_place
from loops.loop_batches import TANGENTS, loops_of_packing
from patterns.diamond import TABLE_1
from patterns.snapshots.missing import overlapping_pairs
from patterns.synthetic import synthetic_network
from stability import branch_fraction
from stability.packing import probe as rates
from stability.packing import replay as replayed
from stability.packing import sustain
from stability.packing.amplitudes import probe_to
from studies import domain as domains
from studies.paths.options import PolygonOptions
from studies.series.evolution import fate_columns, track_loops
from tests.oracles.drained import drained_path
from tests.oracles.hard_cases import HARD_CASES
from tests.packings import LAW, jammed
from tests.stability.packing.yade_rest import yade_rest

Answers = dict[str, Any]
SAMPLE = gl.sample_path().parent


@cache
def sample_state(number: int) -> Any:
    """A state of the sample series."""
    rows = np.genfromtxt(SAMPLE / "slow/cells.csv", delimiter=",", names=True)
    row = rows[rows["snap"] == number][0]
    cell = [[row["h_xx"], row["h_xy"]], [row["h_yx"], row["h_yy"]]]
    file = SAMPLE / f"slow/grains_{number}.parquet"
    return gl.read_snapshot(file, cell=cell, shear_increment="radii")


def table() -> Answers:
    """Loops of the sample snapshot on their own."""
    found = gl.loop_table(gl.read_snapshot(gl.sample_path()))
    grains = np.concatenate(found.pop("grains").to_numpy())
    return {name: found[name].to_numpy() for name in found if "error" not in name} | {"of": grains}


def in_place() -> Answers:
    """Loops in their packing, by either method; blocks that cut the larger one."""
    found = {}
    for name, graph, law in (("36", jammed(36, 5), LAW), ("2,000", *yade_rest("slow")[:2])):
        for method in ("whole", "blocks"):
            place = loops_in_place(
                Scene(graph, law), gl.find_faces(graph), method=method, threads=1, block=25.0
            )
            norm = np.linalg.norm(place.matrix, axis=(1, 2))
            found |= {f"{name} {method}": norm, f"{name} {method}~": place.matrix_error}
    return found


def _probed(found: Any) -> Answers:
    return {
        "status": found.status,
        "sliding": found.sliding,
        "work": found.work,
        "cones": found.cones.ravel(),
        "fraction": found.unstable_fraction,
        "loops": np.linalg.norm(found.loop_work, axis=1),
    }


def probe() -> Answers:
    """Probes of a real state, of a small one under stress, and to an amplitude."""
    graph, law, _ = yade_rest("slow")
    first = rates(graph, law, [[0.6, -0.8], [-0.6, 0.8], [1.0, 0.0], [0.0, -1.0]])
    small = rates(jammed(36, 5), LAW, 8, control="stress", subspace="symmetric")
    ended = probe_to(first, gl.Scene(graph, law), 1e-5)
    parts = {"2,000": first, "36": small, "ended": ended}
    return {f"{n} {key}": value for n, one in parts.items() for key, value in _probed(one).items()}


def _walked(path: Any) -> Answers:
    return {
        "P": path.P[1:] - path.P[0],
        "H": path.H,
        "energy": path.energy,
        "status": [path.status],
        "events": [event.kind for event in path.events],
        "work": path.work[-1],
    }


def kernels() -> Answers:
    """The sample through the kernels of large packings, and what lies near their tolerances."""
    with patch.multiple(loops.compiled, COMPILED_FROM=1, PASSES_FROM=1):
        found = table()
        rng = np.random.default_rng(0)
        for size in (1e-1, 1e-3, 1e-8):
            graph, law, regime = stiff_network(size)
            faces = find_faces(graph)
            packing = loops_of_packing(graph, faces, law, regime)
            for k, tangent in enumerate(packing.tangents(slice(None), TANGENTS, True)):
                found[f"{size:g} tangents {k}"] = np.nan_to_num(tangent.matrix)
                found[f"{size:g} tangents {k}~"] = tangent.error
        for count in (15, 17, 33):
            found[f"wheel {count}"] = find_faces(rim(10.0, count)).grains
        slope = 1.7 * (1 + np.arange(-4, 5) * 2.0**-52)
        for spread, ways in (("rounding", slope), ("1e-14", 1.7 + 1e-14 * np.arange(9))):
            fan = rng.uniform(0.1, 10, 9)[:, None] * np.column_stack([np.ones(9), ways])
            star = np.column_stack([np.zeros(9), np.arange(1, 10)]).astype(np.int32)
            degree = np.array([9, *[1] * 9], dtype=np.int32)
            found[f"star {spread}"] = following_half_edges(star, degree, fan)[0]
        folded = rng.integers(0, 7, (60, 2)).astype(float)
        ends = np.unique(np.sort(rng.integers(0, 60, (90, 2)), axis=1), axis=0)
        ends = ends[(folded[ends[:, 0]] != folded[ends[:, 1]]).any(axis=1)]
        grid = gl.GrainGraph(x=folded, radii=np.full(60, 0.5), contacts=ends)
        found["crossings"] = find_crossings(grid)
        x, radii = rng.uniform(0, 30, (3000, 2)), rng.uniform(0.1, 0.4, 3000)
        x[:3] += 1e4
        for least in (0.0, 0.2):
            pairs, overlap = overlapping_pairs(x, radii, None, least)
            found[f"overlaps {least}"] = np.sort(overlap)
            found[f"pairs {least}"] = np.unique(pairs, axis=0)
    return found


def stiff_network(size: float) -> tuple[Any, Any, Any]:
    """A network with forces of the mean `N/(kn l)`, a tenth of its contacts sliding."""
    graph = synthetic_network(600, seed=2)
    rng = np.random.default_rng(0)
    slides = rng.random(graph.contact_count) < 0.1
    normal = graph.normal_force * (size / 1e-3)
    share = np.where(slides, np.sign(graph.shear_force), rng.uniform(-0.9, 0.9, len(normal)))
    graph = graph.replace(normal_force=normal, shear_force=0.5 * share * normal)
    regime = np.where(slides, gl.Regime.SLIDING, gl.Regime.ELASTIC).astype(np.int8)
    return graph, LinearFrictional(1.0, 0.4, 0.5), regime


def rim(radius: float, count: int) -> Any:
    """A grain in the middle of a ring of grains that touch it and each other."""
    angle = 2 * np.pi * np.arange(count) / count
    x = np.vstack([[0.0, 0.0], radius * np.column_stack([np.cos(angle), np.sin(angle)])])
    ring = np.arange(count)
    spokes = np.column_stack([0 * ring, 1 + ring])
    contacts = np.vstack([spokes, np.column_stack([1 + ring, 1 + (ring + 1) % count])])
    return gl.GrainGraph(x=x, radii=np.full(count + 1, 0.5), contacts=contacts)


def material() -> Answers:
    """Material points of loops: every compiled law and closure, loops of a packing."""
    mu, found = np.tan(np.radians(30)), {}
    laws = {
        "linear": LinearFrictional(1.0, 0.5, mu),
        "radii": LinearFrictional(1.0, 0.5, mu, "radii"),
        "hertz": gl.HertzMindlin(young=1.0, poisson=0.3, mu=mu),
        "displacement": gl.HertzMindlin(
            young=1.0, poisson=0.3, mu=mu, shear_history="displacement"
        ),
    }
    drained = [
        gl.Stage(gl.programmes.isotropic_stress(), "P11", 1e-2),
        gl.Stage(gl.programmes.drained_biaxial(), "H11", 0.07),
    ]
    for name, law in laws.items():
        for closure in ("affine", "traction", "cell"):
            # Spheres that only touch have no stiffness to start with.
            hexagon = gl.regular_polygon(
                6, strain=0.0 if isinstance(law, LinearFrictional) else 1e-3
            )
            loops_of_it = gl.oriented(hexagon, 6 if closure != "cell" else 1)
            one = gl.march(gl.LoopMaterial(loops_of_it, None, law, closure=closure), drained, 70)
            key = f"{name} {closure}"
            found |= {f"{key} {part}": getattr(one, part) for part in ("H", "P", "A", "regimes")}
            found[f"{key} status"] = [one.status]
    packing = gl.loops_of(sample_state(10), orders=[4, 5, 6], count=60)
    state = (point := gl.LoopMaterial(packing, closure="affine")).start(1)
    for k in range(1, 11):
        answer = point.update(np.diag([1 + 1e-5 * k, 1 - 1e-5 * k])[None], state)
        state = answer.state
    found |= {"loops stress": answer.stress, "loops tangent": answer.tangent}
    return found | {"loops failed": answer.failed.astype(int)}


def _biaxial(amount: float, axis: int = 2) -> Any:
    return gl.Stage(gl.programmes.drained_biaxial(axis=axis), f"H{axis}{axis}", amount)


def path() -> Answers:
    """Paths of a real state and of a small one."""
    graph, law, _ = yade_rest("slow")
    real = gl.follow(gl.Scene(graph, law), _biaxial(1e-5), closure="packing", rows=2)
    small = gl.follow(
        gl.Scene(jammed(36, 5), LAW), _biaxial(2e-2), closure="packing", rows=2, interval=2e-4
    )
    parts = {"2,000": real, "36": small}
    return {f"{n} {key}": value for n, one in parts.items() for key, value in _walked(one).items()}


def replay() -> Answers:
    """A small packing strained by the equations of motion."""
    end = replayed(jammed(36, 5), LAW, _biaxial(5e-4), inertial_number=2e-5).state
    return {"stress": end.stress, "strain": end.strain, "closed": [int(end.closed.sum())]}


def hold() -> Answers:
    """A real state brought to rest, at its strain and at its stress."""
    graph, law, _ = yade_rest("slow")
    small = jammed(36, 5)
    pushed = small.replace(shear_force=0.9 * small.shear_force)
    found = {}
    for name, one, its in (("2,000", graph, law), ("36", pushed, LAW)):
        for control in ("strain", "stress"):
            end = gl.hold(gl.Scene(one, its), control=control)
            spread = end.spread * np.linalg.norm(end.stress) + 1e-6 * np.abs(end.stress).max()
            found |= {f"{name} {control}": end.stress, f"{name} {control}~": spread}
            spread = end.strain_spread * np.linalg.norm(end.strain) + 1e-10
            found |= {f"{name} {control} strain": end.strain, f"{name} {control} strain~": spread}
            found[f"{name} {control} said"] = [end.status]
    return found


def _loaded(graph: Any, law: Any, degrees: float, share: float | None, **given: Any) -> Answers:
    """One direction of `sustain`; `share` stands for a spread of the large motion not asked for."""
    along = [[np.cos(np.radians(degrees)), np.sin(np.radians(degrees))]]
    (one,) = sustain(Scene(graph, law), along, spread=share is None, **given).paths
    spread = one.first_large_spread if share is None else share
    found = {"limit": one.limit, "limit~": one.limit * one.limit_spread, "status": [one.status]}
    found |= {"large": one.first_large_load, "large~": one.first_large_load * spread}
    found |= {"first event": one.first_event}
    if one.mode is not None:
        found |= {"strain": one.first_large_strain, "grains": [len(one.mode.grains)]}
    return found


def limit() -> Answers:
    """First loss of equilibrium of a real state; of a small one with its first large motion."""
    graph, law, _ = yade_rest("slow")
    real = _loaded(graph, law, 120.0, 0.05, largest=4.0, interval=1e-5, most_snaps=0)
    small = _loaded(jammed(24, 3), LAW, -90.0, None, largest=0.01, interval=1e-4)
    parts = {"2,000": real, "24": small}
    return {f"{n} {key}": value for n, one in parts.items() for key, value in one.items()}


def motion() -> Answers:
    """First large motion of a real state; its spread taken as that of docs/sustaining.md, 5 %."""
    graph, law, _ = yade_rest("slow")
    return _loaded(graph, law, 120.0, 0.05, largest=4.0, interval=5e-6)


def indicators() -> Answers:
    """Indicators of the loops of a real state."""
    graph, law, _ = yade_rest("slow")
    return dict(gl.indicators(gl.Scene(graph, law), gl.find_faces(graph)))


def loop_path() -> Answers:
    """Paths of single loops: yield, relaxed grains, a contact that forms."""
    soft = gl.polydisperse_polygon([0.5, 0.6, 0.45, 0.55, 0.5], strain=0.1)
    runs = {
        "pentagon": (gl.regular_polygon(5, strain=0.1), 0.0875, _biaxial(0.3, 1), "affine"),
        "relaxed": (soft, 0.3, _biaxial(0.3, 1), "traction"),
        "closing": (
            gl.diamond(0.7),
            0.4,
            gl.Stage(gl.programmes.oedometric(), "H11", 0.8),
            "affine",
        ),
    }
    found: Answers = {}
    for name, (graph, mu, stage, closure) in runs.items():
        one = gl.follow(gl.Scene(graph, LinearFrictional(1.0, 0.2, mu)), stage, closure=closure)
        found |= {f"{name} end": one.P[-1], f"{name} status": [one.status]}
        found[f"{name} events"] = [event.kind for event in one.events]
        found[f"{name} places"] = [event.parameter for event in one.events]
    return found | {"diamond": float(drained_path(TABLE_1).end.E1)}


def domain() -> Answers:
    """First losses of the diamond and of a pentagon."""
    case = domains.Case(np.radians(35), 0.24, np.radians(14))
    losses = domains.first_losses(case, 21, friction=True)
    found: Answers = {
        name: getattr(losses, name) for name in ("det_Ks_zero", "det_K_zero", "yields")
    }
    options = PolygonOptions(order=5, kappa=0.24, phi_deg=14.0, closure="traction")
    _, limits = domains.loop_limits(options, "strain", 5, friction=True)
    for kind, there in limits.found.items():
        found[f"{kind} found"] = there.astype(int)
        found[kind] = np.where(there[:, None], limits.states[kind].H, 0.0)
    return found


def verdicts() -> Answers:
    """Hard cases near singular states, random loops, shares of unstable directions."""
    found: Answers = {}
    for case in HARD_CASES:
        if case.kind != "tangent" or case.name in ("gear-mode", "order"):
            continue
        for value in case.values[::3]:
            try:
                scene = case.build(value)
                one = gl.traction_tangent(scene.graph, scene.law, regime=scene.regime)
                said = gl.judge(one, "diagonal")
                at = f"{case.name} {value:g}"
                found |= {f"{at} matrix": one.matrix, f"{at} matrix~": one.error}
                found |= {f"{at} status": [said.status]}
            except gl.InputError as error:
                found[f"{case.name} {value:g} refused"] = [str(error)[:60]]
    for order in (4, 6, 7):
        graph = gl.random_loop(order, seed=order, polydispersity=0.3, strain=0.02, convex=order < 9)
        slid = graph.replace(shear_force=0.5 * graph.normal_force)
        share = branch_fraction(slid, LinearFrictional(1.0, 0.3, 0.5), closure="traction")
        found |= {f"{order} share": share.unstable, f"{order} share~": share.error}
    return found


def tracking() -> Answers:
    """Loops followed through the states of the sample series, and the kinetics of their orders."""
    states = [gl.planar(sample_state(number)) for number in (10, 11, 12, 13)]
    fates = [track_loops(*pair) for pair in pairwise(states)]
    kinetics, table = gl.order_kinetics(fates), fate_columns(fates[0])
    found: Answers = {key: vars(kinetics)[key] for key in ("pairs", "opened", "closed", "loops")}
    found |= {"opening": kinetics.opening_rate, "steady": kinetics.steady().share}
    return found | {"fates": list(table["fate"]), "successor": table["successor"]}


def check() -> Answers:
    """Findings on good and on damaged snapshots, and numbers of files of other codes."""
    found: Answers = {
        "good": [str(finding) for finding in gl.read_snapshot(gl.sample_path()).findings]
    }
    tables = sample_state(10).tables()
    for which, column, factor in (
        ("grains", "radius", 1.01),
        ("contacts", "kn", 1.05),
        ("contacts", "fn", 0.9),
        ("contacts", "ft", -1.0),
    ):
        table = tables[which].copy()
        if column in table:
            table[column] = np.asarray(table[column]) * factor
            bad = gl.snapshot_from_tables(**(tables | {which: table}), strict=False)
            found[column] = [f"{one.check} {one.severity}" for one in bad.findings]
    for file in ("lammps/dump.atoms.0.gz", "liggghts/atoms.0.dump.gz", "mercury/box.data.gz"):
        read = gl.read_snapshot(SAMPLE / file, strict=False, kn=1e6, kt=5e5, mu=0.5)
        found |= {f"{file} forces": read.graph.normal_force}
        found[f"{file} findings"] = [f"{one.check} {one.severity}" for one in read.findings]
    return found


ANSWERS: dict[str, Callable[[], Answers]] = {
    answer.__name__: answer
    for answer in (
        table,
        in_place,
        probe,
        path,
        replay,
        hold,
        limit,
        motion,
        indicators,
        loop_path,
        domain,
        verdicts,
        tracking,
        check,
        kernels,
        material,
    )
}


if __name__ == "__main__":
    sys.stdout.buffer.write(pickle.dumps({name: ANSWERS[name]() for name in sys.argv[1:]}))
