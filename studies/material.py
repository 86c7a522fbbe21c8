"""The study behind `grainloops material`: averaged loops as a material, under a programme."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from loops import GrainGraph, InputError, LinearFrictional
from loops.errors import check_choice, number, whole_number
from patterns import hexagon, regular_polygon
from stability import COMPONENTS, Stage, plane_cone, programmes, restrict
from stability.material import LoopMaterial, MaterialPath, march, oriented
from stability.material.loop_material import MaterialClosure
from stability.material.loop_set import LoopSet, loops_of
from studies.evolve import major_axis, start_of
from studies.output import Summary, components, readable, values_of
from studies.paths.options import ProgrammeName, programme_of
from studies.questions import Averaging
from studies.reading import read_planar, reading
from studies.study import files_of, study
from studies.style import (
    BLUE,
    GREY,
    VERMILION,
    edge_ticks,
    figure_key,
    key_columns,
    new_panels,
    styled,
)

# Steps of the isotropic compression before the programme.
CONFINING_STEPS = 20
SETS = ("mean", "single")


@dataclass(frozen=True, kw_only=True)
class MaterialOptions(Averaging):
    """Options of `grainloops material`; `order` is 6 with `alpha0_deg`, the H-model's hexagon.

    If left out `single` is that of `_single`, `axis` that of the loops' major stress.
    """

    order: int = 6
    orientations: int = 36
    kappa: float = 0.5
    phi_deg: float = 30.0
    confine: float = 1e-2
    orders: tuple[int, ...] | None = None  # type: ignore[assignment]
    closure: MaterialClosure = "traction"
    end: float = 0.1

    def __post_init__(self) -> None:
        whole_number("--order", self.order, 3)
        whole_number("--orientations", self.orientations, 1)
        whole_number("--steps", self.steps, 1)
        number("--kappa", self.kappa, 0.0)
        number("--confine", self.confine, 0.0, open_low=True)
        number("--end", self.end, 0.0, open_low=True)
        if self.end >= 1.0 and self.programme != "isotropic-stress":
            expected = "a strain below 1: there the loops have no length left"
            raise InputError("--end", f"{self.end:g}", expected, "Give 0.1, for example.")
        check_choice("--closure", self.closure, get_args(MaterialClosure))
        check_choice("--programme", self.programme, get_args(ProgrammeName))
        programme_of(self, self.axis or 1)
        number("--phi", self.phi_deg, 0.0, 90.0)
        if self.alpha0_deg is not None and self.order != 6:
            received = f"given with --order {self.order}"
            raise InputError("--alpha0", received, "a hexagon", "Leave one of them out.")

    @property
    def loop(self) -> GrainGraph:
        """Return the loop that is turned."""
        if self.alpha0_deg is not None:
            return hexagon(np.radians(self.alpha0_deg))
        return regular_polygon(self.order)

    @property
    def law(self) -> LinearFrictional:
        """Return its law, `kn = 1`."""
        phi = np.radians(self.phi_deg)
        return LinearFrictional(1.0, self.kappa, np.tan(phi) if self.phi_deg < 90.0 else np.inf)


def run_material(
    options: MaterialOptions,
    out: Path,
    *,
    snapshot: Path | None = None,
    **how: Any,
) -> Summary:
    """March averaged loops and a single one, write the tables, figures and a report.

    Without a `snapshot` copies of one loop, else the loops of a packing; `how` are options of
    `read_planar` and files of `study`. Tables `path` (both sets) and `loops` (what was averaged).
    """
    files = files_of(how)
    source = {} if snapshot is None else {"path": snapshot, **reading(**how)}
    with study("material", out, source | asdict(options), **files) as results:
        law: Any = options.law
        loops, notes = oriented(options.loop, options.orientations), list[str]()
        if snapshot is not None:
            read, law = read_planar(snapshot, **how), None
            loops = loops_of(read, orders=options.orders, count=options.count)
            half = "each contact counts half in each of its two loops"
            notes = [*read.notes, f"loops as they stand in the packing; {half}"]
        stress = np.average(loops.stress, axis=0, weights=loops.weights)
        axis = options.axis or major_axis(stress)
        options, along = replace(options, axis=axis), 3 * (axis - 1)
        number = _single(loops, options.single)
        paths = {
            name: _march(options, LoopMaterial(each, None, law, options.closure), snapshot)
            for name, each in zip(SETS, (loops, loops.part(slice(number, number + 1))), strict=True)
        }
        rows = {name: march_table(path, along) for name, path in paths.items()}
        table = pd.concat(rows, names=["set"]).reset_index("set")
        values = {
            "loops": len(loops.weights),
            "orders": {int(n): int((loops.orders == n).sum()) for n in np.unique(loops.orders)},
            **values_of(options, "closure", "programme", "steps"),
            **{name: end_and_peak(rows[name], path) for name, path in paths.items()},
            **{"loop": number, "notes": notes, "axis": axis, **start_of(stress)},
        }
        name = f"{options.order} grains" if snapshot is None else readable(snapshot.name)
        tables = {"path": table, "loops": averaged_loops(loops)}
        drawn = [("material", lambda: draw_material(table))]
        title = f"Loops of {name} as a material"
        return results.write_results(tables, values, drawn, title)


def _single(loops: LoopSet, number: int | None) -> int:
    """Return the number of the loop that stands for all, by default of median order and stress."""
    count = len(loops.weights)
    if number is not None:
        if not 0 <= number < count:
            expected = f"a number from 0 to {count - 1}"
            raise InputError("--single", str(number), expected, "See loop in loops.parquet.")
        return number
    stress, order = loops.stress, np.sort(loops.orders)[(count - 1) // 2]
    away = stress - np.average(stress, axis=0, weights=loops.weights)
    size = np.linalg.norm(away, axis=(1, 2))
    return int(np.argmin(np.where(loops.orders == order, size, np.inf)))


def _march(options: MaterialOptions, material: LoopMaterial, snapshot: Path | None) -> MaterialPath:
    """Compress to the confining stress, unless the loops have their own, and go on from there."""
    tensor, axis = "P" if options.programme == "isotropic-stress" else "H", options.axis or 1
    stages, start = list[Stage](), 0.0
    if snapshot is None:
        stages = [Stage(programmes.isotropic_stress(), "P11", options.confine)]
        rest = march(material, stages, CONFINING_STEPS)
        if rest.status != "finished":
            return rest
        start = float(getattr(rest, tensor)[-1, 3 * (axis - 1)])
    driven = Stage(programme_of(options, axis), f"{tensor}{axis}{axis}", start + options.end)
    return march(material, [*stages, driven], options.steps)


def march_table(path: MaterialPath, along: int = 0) -> pd.DataFrame:
    """Return the rows of a path: strain, stress, tangent, work, cone and regimes.

    `along` is the place of the driven component, 0 (11) or 3 (22).
    """
    K = restrict(path.A, "diagonal")
    cone = plane_cone(K)
    H, P = path.H.reshape(-1, 2, 2), path.P
    area = np.linalg.det(np.eye(2) - H)
    last = path.stage == path.stage.max()
    begin = int(np.flatnonzero(last)[0])
    values = np.linalg.eigvalsh(0.5 * (K + np.swapaxes(K, 1, 2)))
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.where(P[:, 3 - along] != 0.0, P[:, along] / P[:, 3 - along], np.nan)
    four = list(enumerate(COMPONENTS))
    return pd.DataFrame({
        "stage": np.where(last, "programme", "confinement"),
        "strain": path.H[:, along] - path.H[begin, along],
        **components("H", path.H),
        **components("P", P),
        "stress_ratio": ratio,
        "volume_change": area / area[begin] - 1.0,
        "w2": path.work,
        "lambda_min": values[:, 0],
        "cone_status": cone.status,
        "cone_opening_deg": np.degrees(cone.opening),
        "cone_axis_deg": np.degrees(cone.axis),
        "stuck": path.regimes[:, 0],
        "sliding": path.regimes[:, 1],
        "open": path.regimes[:, 2],
        "failed": path.failed,
        **{f"A{a}_{b}": path.A[:, i, j] for i, a in four for j, b in four},
    })  # fmt: skip


def averaged_loops(loops: LoopSet) -> dict[str, Any]:
    """Return order, area and weight of what was averaged."""
    return {
        "loop": np.arange(len(loops.weights)),
        "order": loops.orders,
        "area": loops.areas,
        "weight": loops.weights / loops.weights.sum(),
    }


def end_and_peak(rows: pd.DataFrame, path: MaterialPath) -> dict[str, Any]:
    """Return the end of a path, its peak and where its work and its cone first turn."""
    run = rows[rows["stage"] == "programme"]
    ratio = run["stress_ratio"].to_numpy()
    values: dict[str, Any] = {
        "status": path.status,
        "end_strain": float(run["strain"].iloc[-1]),
        "end_stress_ratio": float(ratio[-1]) if np.isfinite(ratio[-1]) else None,
        "peak_stress_ratio": None,
        "peak_strain": None,
        "failed": float(run["failed"].max()),
    }
    if np.isfinite(ratio).any():
        peak = int(np.nanargmax(ratio))
        # A ratio that is largest at the end has no peak.
        if peak < len(run) - 1:
            values["peak_stress_ratio"] = float(ratio[peak])
            values["peak_strain"] = float(run["strain"].iloc[peak])
    negative, open_cone = run["w2"] < 0.0, run["cone_status"] == "open"
    for key, rows_there in (("w2_negative_strain", negative), ("cone_strain", open_cone)):
        values[key] = float(run["strain"][rows_there].iloc[0]) if rows_there.any() else None
    return values


@styled()
def draw_material(table: pd.DataFrame) -> Figure:
    """Draw stress ratio, volume change, second-order work and cone over the strain."""
    table = table[table["stage"] == "programme"]
    cones = table[table["cone_status"] == "open"]
    figure, panels = new_panels(2, 2, 4.6) if len(cones) else new_panels(1, 3, 2.6)
    axes = panels.ravel()
    quantities = (
        ("stress_ratio", 1.0, "stress ratio\nalong / across (–)"),
        ("volume_change", 100.0, "change of the area (%)"),
        ("w2", 1.0, "second-order work $w_2$ (–)"),
    )
    for name, label, colour, line in (
        ("mean", "mean of the loops", BLUE, "-"),
        ("single", "one loop alone", VERMILION, "--"),
    ):
        run = table[table["set"] == name]
        strain, ratio = 100.0 * run["strain"], run["stress_ratio"].to_numpy()
        look: Any = {"color": colour, "label": label}
        for ax, (column, scale, _) in zip(axes, quantities, strict=False):
            ax.plot(strain, scale * run[column], line, **look)
            edge_ticks(ax, strain[run["failed"].diff() > 0], "a loop is lost", colour)
        if np.isfinite(ratio).any() and np.nanargmax(ratio) < len(run) - 1:
            peak = int(np.nanargmax(ratio))
            axes[0].plot(strain.iloc[peak], ratio[peak], "o", color=colour, markerfacecolor="white")
        # Cone of unstable directions of (11, 22), a band around its axis.
        cone = cones[cones["set"] == name]
        middle, half = cone["cone_axis_deg"], 0.5 * cone["cone_opening_deg"]
        for turn in (-180.0, 0.0, 180.0) if len(cone) else ():
            band = middle - half + turn, middle + half + turn
            axes[3].fill_between(
                100.0 * cone["strain"], *band, color=colour, alpha=0.3, linewidth=0
            )
    for ax, (_, _, label) in zip(axes, quantities, strict=False):
        ax.set_ylabel(label)
    for ax in axes[1:3]:
        ax.axhline(0.0, color=GREY, linewidth=0.6)
    for ax in axes:
        ax.set(xlabel="axial strain (%)", xlim=(0.0, axes[0].get_xlim()[1]))
    if len(cones):
        axes[3].set(ylabel="strain directions, $W_2 < 0$ (degrees)", ylim=(0.0, 180.0))
        axes[3].set_yticks(range(0, 181, 45))
    figure_key(figure, axes[0], ncols=key_columns(figure, 3))
    return figure
