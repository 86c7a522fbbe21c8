"""Write a packing as LAMMPS, LIGGGHTS and MercuryDPM write it, by their own descriptions."""

import gzip
import re
from typing import NamedTuple

import numpy as np

from loops import GrainGraph, branch_vectors, contact_forces, find_faces
from patterns import read_frames

LAW = {"kn": 1.0, "kt": 0.5, "mu": 0.5}


def snapshots_of(path, **how):
    """Every snapshot in a file."""
    return list(read_frames(path, **LAW | how))


def columns_of(path, *names):
    """(rows, names) numbers of the first frame of a dump of atoms, plain or gzip."""
    content = path.read_bytes()
    text = (gzip.decompress(content) if path.suffix == ".gz" else content).decode()
    head, rows = text.split("ITEM: ATOMS ", maxsplit=1)
    known, *lines = rows.splitlines()
    count = int(re.search(r"NUMBER OF ATOMS\n(\d+)", head)[1])
    places = [known.split().index(name) for name in names]
    return np.loadtxt(lines[:count], usecols=places, ndmin=2)


def edit(path, change):
    """Change the rows of a file."""
    rows = path.read_text().splitlines()
    change(rows)
    path.write_text("\n".join(rows) + "\n")


class Packing(NamedTuple):
    """Grains and contacts (forces by `contact_forces`), ids, walls or None."""

    graph: GrainGraph
    ids: np.ndarray
    walls: object = None

    @classmethod
    def of(cls, snapshot):
        return cls(snapshot.graph, snapshot.ids, snapshot.walls)

    @property
    def wrapped(self):
        """Centres and images with all centres inside the cell."""
        graph = self.graph
        if graph.cell is None:
            return graph.x, np.zeros((graph.contact_count, 2), dtype=int)
        whole = np.floor(np.linalg.solve(graph.cell, graph.x.T).T).astype(int)
        i, j = graph.contacts.T
        return graph.x - whole @ graph.cell.T, graph.images + whole[j] - whole[i]


def lines(columns, digits=17, trailing=" "):
    columns = [np.asarray(column) for column in columns]
    form = " ".join("%d" if c.dtype.kind in "iu" else f"%.{digits}g" for c in columns)
    return "".join(form % row + trailing + "\n" for row in zip(*columns, strict=True))


def header(what, count, names, graph, step=0, digits=17, flags=None):
    """Header of a frame, the box at the origin; tilted boxes as LAMMPS gives their bounds."""
    cell = graph.cell
    text = f"ITEM: TIMESTEP\n{step}\nITEM: NUMBER OF {what}\n{count}\n"
    flags = flags or ("ff ff pp" if cell is None else "pp pp pp")
    low = np.zeros(2) if cell is not None else graph.x.min(axis=0) - graph.radii.max()
    high = low + np.diag(cell) if cell is not None else graph.x.max(axis=0) + graph.radii.max()
    if cell is None or cell[0, 1] == 0:
        bounds = [[low[0], high[0]], [low[1], high[1]], [-0.5, 0.5]]
        text += f"ITEM: BOX BOUNDS {flags}\n"
    else:
        assert cell[1, 0] == 0, "LAMMPS puts the first vector along x"
        xy = cell[0, 1]
        bounds = [[low[0] + min(0, xy), high[0] + max(0, xy), xy], [low[1], high[1], 0]]
        bounds.append([-0.5, 0.5, 0])
        text += f"ITEM: BOX BOUNDS xy xz yz {flags}\n"
    for row in bounds:
        text += " ".join(f"%.{digits}g" % value for value in row) + "\n"
    return text + f"ITEM: {what} {' '.join(names)}\n"


def write_atoms(path, packing, step=0, *, digits=17, mode="a", extra=None, flags=None, place=None):
    graph = packing.graph
    x, zero = packing.wrapped[0] if place is None else place[1], np.zeros(graph.grain_count)
    names = place[0] if place is not None else ("x", "y")
    extra = extra or {}
    columns = [packing.ids, np.ones(len(zero), int), *x.T, zero, graph.radii, *extra.values()]
    with open(path, mode) as file:
        all_names = ("id", "type", *names, "z", "radius", *extra)
        head = header("ATOMS", len(zero), all_names, graph, step, digits, flags)
        file.write(head + lines(columns, digits))


def lammps_columns(packing):
    """Columns of `property/local` and `pair/local` by their keywords."""
    graph = packing.graph
    d, force = branch_vectors(graph), -contact_forces(graph)
    length = np.hypot(*d.T)
    n = -d / length[:, None]
    normal = np.einsum("ck,ck->c", force, n)
    shear = force - normal[:, None] * n
    i, j = graph.contacts.T
    return {
        "index": np.arange(1, len(i) + 1),
        "patom1": packing.ids[i],
        "patom2": packing.ids[j],
        "dist": length,
        "dx": -d[:, 0],
        "dy": -d[:, 1],
        "dz": 0 * length,
        "force": normal,
        "fx": normal * n[:, 0],
        "fy": normal * n[:, 1],
        "p1": shear[:, 0],
        "p2": shear[:, 1],
        "p4": np.hypot(*shear.T),
    }


def write_lammps(folder, packing, step=0, *, keep=None, digits=17, mode="a", rows=None, **atoms):
    """Dumps `dump.atoms`, `dump.contacts`, columns anonymous; returns their paths."""
    own = {name: c if rows is None else c[rows] for name, c in lammps_columns(packing).items()}
    keep = list(own) if keep is None else keep
    numbers = {"c_prop": 0, "c_pair": 0}
    names = []
    for name in keep:
        stem = "c_prop" if name.startswith("patom") else "c_pair"
        numbers[stem] += name != "index"
        names.append("index" if name == "index" else f"{stem}[{numbers[stem]}]")
    paths = folder / "dump.atoms", folder / "dump.contacts"
    write_atoms(paths[0], packing, step, digits=digits, mode=mode, **atoms)
    count = len(own["index"])
    flags = atoms.get("flags")
    with open(paths[1], mode) as file:
        file.write(header("ENTRIES", count, names, packing.graph, step, digits, flags))
        file.write(lines([own[name] for name in keep], digits))
    return paths


GROUPS = ("pos", "vel", "id", "force", "force_normal", "force_tangential", "torque")
LATER = ("history", "contactArea", "delta", "contactPoint")


def liggghts_columns(packing):
    """Columns of each keyword of `pair/gran/local`, in LIGGGHTS' order."""
    graph = packing.graph
    own = lammps_columns(packing)
    zero = own["dz"]
    x, images = packing.wrapped
    i, j = graph.contacts.T
    normal = [own["fx"], own["fy"], zero]
    shear = [own["p1"], own["p2"], zero]
    reach = graph.radii[i] + graph.radii[j]
    return {
        "pos": [*x[i].T, zero, *x[j].T, zero],
        "vel": [np.sin(k + np.arange(len(i))) for k in range(6)],
        "id": [packing.ids[i], packing.ids[j], images.any(axis=1).astype(int)],
        "force": [a + b for a, b in zip(normal, shear, strict=True)],
        "force_normal": normal,
        "force_tangential": shear,
        "torque": [zero, zero, own["p4"]],
        "history": [c / 1e6 for c in shear],
        "contactArea": [reach**2],
        "delta": [reach - own["dist"]],
        "contactPoint": [*((x[i] + x[j]) / 2).T, zero],
    }


def write_liggghts(folder, packing, groups, step=0, *, digits=17, box_digits=6, mode="a"):
    """Dumps `atoms.STEP.dump`, `contacts.STEP.dump`; the header has six digits."""
    own = liggghts_columns(packing)
    columns = [column for name in own if name in groups for column in own[name]]
    names = [f"c_cpgl[{k + 1}]" for k in range(len(columns))]
    paths = folder / f"atoms.{step}.dump", folder / f"contacts.{step}.dump"
    graph, zero = packing.graph, np.zeros(packing.graph.grain_count)
    atoms = [packing.ids, zero.astype(int) + 1, *packing.wrapped[0].T, zero, graph.radii]
    with open(paths[0], mode) as file:
        atom_names = ("id", "type", "x", "y", "z", "radius")
        file.write(header("ATOMS", len(zero), atom_names, graph, step, box_digits))
        file.write(lines(atoms, digits))
    with open(paths[1], mode) as file:
        file.write(header("ENTRIES", len(columns[0]), names, graph, step, box_digits))
        file.write(lines(columns, digits))
    return paths


def write_mercury(folder, packing, time=0.0, *, layout=8, digits=17, mode="a", plane="xy"):
    """Files `box.data`, `box.fstat`: each pair twice, walls in the second place and negative."""
    graph, walls = packing.graph, packing.walls
    x, zero = packing.wrapped[0], np.zeros(graph.grain_count)
    force, d = contact_forces(graph), branch_vectors(graph)
    i, j = graph.contacts.T
    paths = folder / "box.data", folder / "box.fstat"
    number = f"%.{digits}g"
    with open(paths[0], mode) as file:
        if layout == 8:
            file.write(f"{len(zero)} {number % time} 0 0 1 1 \n")
            columns = [*x.T, zero, zero, graph.radii, zero, zero, zero.astype(int)]
        else:
            file.write(f"{len(zero)} {number % time} 0 0 0 1 1 1 \n")
            place = [*x.T, zero] if plane == "xy" else [x[:, 0], zero, x[:, 1]]
            columns = [*place, *[zero] * 3, graph.radii, *[zero] * 6, zero.astype(int)]
        file.write(lines(columns, digits, trailing=""))
    # n from the second to the first, forces on the first.
    n = -d / np.hypot(*d.T)[:, None]
    rows = [*mercury_rows(x, graph.radii, i, j, n, -force, np.hypot(*d.T))]
    with open(paths[1], mode) as file:
        file.write(f"# {number % time} 1\n# 0 0 0 1 1 1\n# 0.1 0.2 0 0 0 0\n")
        pairs = [np.concatenate([a, b]) for a, b in zip(*rows, strict=True)]
        order = np.arange(2 * len(i)).reshape(2, -1).T.ravel()
        file.write(mercury_lines(time, [c[order] for c in pairs], digits, plane))
        if walls is not None:
            file.write(mercury_lines(time, mercury_walls(packing), digits, plane))
    return paths


def mercury_rows(x, radii, i, j, n, force_on_i, length):
    """Columns i, j, cx, cy, delta, fn, ft, nx, ny, tx, ty, and those of the pair turned round."""
    fn = np.einsum("ck,ck->c", force_on_i, n)
    shear = force_on_i - fn[:, None] * n
    ft = np.hypot(*shear.T)
    t = shear / np.where(ft > 0, ft, 1.0)[:, None]
    delta = radii[i] + radii[j] - length
    c = x[i] - n * (radii[i] - delta / 2)[:, None]
    yield [i, j, *c.T, delta, fn, ft, *n.T, *t.T]
    yield [j, i, *c.T, delta, fn, ft, *-n.T, *-t.T]


def wall_numbers(packing):
    """Walls of a box: 0 to 3 by the side on which the foot lies."""
    n = packing.walls.branch / np.hypot(*packing.walls.branch.T)[:, None]
    return np.rint(np.arctan2(n[:, 1], n[:, 0]) / (np.pi / 2)).astype(int) % 4


def mercury_walls(packing):
    """Rows of the walls: normal and tangent turned round, as the code's own comment says."""
    walls, graph = packing.walls, packing.graph
    length = np.hypot(*walls.branch.T)
    n = walls.branch / length[:, None]
    fn = np.einsum("wk,wk->w", walls.force, n)
    shear = walls.force - fn[:, None] * n
    ft = np.hypot(*shear.T)
    t = shear / np.where(ft > 0, ft, 1.0)[:, None]
    delta = graph.radii[walls.grain] - length
    c = packing.wrapped[0][walls.grain] - n * (length + delta / 2)[:, None]
    return [walls.grain, -1 - wall_numbers(packing), *c.T, delta, fn, ft, *-n.T, *-t.T]


def mercury_lines(time, columns, digits, plane):
    i, j, cx, cy, delta, fn, ft, nx, ny, tx, ty = columns
    zero, now = np.zeros(len(i)), np.full(len(i), time)
    vectors = [(a, b, zero) if plane == "xy" else (a, zero, b) for a, b in ((cx, cy), (nx, ny))]
    vectors.append((tx, ty, zero) if plane == "xy" else (tx, zero, ty))
    c, n, t = vectors
    return lines([now, i, j, *c, delta, zero, fn, ft, *n, *t], digits, trailing="")


def lammps_walls(packing):
    """Per-atom columns of `fix wall/gran ... contacts` for the four sides."""
    walls, zero = packing.walls, np.zeros(packing.graph.grain_count)
    found = {}
    for number in range(4):
        own = wall_numbers(packing) == number
        grain, foot = walls.grain[own], packing.graph.x[walls.grain[own]] - walls.branch[own]
        values = (np.ones(own.sum()), *walls.force[own].T, np.zeros(own.sum()), *foot.T)
        for k, value in enumerate(values):
            column = zero.copy()
            column[grain] = value
            found[f"f_w{number}[{k + 1}]"] = column
    return found


def contacts_by_ids(graph, ids):
    """Contacts seen from the lower id: (C, 6) rows of ids, branch, force on the higher one."""
    named = ids[graph.contacts]
    turned = named[:, 0] > named[:, 1]
    sign = np.where(turned, -1.0, 1.0)[:, None]
    rows = np.column_stack([np.sort(named), sign * branch_vectors(graph)])
    # Actio = reactio: seen from the other grain the force turns with the branch.
    rows = np.column_stack([rows, sign * contact_forces(graph)])
    return rows[np.lexsort((np.round(rows[:, 3], 6), np.round(rows[:, 2], 6), *rows.T[1::-1]))]


def assert_same(snapshot, packing, rtol):
    """The snapshot has the packing's grains, contacts, forces and loops."""
    ours, theirs = np.argsort(snapshot.ids), np.argsort(packing.ids)
    assert snapshot.ids[ours].tolist() == packing.ids[theirs].tolist()
    assert np.abs(snapshot.graph.radii[ours] / packing.graph.radii[theirs] - 1).max() <= rtol
    read = contacts_by_ids(snapshot.graph, snapshot.ids)
    written = contacts_by_ids(packing.graph, packing.ids)
    assert read[:, :2].tolist() == written[:, :2].tolist()
    for columns in (slice(2, 4), slice(4, 6)):
        scale = np.abs(written[:, columns]).max()
        assert np.abs(read - written)[:, columns].max() <= rtol * scale
    assert loops_by_ids(snapshot.graph, snapshot.ids) == loops_by_ids(packing.graph, packing.ids)


def loops_by_ids(graph, ids):
    """Loops as sorted cycles of ids, the smallest first."""
    faces = find_faces(graph)
    found = []
    for face in faces.loops.tolist():
        own = ids[faces.grains[faces.offsets[face] : faces.offsets[face + 1]]]
        found.append(tuple(np.roll(own, -int(np.argmin(own))).tolist()))
    return sorted(found)
