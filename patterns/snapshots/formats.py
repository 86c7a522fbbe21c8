"""The formats of snapshots: recognised by the content of a file, and read."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

from loops import InputError
from loops.errors import check_choice, whole_number
from patterns.snapshots.build import build_snapshot
from patterns.snapshots.cells import cell_reader
from patterns.snapshots.files import head_of, require_file
from patterns.snapshots.frame import Frames, frame_of_tables, is_table, table_frames
from patterns.snapshots.geometry import as_cell
from patterns.snapshots.lammps import is_lammps, lammps_frames
from patterns.snapshots.liggghts import is_liggghts, liggghts_frames
from patterns.snapshots.mercury import is_mercury, mercury_frames
from patterns.snapshots.pegs import is_pegs, pegs_frames
from patterns.snapshots.snapshot import Snapshot
from patterns.snapshots.source import Source, source_of
from patterns.snapshots.tables import given_table
from patterns.snapshots.yade_save import is_yade_save, yade_save_frames


class Format(NamedTuple):
    """A reader of one format.

    `recognises(path, head)`: whether a file of this name that begins so is in this format.
    `frames(source)`: the snapshots of a file, without reading their rows. A damaged one is
    counted, and raises `InputError` when it is read, which may be in another cell.
    """

    recognises: Callable[[Path, bytes], bool]
    frames: Callable[[Source], Frames]


# First bytes of other files of Yade, and what they lack.
LOSSY = {
    b"#format ": "spheres alone (export.text)",
    b"# vtk DataFile": "VTK with six digits (export.VTKExporter)",
    b"<VTKFile": "VTK without shear forces and stiffness (VTKRecorder)",
    b"serialization::archive": "Yade's binary save",
}


def refuse_lossy(path: Path, head: bytes) -> None:
    """Raise `InputError` for files of Yade from which no mechanics can be read."""
    for start, lack in LOSSY.items():
        if start in head[:64]:
            expected = "centres, forces and stiffnesses of all contacts, with all their digits"
            remedy = (
                'Write them inside Yade by export_tables("out") of yade_export.py, for a binary '
                "save after O.load(...): see docs/yade.md."
            )
            raise InputError(str(path), lack, expected, remedy)


# The first one that recognises a file takes it.
FORMATS = {
    "yade-xml": Format(is_yade_save, yade_save_frames),
    # Dumps of atoms of both codes look alike: LIGGGHTS is recognised by its dump of contacts.
    "liggghts": Format(is_liggghts, liggghts_frames),
    "lammps": Format(is_lammps, lammps_frames),
    "mercury": Format(is_mercury, mercury_frames),
    "pegs": Format(is_pegs, pegs_frames),
    "table": Format(is_table, table_frames),
}


def read_snapshot(
    path: str | Path,
    contacts: str | Path | None = None,
    *,
    cells: str | Path | None = None,
    frame: int | None = None,
    **options: Any,
) -> Snapshot:
    """Read one snapshot of a simulation, of a file with several that one alone.

    Plain tables (CSV and other text, Parquet, npz, HDF5), columns by name; delimiter and decimal
    comma of a text are found, lines of `#` left out, aliases such as `rad` or `F_n` noted. Grains:
    `id`, `x`, `y`, `radius` (length), perhaps `theta_z`, the angle turned by (rad); rows with
    `type` 1 are walls. Contacts: `id1`, `id2`; optional are the branch `branch_x, branch_y` or the
    normal `nx, ny`, from grain 1 to grain 2; the forces: `fn` (compression positive) and the shear
    force on grain 2, `fsx, fsy` or `ft` along the normal turned by 90 degrees counter-clockwise, or
    the total force `fx_on_2, fy_on_2` on grain 2; `kn`, `ks` (force per length); `mu`; `sliding` (0
    or 1); `adhesion`, `cohesion` (force) of `CohesiveFrictional`; `mz_on_2`, the moment of a
    rolling spring on grain 2; `cell_dx, cell_dy`, the image of grain 2. Other formats are
    translated into these tables.

    Parameters
    ----------
    path : str or Path
        The file, or that of the grains.
    contacts : str or Path, optional
        The file of contacts. Found beside `path` if left out: for tables, `grains` in its name
        replaced by `contacts`.
    cells : str or Path, optional
        A table with the cell of each snapshot, columns `snap, h_xx, h_xy, h_yx, h_yy`; `snap` is
        the last number in the name of the file, or `frame`.
    frame : int, optional
        Which snapshot of a file with several, from 0; -1 is the last one.

    Other Parameters
    ----------------
    cell : (2, 2) array, optional
        Periodic cell, its columns are the cell vectors (length); comes before the file's own.
    periodic : {'xy', 'x', 'y'}, optional
        Along which of these vectors the sample is periodic, by default both. Between walls the
        other one gets the height from foot to foot.
    kn, kt, mu, phi : float, optional
        Stiffness (force per length) and friction where the file lacks them, the coefficient `mu` or
        its angle `phi` (radians); a column of the file comes first.
    shear_increment : {'branch', 'radii'}, optional
        Shear increment of the code (see `LinearFrictional`); by default that of the source:
        `radii` for Yade, else `branch`.
    law : {'linear', 'hertz', 'cohesive', 'bonded'}, optional
        Contact law of the simulation; by default that of the source, else Hertz's where `kn` goes
        with the root of the overlap and `N` is 2/3 of both, else linear. Under Hertz's law columns
        `kn` and `ks` are tangents, from which modulus and kt/kn of each contact follow. 'cohesive'
        and 'bonded' are `CohesiveFrictional`, attraction or bonds that break; a column `adhesion`
        that is not zero tells one of them, by the forces.
    young, poisson : float, optional
        Under Hertz's law Young's modulus of the grains (force per length squared) and Poisson's
        ratio, in place of columns `kn` and `ks`.
    shear_history : {'force', 'displacement'}, optional
        What a contact keeps under Hertz's law while its overlap changes, see `HertzMindlin`; by
        default that of the source, else `force`, as in Yade.
    adhesion, cohesion : float, optional
        Under a law with cohesion, where the file has no such columns: the largest pull of a contact
        and what it adds to `mu N` (force); of the latter `mu` times the former if left out.
    format : str
        A key of `FORMATS`, or 'auto': the first format that recognises the file.
    columns : mapping, optional
        Plain name to the column that holds it, its number from 0 in a table without header, 'none'
        for a column that is not to be used.
    strict : bool
        Whether a finding that leaves no meaningful result is refused, which is so if left out; if
        not, it stands in the notes and in `Snapshot.findings`.

    Returns
    -------
    Snapshot
        Grains, contacts between grains, law, regimes and ids. Without forces, `law` and `regime`
        are None.

    Raises
    ------
    InputError
        For a missing, empty or truncated file, a missing column, a value that is no finite
        number, coincident grains, an id that is unknown or repeated, a radius that is
        not positive, a repeated contact, a cell that does not fit, no contacts, a
        packing in three dimensions, forces without a stiffness, several snapshots and no `frame`.

    Examples
    --------
    >>> from patterns import read_snapshot, sample_path
    >>> snapshot = read_snapshot(sample_path())
    >>> snapshot.graph.grain_count, snapshot.graph.contact_count, snapshot.wall_contacts
    (600, 819, 61)
    """
    source = source_of(path, contacts, **options)
    found = frames_of(source)
    if frame is None and len(found) > 1:
        remedy = "Give --frame 0 for the first, --frame -1 for the last; for all: series."
        raise InputError(str(path), f"{len(found)} snapshots", "one", remedy)
    place = 0 if frame is None else whole_number("--frame", frame, -len(found))
    if place >= len(found):
        received, expected = f"{path} has {len(found)}", f"a number below {len(found)}"
        raise InputError(f"--frame {place}", received, expected, "Count from 0.")
    own = _in_cells(source, cells)(None if frame is None else place % len(found))
    return build_snapshot(found[place].read(own), own)


def snapshot_from_tables(
    grains: Any,
    contacts: Any,
    *,
    walls: Any = None,
    **options: Any,
) -> Snapshot:
    """Make a snapshot of tables in memory, as `read_snapshot` makes one of files.

    Parameters
    ----------
    grains, contacts : data frame, dict of arrays or structured array
        Of pandas, polars or pyarrow. Columns, other names of them and optional ones as in
        `read_snapshot`; contacts with rows of `type` 1 are those with walls.
    walls : data frame, dict of arrays or structured array, optional
        A row a contact with a wall, where walls are no rows of `grains`: `id` of the grain, force
        of the wall on it `fx, fy`, `branch_x, branch_y` from the foot on the wall to its centre
        (length); perhaps the stiffness `kn, ks`, `ks` zero where nothing sticks, and friction `mu`.
    **options
        Other parameters of `read_snapshot`, but for the format: `cell`, `periodic`, `columns`,
        `strict`, those of the law.

    Returns
    -------
    Snapshot
        `Snapshot.tables` gives such tables back.

    Raises
    ------
    InputError
        As `read_snapshot`; for what is no table, and columns of different lengths.

    Examples
    --------
    >>> from patterns import snapshot_from_tables
    >>> grains = {"id": [1, 2, 3], "x": [0.0, 0.9, 0.4], "y": [0.0, 0.0, 0.8], "d": [1.0, 1.0, 1.0]}
    >>> contacts = {"i": [1, 2, 3], "j": [2, 3, 1], "fn": [3.0, 2.0, 2.0], "mu": [0.0, 0.0, 0.0]}
    >>> snapshot = snapshot_from_tables(grains, contacts, kn=30.0, kt=0.0)
    >>> snapshot.graph.radii.tolist(), snapshot.graph.normal_force.round(12).tolist()
    ([0.5, 0.5, 0.5], [3.0, 2.0, 2.0])
    >>> for note in snapshot.notes[:3]:
    ...     print(note)
    column 'd' of grains read as 'diameter'
    column 'i' of contacts read as 'id1'
    column 'j' of contacts read as 'id2'
    """
    given = {"grains": grains, "contacts": contacts} | ({} if walls is None else {"walls": walls})
    tables = {kind: given_table(kind, one) for kind, one in given.items()}
    source = source_of("tables", **options)
    return build_snapshot(frame_of_tables(source, tables), source)


def read_frames(
    path: str | Path,
    contacts: str | Path | None = None,
    *,
    cells: str | Path | None = None,
    **options: Any,
) -> Iterator[Snapshot]:
    """Read every snapshot of a file, one after the other.

    Parameters
    ----------
    path, contacts, cells
        See `read_snapshot`.
    **options
        Its other parameters.

    Yields
    ------
    Snapshot
        In the order of the file.

    Raises
    ------
    InputError
        See `read_snapshot`.

    Examples
    --------
    >>> from patterns import read_frames, sample_path
    >>> path = sample_path("lammps/dump.atoms.0.gz")
    >>> [(snapshot.step, len(snapshot.faces.loops)) for snapshot in read_frames(path)]
    [(0, 323)]
    """
    source = source_of(path, contacts, **options)
    found, in_cell = frames_of(source), _in_cells(source, cells)
    for place, moment in enumerate(found):
        own = in_cell(place if len(found) > 1 else None)
        yield build_snapshot(moment.read(own), own)


def _in_cells(source: Source, cells: str | Path | None) -> Callable[[int | None], Source]:
    """Function that gives the source with its cell at a frame, as given or of a table."""
    cell_of = cell_reader(cells, source.cell)
    return lambda frame: replace(source, cell=as_cell(cell_of(source.path, frame)))


def count_frames(path: str | Path, contacts: str | Path | None = None, **options: Any) -> int:
    """Number of snapshots in a file.

    Parameters
    ----------
    path, contacts, **options
        See `read_snapshot`.

    Returns
    -------
    int
        1 for tables, which hold one each. The snapshots are not read: a damaged one counts.

    Raises
    ------
    InputError
        For a missing or empty file, and for one with no snapshot that has contacts.
    """
    return len(frames_of(source_of(path, contacts, **options)))


def frame_steps(path: Path, how: Mapping[str, Any]) -> list[float | None]:
    """Step, iteration or time of each snapshot in a file, None where only reading it would tell."""
    given = {name: how.get(name) for name in ("contacts", "format", "columns")}
    return [one.step for one in frames_of(source_of(path, **given))]


def frames_of(source: Source) -> Frames:
    """Snapshots of a file, by the reader of its format."""
    path = source.path
    if source.format != "auto":
        check_choice("--format", source.format, ("auto", *FORMATS))
        return FORMATS[source.format].frames(source)
    require_file(path)
    head = head_of(path)
    refuse_lossy(path, head)
    for reader in FORMATS.values():
        if reader.recognises(path, head):
            return reader.frames(source)
    received = f"a file of unknown format beginning with {head[:40]!r}"
    remedy = "Name its format by --format, or export plain tables."
    raise InputError(str(path), received, f"one of the formats {', '.join(FORMATS)}", remedy)
