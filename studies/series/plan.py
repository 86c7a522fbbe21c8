"""What a series consists of: its snapshots in order, and what each was made from."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from loops import InputError
from patterns import count_frames
from studies.output import readable
from studies.series.cells import cells_by_number, number_of
from studies.series.fingerprint import fingerprints
from studies.snapshot import SnapshotInput

Cell = tuple[float, float, float, float]


@dataclass(frozen=True)
class SeriesInput:
    """What to read.

    Attributes
    ----------
    paths : tuple of Path
        Files of the snapshots in the order of the series; a file of several frames gives one
        snapshot each.
    format : str
        Format of the files, or `auto`.
    columns : dict of str to str, optional
        Plain name to the column that holds it.
    cell : tuple of 4 floats, optional
        Periodic cell HXX, HXY, HYX, HYY of every snapshot.
    cells : Path, optional
        CSV table of cells, columns `snap`, `h_xx`, `h_xy`, `h_yx`, `h_yy`.
    kn, kt, mu : float, optional
        Contact parameters that the files lack.
    drop_crossings : bool
        Whether to leave out contacts whose branches cross others, instead of refusing.
    shear_increment : str, optional
        What shear turns by, where not what the source tells.
    """

    paths: tuple[Path, ...]
    format: str = "auto"
    columns: dict[str, str] | None = None
    cell: Cell | None = None
    cells: Path | None = None
    kn: float | None = None
    kt: float | None = None
    mu: float | None = None
    drop_crossings: bool = False
    shear_increment: str | None = None


@dataclass(frozen=True)
class PlannedSnapshot:
    """One snapshot of a series.

    Attributes
    ----------
    number : int
        Its place in the series, from 0.
    source : SnapshotInput
        What to read, paths absolute.
    fingerprint : str
        From `fingerprints`.
    """

    number: int
    source: SnapshotInput
    fingerprint: str

    @property
    def name(self) -> str:
        """File and frame, for messages and tables."""
        frame = self.source.frame
        return readable(self.source.path.name) + (f", frame {frame}" if frame is not None else "")


def plan_series(series: SeriesInput) -> tuple[PlannedSnapshot, ...]:
    """Snapshots of a series in order.

    Parameters
    ----------
    series : SeriesInput
        What to read.

    Returns
    -------
    tuple of PlannedSnapshot
        One a file, or one a frame of a file that holds several.

    Raises
    ------
    InputError
        If a file is missing, stands there twice or has no cell in the table of cells.
    """
    _require_distinct(series.paths)
    if series.cell is not None and series.cells is not None:
        raise InputError("--cell, --cells", "both", "one of them", "Leave one out.")
    cells = None if series.cells is None else cells_by_number(series.cells)
    sources = [source for path in series.paths for source in _frames(series, path)]
    if cells is not None:
        sources = [
            replace(source, cell=_cell_of(source, cells, series.cells)) for source in sources
        ]
    return tuple(
        PlannedSnapshot(number, source, fingerprint)
        for number, (source, fingerprint) in enumerate(
            zip(sources, fingerprints(sources), strict=True)
        )
    )


def _require_distinct(paths: tuple[Path, ...]) -> None:
    if not paths:
        raise InputError("PATHS", "none", "the files of the snapshots", "Name them in order.")
    seen: dict[Path, Path] = {}
    for path in paths:
        if not path.is_file():
            what = "a folder" if path.is_dir() else "no such file"
            raise InputError(str(path), what, "a snapshot's file", "Name files: FOLDER/grains_*.")
        if path.resolve() in seen:
            raise InputError(
                "PATHS", f"{path} twice", "each snapshot once", "Leave the repeated one out."
            )
        seen[path.resolve()] = path


def _frames(series: SeriesInput, path: Path) -> list[SnapshotInput]:
    """One snapshot a frame; a file that can't be read stands as one, for its task to say why."""
    one = SnapshotInput(
        path.resolve(),
        cell=series.cell,
        kn=series.kn,
        kt=series.kt,
        mu=series.mu,
        shear_increment=series.shear_increment,
        format=series.format,
        columns=series.columns,
        drop_crossings=series.drop_crossings,
    )
    try:
        count = count_frames(path, format=series.format, columns=series.columns)
    except InputError:
        return [one]
    return [one] if count == 1 else [replace(one, frame=frame) for frame in range(count)]


def _cell_of(source: SnapshotInput, cells: dict[int, Cell], table: Path | None) -> Cell:
    number = number_of(source)
    if number not in cells:
        raise InputError(
            f"--cells {table}",
            f"no row with snap = {number}, for {source.path.name}",
            "one row a snapshot",
            "Add the row; snap is the last number in the name of the file, or the frame.",
        )
    return cells[number]
