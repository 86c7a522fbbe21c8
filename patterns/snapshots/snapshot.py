"""One snapshot of a discrete-element simulation, a loop cut out of it, and the samples."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from loops import (
    ContactLaw,
    Faces,
    GrainGraph,
    InputError,
    Regime,
    contact_forces,
    contact_state,
    crossing_contacts_to_drop,
    find_crossings,
    find_faces,
    outline_area,
)
from loops.arrays import Integers, Regimes
from loops.assembly import contact_regime
from loops.boundary import Boundary, boundary_of, outline_grains
from loops.errors import check_type, counted, path_of, short, whole_number
from loops.graph import Kept, graph_of_kept, graph_without
from loops.laws.frictional import of_tables, require_law
from loops.loop_batches import loop_batches
from loops.pruning import prune_dangling
from loops.scene import Scene, Subject, scene_of
from loops.shown import Shown
from loops.validation import checked_regimes, integers
from patterns.snapshots.columns import WHEN, components
from patterns.snapshots.findings import MOST_CROSSINGS, Finding, few
from patterns.snapshots.walls import WallContacts, box_area, wall_plates

# Options that give the law of the contacts.
STIFFNESS = ("kn", "kt", "young", "poisson", "adhesion")


@dataclass(frozen=True, eq=False, repr=False)
class Snapshot(Shown):
    """Grains, contacts and law of one snapshot, walls set aside.

    Attributes
    ----------
    graph : GrainGraph
        Grains and the contacts between them; forces compression positive; the reference is the
        current configuration; periodic if there is a cell.
    law : ContactLaw or None
        Law of the contacts as it is read, `LinearFrictional`, `CohesiveFrictional` or
        `HertzMindlin`; None if the file
        lacks forces, their shear part or a stiffness, see `lacks`: then the graph has those forces
        that the file has, else zeros.
    regime : (C,) array of int8 or None
        `Regime` of each contact, sliding where the file flags it; None with the law.
    ids : (G,) array of int
        Ids of the grains as the file has them.
    wall_contacts : int
        Number of contacts with walls, which belong to no loop.
    notes : tuple of str
        Assumptions and omissions, for the reader of the results.
    walls : WallContacts or None
        Forces of the walls, None if the file has none.
    step : float or None
        The code's own number of the snapshot.
    findings : tuple of Finding
        Results of the checks, also where nothing is wrong; doubts are repeated in the notes.
    rotation : (G,) array or None
        Angle that each grain has turned by, up to full turns (rad); None if the file lacks it.
    lacks : tuple of str
        All that is missing for a law: 'forces', 'shear forces', 'kn', 'kt', 'young', 'poisson',
        'adhesion', 'balance' (of forces that were measured).
    mass : (G,) array or None
        Masses of the grains (mass); None if the file lacks them.
    time : float or None
        Time of the snapshot, if the file tells it.
    velocity, spin : (G, 2), (G,) array or None
        Velocities of the centres (length/time), spins (rad/time, anticlockwise) as the file has
        them; None if it lacks one of the three.
    periodic : tuple of bool
        Along which of its vectors the cell of the graph repeats; along the other one, of a sample
        between walls, it is as high as they are apart.

    Examples
    --------
    >>> from patterns import read_snapshot, sample_path
    >>> snapshot = read_snapshot(sample_path())
    >>> snapshot
    Snapshot(grains: 600, contacts: 819, contacts with walls: 61, forces: known, notes: 1)
    >>> len(snapshot.faces.loops), snapshot.walls.force.shape
    (309, (61, 2))
    """

    graph: GrainGraph
    law: ContactLaw | None
    regime: NDArray[np.int8] | None
    ids: NDArray[np.int64]
    wall_contacts: int
    notes: tuple[str, ...]
    walls: WallContacts | None = None
    step: float | None = None
    findings: tuple[Finding, ...] = ()
    rotation: NDArray[np.float64] | None = None
    lacks: tuple[str, ...] = ()
    mass: NDArray[np.float64] | None = None
    time: float | None = None
    velocity: NDArray[np.float64] | None = None
    spin: NDArray[np.float64] | None = None
    periodic: tuple[bool, bool] = (True, True)

    def __post_init__(self) -> None:
        check_type("graph", self.graph, GrainGraph, "Give what gl.read_snapshot returns.")
        integers("ids", self.ids, self.graph.grain_count)
        if self.regime is not None:
            checked_regimes(self.regime, self.graph.contact_count)
        if self.law is not None:
            require_law(self.law, self.graph.contact_shape)

    @cached_property
    def faces(self) -> Faces:
        """The faces of its graph, as `find_faces` finds them."""
        return self.scene.faces if "scene" in vars(self) else find_faces(self.graph)

    @cached_property
    def area(self) -> tuple[float, str]:
        """Area that stresses refer to, and which: cell, box within upright walls, else outline."""
        if self.graph.cell is not None:
            return float(np.abs(np.linalg.det(self.graph.cell))), "cell"
        if self.walls is not None and (box := box_area(self.graph.x, self.walls)):
            return box, "box within the walls"
        return outline_area(self.graph, self.faces), "outline of the network"

    @cached_property
    def boundary_and_notes(self) -> tuple[Boundary, list[str]]:
        """Return the boundary of the sample, and notes on it, see `sample_boundary`."""
        return sample_boundary(self)

    @cached_property
    def scene(self) -> Scene:
        """Return graph, law and boundary; `InputError` that names what is missing for a law."""
        (law, regime), graph = self.mechanics(), self.graph
        if graph.regime is not regime:
            graph = graph.replace(regime=regime)
        scene = Scene(graph, law, self.boundary_and_notes[0], self.ids)
        if "faces" in vars(self):
            # Already found.
            vars(scene)["faces"] = self.faces
        return scene

    def without(self, grains: ArrayLike = (), contacts: ArrayLike = ()) -> Snapshot:
        """Return the snapshot without some grains and contacts, as they stand: out of balance.

        Parameters
        ----------
        grains : (K,) array of int
            Their ids; their contacts, with walls too, go along.
        contacts : (M, 2) array of int
            Pairs of ids, all contacts of each.

        Returns
        -------
        Snapshot
            A note says what was left out; area and cell of the sample stay. `gl.hold` brings it to
            rest.

        Raises
        ------
        InputError
            For an id or a contact that there is not.

        Examples
        --------
        >>> from patterns import read_snapshot, sample_path
        >>> read_snapshot(sample_path()).without(grains=[96], contacts=[[97, 120]])
        Snapshot(grains: 599, contacts: 814, contacts with walls: 61, forces: known, notes: 2)
        """
        scene = self.scene
        ids = [integers(name, one) for name, one in (("grains", grains), ("contacts", contacts))]
        number = {one: k for k, one in enumerate(self.ids.tolist())}
        unknown = [str(one) for part in ids for one in part.ravel().tolist() if one not in number]
        if unknown:
            expected, remedy = "ids of the snapshot", "Look in snapshot.ids."
            raise InputError("without", f"ids {few(unknown)}", expected, remedy)
        gone, pairs = (np.vectorize(number.get, otypes=[int])(one) for one in ids)
        kept = graph_without(scene.graph, gone, pairs)
        lost = self.graph.contact_count - len(kept.contacts)
        left_out = counted(len(self.ids) - len(kept.grains), "grain"), counted(lost, "contact")
        less = self.of_kept(kept, f"{' and '.join(left_out)} left out")
        # The area of the sample stays.
        vars(less)["area"] = self.area
        boundary = scene.boundary.of_kept(kept.grains, len(self.ids))
        vars(less)["boundary_and_notes"] = boundary, self.boundary_and_notes[1]
        return less

    def of_kept(self, kept: Kept, note: str) -> Snapshot:
        """The snapshot with these grains and contacts alone, as they stand, and a note more."""
        names, walls = ("rotation", "mass", "velocity", "spin", "ids"), self.walls
        known = {name: value for name in names if (value := getattr(self, name)) is not None}
        own: Any = {name: value[kept.grains] for name, value in known.items()}
        if walls is not None:
            walls = walls.of_kept(kept.grains)
            own |= {"walls": walls, "wall_contacts": len(walls.grain)}
        own["law"] = None if self.law is None else self.law.take(kept.contacts)
        own |= {"regime": kept.graph.regime, "notes": (*self.notes, note)}
        return replace(self, graph=kept.graph, **own)

    def facts(self) -> dict[str, object]:
        """Facts that the prompt and a notebook show."""
        facts = {**self.graph.facts(), "contacts with walls": self.wall_contacts}
        if self.lacks:
            facts["missing"] = ", ".join(self.lacks)
        return {**facts, "forces": "known" if self.has_forces else "none", "notes": len(self.notes)}

    @property
    def mechanical(self) -> bool:
        """Whether there are forces and a law; else no tangent is known."""
        return self.law is not None

    @property
    def has_forces(self) -> bool:
        """Whether normal and shear forces are known, with a stiffness or without."""
        return self.mechanical or bool(self.lacks and {*self.lacks} <= {*STIFFNESS, "balance"})

    @cached_property
    def rattlers(self) -> int:
        """Number of grains with fewer than two contacts, walls included, pruned again and again."""
        walls, count = self.walls, self.graph.grain_count
        supports = None if walls is None else np.bincount(walls.grain, minlength=count)
        return int(np.count_nonzero(~prune_dangling(self.graph, supports=supports)[0]))

    @cached_property
    def mean_kn(self) -> float:
        """Mean normal stiffness of the contacts, all taken as elastic (force per length)."""
        (law, _), graph = self.mechanics(), self.graph
        if of_tables(law):
            kn = (law.constant_springs or law.stiffnesses(contact_state(graph)))[0]
        else:
            elastic = np.full(graph.contact_count, Regime.ELASTIC, dtype=np.int8)
            kn = law.local_stiffness(contact_state(graph), elastic)[..., 0, 0]
        return float(np.mean(np.broadcast_to(kn, graph.contact_count)))

    def mechanics(self) -> tuple[ContactLaw, NDArray[np.int8]]:
        """Law and regime of the contacts; `InputError` that names all that is missing."""
        if self.law is not None and self.regime is not None:
            return self.law, self.regime
        lacks = self.lacks or ("forces",)
        options = " and ".join(f"--{name}" for name in lacks if name in STIFFNESS)
        remedies = [] if self.has_forces else ["export the contact forces"]
        remedies += [f"give {options} or such columns"] if options else []
        told = {"stiffness", *(("balance",) if "balance" in lacks else ())}
        remedies += [one.says for one in self.findings if one.check in told]
        remedy = "; ".join(remedies)
        received = ", ".join(f"no {name}" for name in lacks)
        raise InputError(
            "snapshot", received, "forces and a law", f"{remedy[0].upper()}{remedy[1:]}."
        )

    def tables(self) -> dict[str, Any]:
        """Its tables as dicts of arrays: `snapshot_from_tables(**snapshot.tables())` is the same.

        `grains` and `contacts` have the columns that `read_snapshot` reads, without forces or a
        law those of the geometry; the step and the time, if known, stand in each row of `grains`;
        `walls` has a row a contact with a wall: `id` of the grain, `fx, fy` on it, `branch_x,
        branch_y` from the foot to the centre, `kn, ks, mu`; None if there is none. Besides `cell`
        (2, 2) and `shear_increment`, or None; under Hertz's law, whose tangents are `kn` and `ks`,
        also `law` and `shear_history`, under a cohesive one `law`.

        Examples
        --------
        >>> from patterns import read_snapshot, sample_path
        >>> tables = read_snapshot(sample_path()).tables()
        >>> [*tables["grains"]], len(tables["contacts"]["fx_on_2"]), len(tables["walls"]["id"])
        (['id', 'x', 'y', 'radius', 'theta_z', 'mass', 'vx', 'vy', 'omega_z'], 819, 61)
        """
        graph, ids, walls = self.graph, self.ids, self.walls
        grains = {"id": ids} | components("@", graph.x) | {"radius": graph.radii}
        if self.rotation is not None:
            grains["theta_z"] = self.rotation
        if self.mass is not None:
            grains["mass"] = self.mass
        if self.velocity is not None and self.spin is not None:
            grains |= components("v@", self.velocity) | {"omega_z": self.spin}
        when = {name: value for name in WHEN if (value := getattr(self, name)) is not None}
        grains |= {name: np.full(len(ids), value) for name, value in when.items()}
        one, two = graph.contacts.T
        contacts = {"id1": ids[one], "id2": ids[two]} | components("branch_@", graph.branches)
        if graph.images is not None:
            contacts |= components("cell_d@", graph.images)
        if self.has_forces:
            contacts |= components("f@_on_2", contact_forces(graph))
        elif graph.normal_force.any():
            contacts["fn"] = graph.normal_force
        if graph.rolling_moment is not None:
            contacts["mz_on_2"] = graph.rolling_moment
        if self.law is not None and not of_tables(self.law):
            expected = "a law that columns can hold: linear, cohesive or Hertz's"
            received, remedy = type(self.law).__name__, "Keep the law beside the tables."
            raise InputError("law", received, expected, remedy)
        if self.law is not None and self.regime is not None:
            kn, kt = self.law.stiffnesses(contact_state(graph))
            law = {"kn": kn, "ks": kt, "mu": self.law.mu}
            if self.law.cohesive:
                law |= {"adhesion": self.law.adhesion, "cohesion": self.law.cohesion}
            # Friction that the file lacked is infinite here, which no file holds.
            known = {name: values for name, values in law.items() if np.isfinite(values).all()}
            contacts |= {n: np.broadcast_to(v, graph.contact_count) for n, v in known.items()}
            contacts["sliding"] = (self.regime == Regime.SLIDING).astype(np.int8)
        of_walls: dict[str, NDArray[Any]] | None = None
        if walls is not None and len(walls.grain):
            of_walls = {"id": ids[walls.grain]} | components("f@", walls.force)
            of_walls |= components("branch_@", walls.branch)
            flags = None if walls.sliding is None else walls.sliding.astype(np.int8)
            springs = (("kn", walls.kn), ("ks", walls.kt), ("mu", walls.mu), ("sliding", flags))
            of_walls |= {n: v for n, v in springs if v is not None}
        return {
            "grains": grains,
            "contacts": contacts,
            "walls": of_walls,
            "cell": graph.cell,
            "shear_increment": None if self.law is None else self.law.shear_increment,
            **({} if all(self.periodic) else {"periodic": "xy"[self.periodic.index(True)]}),
            **(self.law.table_words or {} if of_tables(self.law) else {}),
        }


def snapshot_of(subject: Snapshot | Subject, where: str = "first argument") -> Snapshot:
    """Return the snapshot of a question's argument: itself, or one of a scene's grains.

    `InputError` for anything else.
    """
    if isinstance(subject, Snapshot):
        return subject
    scene = scene_of(subject, where)
    graph, walls, at_walls = scene.graph, scene.boundary.walls, None
    if walls is not None:
        if walls.force is None:
            raise InputError("walls of the scene", "no forces", "force (W, 2)", "Give them.")
        sliding = walls.regime == Regime.SLIDING
        springs = walls.kn, walls.kt, walls.mu
        at_walls = WallContacts(walls.grain, walls.force, -walls.branch, *springs, sliding)
    regime = contact_regime(contact_state(graph), scene.law)
    own = graph.replace(regime=regime)
    count = 0 if walls is None else len(walls.grain)
    snapshot = Snapshot(own, scene.law, regime, scene.ids, count, (), at_walls)
    # The boundary stays the scene's own.
    vars(snapshot)["scene"] = replace(scene, graph=own)
    if scene.given_volume not in (None, snapshot.area[0]):
        vars(snapshot)["area"] = scene.given_volume, "as given"
    return snapshot


def sample_boundary(snapshot: Snapshot) -> tuple[Boundary, list[str]]:
    """Return the boundary of a sample, and notes: its walls, its cell, or else its outline held."""
    graph, walls = snapshot.graph, snapshot.walls
    if walls is not None:
        planes, notes = wall_plates(graph, walls, snapshot.law)
        return boundary_of(graph, walls=planes, volume=snapshot.area[0]), notes
    if graph.cell is not None:
        return boundary_of(graph), []
    held = outline_grains(graph, snapshot.faces)
    note = (
        f"no walls known: the {np.count_nonzero(held)} grains of the outline follow the affine "
        "motion; their own loops are not judged in the packing, loops beside them are judged "
        "too stiff"
    )
    return boundary_of(graph, held=held, volume=snapshot.area[0]), [note]


@dataclass(frozen=True, eq=False, repr=False)
class SnapshotLoop(Shown):
    """A loop as the simulation left it.

    Attributes
    ----------
    graph : GrainGraph
        Grains counter-clockwise, contacts (c, c+1), unrolled from the first one at the origin
        if the loop crosses a periodic border; forces and regimes as in the snapshot, the reference
        is the current configuration.
    law : ContactLaw
        Law of the n contacts.
    regime : (n,) array of int8
        `Regime` of the contacts, sliding where the snapshot flags it.
    ids : (n,) array of int
        Ids of the grains as the file has them.
    grains, contacts : (n,) array of int
        Grains and contacts as numbered in the snapshot's graph.
    """

    graph: GrainGraph
    law: ContactLaw
    regime: Regimes
    ids: Integers
    grains: Integers
    contacts: Integers

    @property
    def scene(self) -> Scene:
        """The loop as a scene: free, its law and forces those of the snapshot."""
        return Scene(self.graph, self.law)

    def facts(self) -> dict[str, object]:
        """Facts that the prompt and a notebook show."""
        sliding = int(np.count_nonzero(self.regime == Regime.SLIDING))
        return {"grains": self.ids.tolist(), "contacts sliding": sliding}


def loop_of_snapshot(snapshot: Snapshot, loop: int | None) -> SnapshotLoop:
    """Cut one loop out of a snapshot by its id.

    Parameters
    ----------
    snapshot : Snapshot
        The snapshot.
    loop : int or None
        Number of the loop in `snapshot.faces.loops`, the id in the table of loops; None for the
        only one.

    Returns
    -------
    SnapshotLoop
        The loop's graph, law, regimes and ids.

    Raises
    ------
    InputError
        If there is no loop of that number, or none is named of several.

    Examples
    --------
    >>> from patterns import loop_of_snapshot, read_snapshot, sample_path
    >>> loop = loop_of_snapshot(read_snapshot(sample_path()), 3)
    >>> loop.graph.grain_count == len(loop.ids) == len(loop.regime)
    True
    """
    faces = snapshot.faces
    count = len(faces.loops)
    given = 0 if loop is None and count == 1 else loop
    if given is None or not 0 <= whole_number("loop", given, 0) < count:
        received = "none" if given is None else str(given)
        remedy = "Pick one of the column loop of loops.parquet, or of gl.loop_table."
        raise InputError("loop", received, f"a number from 0 to {count - 1}", remedy)
    law, regime = snapshot.mechanics()
    (batch,) = loop_batches(snapshot.graph, faces, loops=faces.loops[[given]])
    (grains,), (contacts,), cut = batch.grains, batch.contacts, batch.graph
    graph = GrainGraph(
        x=cut.x[0],
        radii=cut.radii[0],
        contacts=cut.contacts,
        **{name: None if v is None else v[0] for name, v in cut.at_contacts(slice(None)).items()},
    ).replace(regime=regime[contacts])
    return SnapshotLoop(
        graph, law.take(contacts), regime[contacts], snapshot.ids[grains], grains, contacts
    )


def planar(
    snapshot: Snapshot | Subject, where: str = "the snapshot", *, drop: bool = False
) -> Snapshot:
    """Return a snapshot whose network has no crossing branches, so that its loops are defined.

    Parameters
    ----------
    snapshot : Snapshot or Scene
        A scene's grains are numbered as in its graph.
    where : str
        Its name in the error.
    drop : bool
        Whether to leave out one contact of each crossing pair, the less loaded one.

    Returns
    -------
    Snapshot
        The same one if no branches cross; its notes name the contacts that were left out.

    Raises
    ------
    InputError
        If branches cross and `drop` is false.

    Examples
    --------
    Both diagonals of a square of four grains:

    >>> from patterns import snapshot_from_tables
    >>> grains = {"id": range(4), "x": [0, 1, 1, 0], "y": [0, 0, 1, 1], "r": [0.71] * 4}
    >>> contacts = {"i": [0, 1, 2, 3, 0, 1], "j": [1, 2, 3, 0, 2, 3]}
    >>> crossed = snapshot_from_tables(grains, contacts, strict=False)
    >>> planar(crossed, drop=True).graph.contact_count
    5
    """
    snapshot = snapshot_of(snapshot)
    pairs = find_crossings(snapshot.graph, MOST_CROSSINGS)
    if len(pairs) == 0:
        return snapshot
    graph = snapshot.graph
    if not drop:
        named = snapshot.ids[graph.contacts[pairs]]
        shown = few(named, lambda ab: "{0[0]}-{0[1]} and {1[0]}-{1[1]}".format(*ab), mark="; ")
        raise InputError(
            f"contacts of {where}",
            f"{counted(len(pairs), 'pair')} of crossing branches (grains {shown})",
            "a planar network",
            "Opposite grains of a loop overlap, or the cell is wrong; --drop-crossings (in Python "
            "gl.planar(snapshot, drop=True)) leaves out one contact of each pair, the less loaded "
            "one.",
        )
    dropped = crossing_contacts_to_drop(graph, pairs)
    kept = ~np.isin(np.arange(graph.contact_count), dropped)
    ten = few(snapshot.ids[graph.contacts[dropped]], lambda pair: "{}-{}".format(*pair), 10)
    note = (
        f"{counted(len(pairs), 'pair')} of crossing branches: "
        f"{counted(len(dropped), 'contact')} left out, of grains "
        f"{ten}; their forces are missing in every stress"
    )
    every = np.ones(graph.grain_count, dtype=bool)
    return snapshot.of_kept(graph_of_kept(graph, every, kept), note)


SAMPLE = Path(__file__).parent / "sample"


def sample_path(name: str = "grains_biaxial.csv.gz") -> Path:
    """Path of a sample file: `grains_biaxial.csv.gz` or `grains_periodic.parquet`.

    Parameters
    ----------
    name : str
        File name in the sample folder.

    Returns
    -------
    Path
        Where it is installed.

    Examples
    --------
    >>> from patterns import sample_path
    >>> sample_path().name
    'grains_biaxial.csv.gz'
    """
    path = SAMPLE / path_of("name", name, "Leave it out.")
    if not path.exists():
        known = ", ".join(sorted(one.name for one in SAMPLE.iterdir()))
        raise InputError("name", short(name), known, "Take one of the samples.")
    return path


def sample_cell() -> NDArray[np.float64]:
    """Periodic cell of `grains_periodic.parquet`, columns are the cell vectors (m).

    Returns
    -------
    (2, 2) array
        Cell vectors.

    Examples
    --------
    >>> from patterns import read_snapshot, sample_cell, sample_path
    >>> snapshot = read_snapshot(sample_path("grains_periodic.parquet"), cell=sample_cell())
    >>> snapshot.graph.cell.shape, len(snapshot.faces.loops)
    ((2, 2), 1004)
    """
    return np.array(json.loads((SAMPLE / "macro.json").read_text())["cell"])
