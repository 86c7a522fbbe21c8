"""Tables of the front door: as pandas data frames, their units in `attrs`."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
import pyarrow as pa

from loops import InputError, force_chains
from loops.arrays import Floats, Integers, one_blas_thread
from loops.errors import check_type, counted, library
from loops.scene import Subject
from loops.shown import Shown
from patterns import Snapshot, planar
from patterns.snapshots.findings import SEVERITIES, Finding, crossings, worst_severity
from patterns.snapshots.snapshot import snapshot_of
from stability import Event, Path
from stability.packing.path import columns
from studies.output import SIGNS, Summary, components, described, folder_for_files, provenance
from studies.snapshot import chains_on_loops
from studies.snapshot import table as tables
from studies.snapshot.in_packing import BANDS, add_in_packing
from studies.snapshot.input_error import add_input_errors

if TYPE_CHECKING:
    from geopandas import GeoDataFrame

# Terms of the work of a packing's path, see `Path.work`.
WORKS = ("work", "slip_work", "shear_work", "released")


@one_blas_thread()
def loop_table(
    snapshot: Snapshot | Subject,
    *,
    in_packing: bool = False,
    hold: bool = False,
    input_error: str | float | tuple[float, float] | None = None,
) -> pd.DataFrame:
    """One row per loop: shape, stress and stability, as `grainloops snapshot` writes them.

    Parameters
    ----------
    snapshot : Snapshot or Scene
        Without forces only the geometry is there.
    in_packing : bool
        Whether to judge each loop inside its packing too, in the columns `packing_*` and
        `surroundings_lambda_min` of `grainloops snapshot --in-packing`.
    hold : bool
        Whether the packing is brought to rest first, for the columns of the state at rest
        (`packing_lambda_min_held`, `packing_confirmed`, `packing_direction_*`), which are empty
        where a state moves.
    input_error : 'digits', float or pair of floats, optional
        Errors of the file: half a unit in the last place of its numbers, or the error of a
        contact's force as a share of it, and that of kn and kt. Adds `affine_input_error`,
        `traction_input_error` and `traction_free_input_error`, bounds on the change of
        `*_lambda_min` by them.

    Returns
    -------
    pandas.DataFrame
        In the order of `snapshot.faces.loops`. `loop`, `order`; centroid `x, y`, `area`,
        `perimeter`, `elongation`, `orientation` (degrees); `sliding_contacts`; `stress_11` to
        `stress_22`, `pressure`, `deviator` (force per length, compression positive); for the
        `affine` and the `traction` closure, spins blocked, `*_lambda_min`, `*_lambda_mid`,
        `*_lambda_max` (eigenvalues of Ks over the mean kn, subspace `symmetric`),
        `*_unstable_fraction`, `*_cone_opening`, `*_soft_angle` (degrees); the eigenvalues
        `traction_free_lambda_*` with free spins; `grains`, an array of ids; `chain_contacts`, links
        of force chains. Version and units stand in `attrs`, those of each column in
        `attrs["column_units"]`.

    Raises
    ------
    InputError
        If branches cross: faces mean nothing then; `planar` leaves contacts out. In the packing if
        there are no forces or it floats.

    Examples
    --------
    >>> from patterns import read_snapshot, sample_path
    >>> table = loop_table(read_snapshot(sample_path()))
    >>> len(table), int((table["traction_lambda_min"] < 0).sum())
    (309, 3)
    """
    if hold and not in_packing:
        expected = "in_packing=True: loops are judged in their packing alone"
        raise InputError("hold", "True without in_packing", expected, "Give in_packing=True.")
    snapshot = planar(snapshot)
    columns = tables.loop_columns(snapshot)
    if in_packing:
        add_in_packing(snapshot, columns, "auto", hold=hold, yield_band=BANDS[1])
    if input_error is not None:
        add_input_errors(snapshot, columns, input_error)
    if snapshot.mechanical:
        columns["chain_contacts"] = chains_on_loops(snapshot)[1]
    frame: pd.DataFrame = pa.table(columns).to_pandas()
    units = {name: said[0] for name in frame if (said := described("snapshot/loops", name))}
    frame.attrs = provenance("loop_table", {}) | {"column_units": units}
    return frame


def write_vtk(
    folder: str | os.PathLike[str], snapshot: Snapshot, table: pd.DataFrame | None = None
) -> None:
    """Write `loops.vtp` and `contacts.vtp` for ParaView, as `grainloops snapshot --vtk` does.

    Parameters
    ----------
    folder : path
        Made if it is not there; files of these names in it are replaced.
    snapshot : Snapshot
        Loops across the border of a periodic cell are unrolled.
    table : pandas.DataFrame, optional
        One row a loop, in their order, whose numbers are written; `loop_table` if left out.

    Raises
    ------
    InputError
        Without vtk; if branches cross; for a table of other loops; for a file in place of the
        folder.

    Examples
    --------
    >>> from patterns import read_snapshot, sample_path
    >>> write_vtk("paraview", read_snapshot(sample_path()))  # doctest: +SKIP
    """
    snapshot = planar(snapshot)
    own = _of_loops(snapshot, table)
    columns = {str(name): own[name].to_numpy() for name in own}
    with folder_for_files(folder) as partial:
        tables.write_paraview(partial, snapshot, columns, provenance("loop_table", {}))


def _of_loops(snapshot: Snapshot, table: pd.DataFrame | None) -> pd.DataFrame:
    """The table of the loops of a snapshot; `InputError` for one of others."""
    own, loops = loop_table(snapshot) if table is None else table, len(snapshot.faces.loops)
    check_type("table", own, pd.DataFrame, "Give gl.loop_table(snapshot), or leave it out.")
    if len(own) != loops:
        received, expected = counted(len(own), "row"), f"one a loop, {loops}"
        raise InputError("table", received, expected, "Give the table of this snapshot.")
    return own


def to_geodataframe(snapshot: Snapshot, table: pd.DataFrame | None = None) -> GeoDataFrame:
    """Loops as polygons with the columns of their table, for GeoPandas and GIS files.

    Parameters
    ----------
    snapshot : Snapshot
        Loops across the border of a periodic cell are unrolled.
    table : pandas.DataFrame, optional
        One row a loop, in their order; `loop_table` if left out.

    Returns
    -------
    geopandas.GeoDataFrame
        `geometry` are the polygons of the grains' centres, counter-clockwise, without a coordinate
        reference system; `grains` are the ids as text, since files of polygons hold no lists.

    Raises
    ------
    InputError
        Without GeoPandas; if branches cross; for a table of other loops.

    Examples
    --------
    >>> from patterns import read_snapshot, sample_path
    >>> polygons = to_geodataframe(read_snapshot(sample_path()))  # doctest: +SKIP
    >>> polygons.to_file("loops.gpkg")  # doctest: +SKIP
    """
    with library("to_geodataframe", "geopandas", "grainloops[geo]"):
        import geopandas
        import shapely
    snapshot = planar(snapshot)
    offsets, corners, _ = tables.loop_polygons(snapshot.graph, snapshot.faces)
    own = _of_loops(snapshot, table)
    rings = shapely.linearrings(corners, indices=np.repeat(np.arange(len(own)), np.diff(offsets)))
    frame = geopandas.GeoDataFrame(own, geometry=shapely.polygons(rings))
    frame.attrs = dict(own.attrs)
    if "grains" in frame:
        frame["grains"] = [" ".join(map(str, ids)) for ids in frame["grains"]]
    return frame


def chain_table(snapshot: Snapshot | Subject) -> pd.DataFrame:
    """One row per grain: its major principal stress and the force chain that it is in.

    Parameters
    ----------
    snapshot : Snapshot
        With forces; those of walls are not in the stress.

    Returns
    -------
    pandas.DataFrame
        `grain` (id), `x, y`, `major` (force per length, compression positive), `axis` (degrees to
        axis 1), `chain` (-1 for none) and `length`, the number of grains of that chain.

    Raises
    ------
    InputError
        For a snapshot without forces.

    Examples
    --------
    >>> from patterns import read_snapshot, sample_path
    >>> table = chain_table(read_snapshot(sample_path()))
    >>> int(table["length"].min()), len(table)
    (0, 600)
    """
    snapshot = snapshot_of(snapshot)
    if not snapshot.has_forces:
        snapshot.mechanics()
    graph, chains = snapshot.graph, force_chains(snapshot.graph)
    lengths = np.append(np.bincount(chains.chain[chains.chain >= 0]), 0)
    columns = {
        "grain": snapshot.ids,
        "x": graph.x[:, 0],
        "y": graph.x[:, 1],
        "major": chains.major,
        "axis": np.degrees(chains.axis),
        "chain": chains.chain,
        "length": lengths[chains.chain],
    }
    frame = pd.DataFrame(columns)
    frame.attrs = provenance("chain_table", {})
    return frame


def path_table(path: Path) -> pd.DataFrame:
    """One row per state of a path.

    Parameters
    ----------
    path : Path
        From `follow`, `replay`, `evolve(...).way` or `sustain(...).paths`.

    Returns
    -------
    pandas.DataFrame
        Of a loop the columns of `Path.columns`: `parameter`, `stage`; `H11` to `H22`, `P11` to
        `P22` and their rates; `N_c`, `T_c`, `regime_c` of contact c; `A11_11` to `A22_22`;
        `det_K`, `det_Ks`, `eig_K_*`, `eig_Ks_*`; work and energies, in the units of the graph and
        of the law; besides `event`, the kinds of the events in the row. Of a packing those of
        `path.parquet` of `grainloops evolve`; under a growing load those of `paths.parquet` of
        `grainloops sustain`.

    Examples
    --------
    >>> from loops import LinearFrictional, Scene
    >>> from patterns import regular_polygon
    >>> from stability import Stage, follow, programmes
    >>> stage = Stage(programmes.isotropic_strain(), "H11", 0.2)
    >>> scene = Scene(regular_polygon(5), LinearFrictional(kn=1.0, kt=0.2))
    >>> path = follow(scene, stage, closure="affine")
    >>> table = path_table(path)
    >>> round(float(table["H11"].iloc[-1]), 12)
    0.2
    """
    check_type("path", path, Path, "Give what gl.follow returns.")
    if len(path.direction):
        frame = load_table(path)
    elif len(path.states):
        frame = row_table(path)
    else:
        kinds: list[list[str]] = [[] for _ in range(len(path))]
        for event in path.events:
            kinds[event.index].append(event.kind)
        frame = pd.DataFrame(path.columns())
        frame["event"] = [", ".join(dict.fromkeys(row)) for row in kinds]
    frame.attrs = {"signs": SIGNS, "status": path.status, "volume": path.volume}
    return frame


def load_table(path: Path) -> pd.DataFrame:
    """One row per state of a packing under a growing load."""
    table = {"load": path.parameter, "at_rest": path.resting}
    table |= components("H", path.H) | components("P", path.P)
    table |= zip(WORKS, path.work.T, strict=True)
    return pd.DataFrame(table | {"energy": path.energy})


def row_table(way: Path) -> pd.DataFrame:
    """One row per recorded state; a replay has no work, and `--pathologies` add their answers."""

    def so_far(events: Sequence[Event]) -> Integers:
        ends = np.sort([event.parameter for event in events])
        return np.searchsorted(ends, way.parameter, side="right")

    table = {"row": np.arange(len(way.H)), "driven": way.driven(way.parameter, way.stage)}
    table |= components("H", way.H) | components("P", way.P)
    if len(way.work):
        table |= zip(WORKS, way.work.T, strict=True)
        table |= {"energy": way.energy, "imbalance": way.imbalance}
    table["contacts"] = np.array([np.count_nonzero(state.closed) for state in way.states])
    table["events"] = so_far(way.events)
    if way.pathologies:
        table |= columns(way.pathologies) | {"instabilities": so_far(way.of_kind("instability"))}
    return pd.DataFrame(table)


def order_work_table(
    theta_deg: Floats, work: Floats, order: Integers, area: Floats, whole: Floats | None = None
) -> pd.DataFrame:
    """One row per direction and order: share of the loops in the work, in its negative part.

    Of the `whole` (D,) order 0 has what the loops' `work` (D, L) leaves.
    """
    orders, at = np.unique(order, return_inverse=True)
    member = at == np.arange(len(orders))[:, None]
    loops, covers = member.sum(axis=1), np.bincount(at, area) / area.sum()
    total, negative = work @ member.T, np.minimum(work, 0.0) @ member.T
    if whole is not None:
        rest = (whole - total.sum(axis=1))[:, None]
        total, negative = np.hstack([rest, total]), np.hstack([0.0 * rest, negative])
        orders, loops, covers = (np.append(0, values) for values in (orders, loops, covers))
    summed = total.sum(axis=1) if whole is None else whole
    with np.errstate(invalid="ignore", divide="ignore"):
        shares = total / summed[:, None], negative / negative.sum(axis=1, keepdims=True) + 0.0
    columns = {
        "theta_deg": theta_deg[:, None],
        "order": orders,
        "loops": loops,
        "area_share": covers,
        "W2": total,
        "W2_share": shares[0],
        "negative": negative,
        "negative_share": shares[1],
    }
    return pd.DataFrame(
        {name: np.broadcast_to(value, total.shape).ravel() for name, value in columns.items()}
    )


def work_shares(rows: pd.DataFrame) -> Summary:
    """Shares of the loops by order, of the rows of one direction in `order_work_table`."""
    names = ["loops", "area_share", "W2_share", "negative_share"]
    by_order = rows.set_index("order")[names].to_dict("index")
    return {str(order): shares for order, shares in by_order.items()}


def loop_work_table(
    order: Integers, area: Floats, work: Floats, volume: float = 1.0
) -> pd.DataFrame:
    """One row per loop: its work (over `volume`), and that over its own area."""
    columns = {"loop": np.arange(len(order)), "order": order, "area": area, "W2": work}
    return pd.DataFrame(columns | {"additive_w": work * volume / area})


@dataclass(frozen=True, eq=False, repr=False)
class Check(Shown):
    """Findings of `check`: the worst of `SEVERITIES`, and a finding for each check."""

    verdict: str
    findings: tuple[Finding, ...]

    def facts(self) -> dict[str, object]:
        """Facts that the prompt and a notebook show."""
        wrong = [one for one in self.findings if one.severity != "ok"]
        counts: dict[str, object] = {
            str(name): sum(one.severity == name for one in self.findings) for name in SEVERITIES
        }
        said = {one.check: f"{one.severity}: {one.says}" for one in wrong}
        return {"verdict": self.verdict, **counts, **said}

    def rows(self) -> pd.DataFrame:
        """A row a check."""
        return pd.DataFrame([one._asdict() for one in self.findings])


def check(snapshot: Snapshot | Subject) -> Check:
    """Check a snapshot for consistency, as `grainloops check` does: signs, units, balance.

    Parameters
    ----------
    snapshot : Snapshot or Scene
        A file that fails is read with `read_snapshot(path, strict=False)`; of a scene only the
        crossings of its branches are checked.

    Returns
    -------
    Check
        `verdict` is 'ok', 'doubt' or 'error'; `.table()` has a row a check with what to do.

    Examples
    --------
    >>> from patterns import read_snapshot, sample_path
    >>> check(read_snapshot(sample_path())).verdict
    'ok'
    """
    snapshot = snapshot_of(snapshot)
    findings = (*snapshot.findings, crossings(snapshot.graph))
    return Check(worst_severity(findings), findings)
