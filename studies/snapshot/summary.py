"""Summary of a snapshot, and means, shares and spread of its loops by order."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from loops import (
    ForceChains,
    GrainGraph,
    Regime,
    euler_check,
    love_weber_stress,
    outline_area,
)
from loops.arrays import Flags, Floats, Integers, quantiles
from loops.fabric import (
    TensorMean,
    axial_mean,
    direction_tensors,
    edge_tensors,
    mean_tensor,
    principal,
)
from patterns import Snapshot
from stability import RTOL
from studies.output import Columns, Summary, definitions, values_of
from studies.snapshot.regions import Property, places_table
from studies.snapshot.sample import stress
from studies.snapshot.table import (
    CLOSURES,
    EIGENVALUES,
    FREE,
    GROUPS,
    LAST_ORDER,
    PLACE,
    Groups,
    group_rows,
    share,
    share_of,
)

if TYPE_CHECKING:
    from studies.snapshot.in_packing import InPacking

# Judges of a loop, the one to believe first: the loop in its packing if that was asked for, both
# closures with blocked spins, the traction closure with free spins.
JUDGE_TITLES: dict[str, str] = {
    PLACE: "in its packing",
    **{closure: f"{closure}, spins blocked" for closure in CLOSURES},
    FREE: "traction, spins free",
}
TENSOR = ("stress_11", "stress_12", "stress_21", "stress_22")
PLACES = ("beside", "elsewhere")
# Width of the bins of contact directions (degrees), which divides 180.
FINE_BIN = 10.0
QUARTILES = {"q25": 0.25, "median": 0.5, "q75": 0.75}


def judges(table: Mapping[str, Any]) -> list[str]:
    """Judges that have columns in a table of loops."""
    return [judge for judge in JUDGE_TITLES if f"{judge}_lambda_min" in table]


def main_judge(table: Mapping[str, Any]) -> str:
    """Judge of the one verdict that a figure shows: the packing at rest, else a closure."""
    at_rest = PLACE in judges(table) and np.isfinite(verdicts(table, PLACE)).any()
    return PLACE if at_rest else "traction"


def verdicts(table: Mapping[str, Any], judge: str) -> Floats:
    """Smallest eigenvalues whose sign is a verdict: in the packing those of the state at rest."""
    return np.asarray(table[f"{judge}_lambda_min{'_held' if judge == PLACE else ''}"])


def unstable_loops(table: Columns, judge: str) -> Flags:
    """Loops with an eigenvalue of Ks below zero, beyond the tolerance."""
    return verdicts(table, judge) < -RTOL


def verdict_shares(smallest: Floats) -> tuple[float, float]:
    """Share of unstable loops among those with a verdict, and share of all without one."""
    known = np.isfinite(smallest)
    if not known.any():
        return float("nan"), 1.0 if len(smallest) else float("nan")
    return float(np.mean(smallest[known] < -RTOL)), float(np.mean(~known))


def snapshot_summary(
    snapshot: Snapshot,
    table: Columns,
    in_packing: InPacking | None = None,
    chains: ForceChains | None = None,
) -> Summary:
    """Summary of a snapshot and the table of its loops.

    `in_packing` is what `add_in_packing` returns, if loops were judged in place.
    """
    area, groups = outline_area(snapshot.graph, snapshot.faces), group_rows(table["order"])
    # numpy releases the interpreter on arrays as long as these: the threads share the work.
    with ThreadPoolExecutor(3) as pool:
        parts = [pool.submit(_fabric, snapshot, table, groups)]
        if snapshot.mechanical:
            parts += [pool.submit(_mechanics, snapshot, table, groups, area)]
            parts += [pool.submit(_stability, table, groups, in_packing)]
        summary = _network(snapshot) | _orders(table, groups)
        for part in parts:
            summary |= part.result()
    keys = ["snapshot", *(["snapshot_forces"] if snapshot.mechanical else [])]
    if in_packing is not None:
        summary |= packing_summary(table, groups, in_packing)
        keys.append("snapshot_in_packing")
    if chains is not None:
        summary["force_chains"] = chains_summary(chains, table)
    return {
        **summary,
        "area": area,
        "area_sum": float(table["area"].sum()),
        "notes": list(snapshot.notes),
        "definitions": definitions(*keys),
    }


def _network(snapshot: Snapshot) -> dict[str, Any]:
    """Counts of grains and contacts, Euler's formula, coordination."""
    graph, faces = snapshot.graph, snapshot.faces
    euler = euler_check(graph, faces)
    # Every contact of the pruned network is two half-edges of its faces.
    inner = np.bincount(faces.grains, minlength=graph.grain_count)
    z = 2 * euler.edges / euler.vertices if euler.vertices else 0.0
    dangling = graph.grain_count - euler.vertices
    return {
        "grains": graph.grain_count,
        "contacts": graph.contact_count,
        "wall_contacts": snapshot.wall_contacts,
        "rattlers": snapshot.rattlers if snapshot.wall_contacts else dangling,
        "dangling_grains": dangling,
        **values_of(euler, "components", "vertices", "edges", "faces"),
        "euler_ok": euler.ok,
        "coordination": z,
        "coordination_all": 2 * graph.contact_count / graph.grain_count,
        "contacts_per_grain": spread(inner[inner > 0]),
        "mean_order_from_coordination": 2 * z / (z - 2) if z > 2 else None,
    }


def _orders(table: Columns, groups: Groups) -> dict[str, Any]:
    """Loops by order, in number and in area."""
    order, area = table["order"], table["area"]
    number, by_area = np.bincount(order), np.bincount(order, area)
    orders = np.flatnonzero(number)
    names = list(map(str, orders.tolist()))
    grouped = {}
    for name in GROUPS:
        own = area[groups[name]]
        grouped[name] = {
            "loops": len(own),
            "area": float(own.sum()),
            "share": len(own) / len(area) if len(area) else None,
            "area_share": float(own.sum()) / float(area.sum()) if len(area) else None,
        }
    return {
        "loops": len(order),
        "orders": dict(zip(names, number[orders].tolist(), strict=True)),
        "orders_area": dict(zip(names, by_area[orders].tolist(), strict=True)),
        "orders_grouped": grouped,
        "mean_order": float(order.mean()) if len(order) else None,
        "mean_order_by_area": float(np.average(order, weights=area)) if len(order) else None,
        "order_spread": spread(order),
    }


def _fabric(snapshot: Snapshot, table: Columns, groups: Groups) -> dict[str, Any]:
    """Orientation of contacts and loops, size and elongation of the loops."""
    area, branches = table["area"], snapshot.graph.branches
    directions = direction_tensors(branches)
    contacts = tensor_block(mean_tensor(directions))
    by_length = mean_tensor(directions, np.hypot(branches[:, 0], branches[:, 1]))
    del directions
    shapes = edge_tensors(branches, snapshot.faces)
    return {
        "contact_fabric": contacts | {"fourier_amplitude": 2 * contacts["anisotropy"]},
        "contact_fabric_by_length": tensor_block(by_length),
        "loop_shape": {
            name: tensor_block(mean_tensor(shapes[rows], area[rows]))
            for name, rows in groups.items()
        },
        "long_axis": axes_block(table["orientation"]),
        "elongation_by_order": spread_by_group(groups, table["elongation"]),
        "loop_area_by_order": spread_by_group(groups, area),
    }


def _mechanics(
    snapshot: Snapshot, table: Columns, groups: Groups, outline: float
) -> dict[str, Any]:
    """Stress and sliding of a snapshot with forces."""
    _, regime = snapshot.mechanics()
    sliding, area = regime == Regime.SLIDING, table["area"]
    sums = [float(np.dot(table[name], area)) for name in TENSOR]
    tensors = np.stack([table[name] for name in TENSOR], axis=1).reshape(-1, 2, 2)
    means = {name: mean_tensor(tensors[rows], area[rows]) for name, rows in groups.items()}
    stress_by_order: dict[str, Any] = {
        name: spread_by_group(groups, table[name], area) for name in ("pressure", "deviator")
    }
    stress_by_order["tensor"] = {
        name: {"mean": found.mean, "std": found.std, "count": found.number}
        for name, found in means.items()
    }
    whole = outline > 0
    return {
        "stress": love_weber_stress(snapshot.graph, outline) if whole else None,
        "stress_loops": np.reshape(sums, (2, 2)) / outline if whole else None,
        "mean_kn": snapshot.mean_kn,
        "normal_force": spread(snapshot.graph.normal_force),
        "sliding_fraction": float(np.mean(sliding)),
        "sliding_contacts": share(sliding),
        "sliding_by_order": spread_by_group(groups, table["sliding_contacts"] / table["order"]),
        "stress_by_order": stress_by_order,
        **wall_summary(snapshot),
    }


def _stability(table: Columns, groups: Groups, in_packing: InPacking | None) -> dict[str, Any]:
    """Verdicts on the loops by judge and order, and directions of instability by closure."""
    orders = np.flatnonzero(np.bincount(table["order"]))
    found = defaultdict[str, dict[str, Any]](dict)
    for judge in judges(table):
        order, smallest = table["order"], verdicts(table, judge)
        if judge == PLACE and in_packing is not None:
            order, smallest = in_packing.order, in_packing.smallest
        undetermined = np.isnan(smallest)
        # Loops that are judged stable, unstable, or neither, by order.
        verdict = 3 * order + (smallest < -RTOL) + np.multiply(undetermined, 2, dtype=np.int8)
        most = max(LAST_ORDER, orders.max(initial=0), order.max(initial=0))
        counts = np.bincount(verdict, minlength=3 * most + 3).reshape(-1, 3)
        parts = {name: counts[k] for k, name in enumerate(GROUPS, 3)}
        parts |= {GROUPS[-1]: counts[LAST_ORDER:].sum(axis=0), "all": counts.sum(axis=0)}
        found["untrusted_loops"][judge] = int(parts["all"][2])
        for kind, column, among in (("unstable", 1, 2), ("undetermined", 2, 3)):
            some, every = counts[orders, column], counts[orders, :among].sum(axis=1)
            found[f"{kind}_loops"][judge] = by_order(orders, some, every)
            found[f"{kind}_by_order"][judge] = {
                name: share_of(int(part[column]), int(part[:among].sum()))
                for name, part in parts.items()
            }
        found["eigenvalues"][judge] = {
            name: spread_by_group(groups, table[f"{judge}_{name}"]) for name in EIGENVALUES
        }
        if f"{judge}_soft_angle" in table:
            unstable = unstable_loops(table, judge)
            found["soft_loops"][judge] = {
                "long_axis": axes_block(table["orientation"][unstable]),
                "soft_angle": axes_block(table[f"{judge}_soft_angle"][unstable]),
            }
        if judge not in CLOSURES:
            continue
        directions = table[f"{judge}_unstable_fraction"]
        opening = table[f"{judge}_cone_opening"]
        # Stable loops have no cone: they don't count as an opening of zero.
        cones = np.where(opening > 0, opening, np.nan)
        total = np.bincount(order, np.where(undetermined, 0.0, directions))[orders]
        means = by_order(orders, total, counts[orders, :2].sum(axis=1))
        found["mean_unstable_directions"][judge] = means
        found["unstable_directions"][judge] = spread_by_group(groups, directions)
        found["cone_opening"][judge] = spread_by_group(groups, cones)
    return found


def order_columns(summary: Summary, table: Columns) -> Columns:
    """One row per order: number and area of its loops, and the share of unstable ones."""
    orders = [int(n) for n in summary["orders"]]
    columns = {
        "order": np.array(orders, dtype=np.int64),
        "loops": np.array(list(summary["orders"].values()), dtype=np.int64),
        "area": np.array(list(summary["orders_area"].values()), dtype=float),
    }
    for kind in ("unstable_loops", "undetermined_loops"):
        for judge, shares in summary.get(kind, {}).items():
            columns[f"{judge}_{kind}"] = np.array(list(shares.values()), dtype=float)
    return columns | (share_by_order(table, orders) if "in_packing" in summary else {})


def chains_summary(chains: ForceChains, table: Columns) -> Summary:
    """Number and length of the force chains, and the share of loops beside one."""
    lengths = np.bincount(chains.chain[chains.chain >= 0])
    return {
        "chains": len(lengths),
        "grains": int(lengths.sum()),
        "share_of_grains": float(lengths.sum() / max(len(chains.chain), 1)),
        "mean_length": float(lengths.mean()) if len(lengths) else None,
        "longest": int(lengths.max(initial=0)),
        "loops_beside": share(table["chain_contacts"] > 0),
    }


def chains_table(table: Columns) -> dict[str, list[Any]]:
    """Loops beside force chains and elsewhere, by groups of orders: eigenvalues, unstable share."""
    place = np.where(table["chain_contacts"] > 0, 0, 1)
    return places_table(table["order"], place, PLACES, verdict_properties(table))


def verdict_properties(table: Columns) -> dict[str, Property]:
    """Return the verdict of each judge on the loops."""
    by_judge = {judge: verdicts(table, judge) for judge in judges(table)}
    return {
        f"{judge}_unstable": Property(
            smallest < -RTOL, np.isfinite(smallest), table[f"{judge}_lambda_min"]
        )
        for judge, smallest in by_judge.items()
    }


def wall_summary(snapshot: Snapshot) -> Summary:
    """Stress carried by the contacts with walls, and its share of the whole stress."""
    walls = snapshot.walls
    if walls is None or not snapshot.mechanical or not (len(walls.grain) and snapshot.area[0] > 0):
        return {}
    whole = stress(snapshot)
    return {
        "stress_walls": whole.walls,
        "stress_total": whole.tensor,
        "boundary_area": whole.volume,
        "boundary_area_is": whole.volume_is,
        "boundary_share": whole.wall_share,
        "wall_force": spread(np.hypot(*walls.force.T)),
    }


def surroundings_share(table: Columns) -> Floats:
    """Share of the surroundings in the trace of `A_in`: 1 - tr A_loop / tr A_in."""
    inside, alone = (
        sum(table[f"{judge}_{name}"] for name in EIGENVALUES) for judge in (PLACE, FREE)
    )
    return np.asarray(1.0 - alone / inside)


def share_by_order(table: Columns, orders: list[int]) -> dict[str, NDArray[Any]]:
    """Quartiles of `surroundings_share` over the loops of each order."""
    share = surroundings_share(table)
    found = [spread(share[table["order"] == n]) for n in orders]
    names = ("q25", "median", "q75")
    return {f"surroundings_{key}": np.array([one[key] for one in found]) for key in names}


def packing_summary(table: Columns, groups: Groups, in_packing: InPacking) -> Summary:
    """Keys of the summary for loops in place."""
    smallest, error = table["surroundings_lambda_min"], table[f"{PLACE}_error"]
    known = {name: smallest[rows][~np.isnan(smallest[rows])] for name, rows in groups.items()}
    return {
        "in_packing": in_packing.method,
        "packing_at_rest": in_packing.at_rest,
        "packing_error": spread(np.where(np.isfinite(error), error, np.nan)),
        "surroundings_positive": {name: share(own > 0) for name, own in known.items()},
        "surroundings_share": spread_by_group(groups, surroundings_share(table)),
    }


def spread(values: ArrayLike, weights: ArrayLike | None = None) -> dict[str, Any]:
    """Mean, standard deviation, quartiles and number of the values that are not nan."""
    value = np.asarray(values, dtype=float)
    weight = None if weights is None else np.asarray(weights, dtype=float)
    known = ~np.isnan(value)
    if not known.all():
        value, weight = value[known], None if weight is None else weight[known]
    if len(value) == 0 or (weight is not None and not weight.sum() > 0):
        return dict.fromkeys(("mean", "std", *QUARTILES), float("nan")) | {"count": len(value)}
    mean = np.average(value, weights=weight)
    return {
        "mean": float(mean),
        "std": float(np.sqrt(np.average((value - mean) ** 2, weights=weight))),
        **dict(zip(QUARTILES, quantiles(value, [*QUARTILES.values()]), strict=True)),
        "count": len(value),
    }


def spread_by_group(
    groups: Groups, values: Floats, weights: Floats | None = None
) -> dict[str, dict[str, Any]]:
    """`spread` of a column for each group of orders."""
    return {
        name: spread(values[rows], None if weights is None else weights[rows])
        for name, rows in groups.items()
    }


def by_order(
    orders: Integers, total: Floats | Integers, number: Floats | Integers
) -> dict[str, float]:
    """Means of orders: a total over a number for each."""
    with np.errstate(invalid="ignore"):
        means = total / number
    return dict(zip(map(str, orders.tolist()), means.tolist(), strict=True))


def tensor_block(average: TensorMean) -> dict[str, Any]:
    """A mean tensor with its spread, anisotropy and direction."""
    anisotropy, direction = principal(average.mean)
    return {
        "tensor": average.mean,
        "std": average.std,
        "anisotropy": float(anisotropy),
        "direction": float(np.degrees(direction)),
        "count": average.number,
    }


def axes_block(angles: Floats) -> dict[str, Any]:
    """Mean of axes, by doubled angles, with its spread."""
    known = np.isfinite(angles)
    direction, resultant = axial_mean(np.radians(angles[known]))
    with np.errstate(divide="ignore"):
        std = np.degrees(0.5 * np.sqrt(np.maximum(-2 * np.log(resultant), 0.0)))
    return {
        "direction": float(np.degrees(direction)),
        "resultant": resultant,
        "std": float(std),
        "count": int(np.count_nonzero(known)),
    }


def fabric_table(graph: GrainGraph, summary: Summary) -> Columns:
    """Density of the contact directions, one row per bin, and its series of second order."""
    d = graph.branches
    columns = axes_density(np.degrees(np.arctan2(d[:, 1], d[:, 0])), FINE_BIN)
    del columns["error"]
    second = second_order(np.radians(columns["angle"]), summary["contact_fabric"])
    return columns | {"second_order": second}


def axes_density(
    axes: Floats, width: float, weights: Floats | None = None
) -> dict[str, NDArray[Any]]:
    """Density of axes (degrees) over half a turn in bins of this width, with independent errors.

    Bins are centred on the axes of coordinates, where regular packings have their peaks.
    """
    bins = round(180 / width)
    at = np.floor(np.mod(axes + 0.5 * width, 180.0) / width).astype(np.int64) % bins
    count = np.bincount(at, minlength=bins)
    # Without weights as counts are: exact.
    share, square = (
        (count, count)
        if weights is None
        else (np.bincount(at, weights**power, minlength=bins) for power in (1, 2))
    )
    whole = 2 * np.radians(width) * max(share.sum(), np.finfo(float).tiny)
    angle = width * np.arange(bins)
    density, error = share / whole, np.sqrt(square) / whole
    return {"angle": angle, "count": count, "density": density, "error": error}


def second_order(theta: Floats, fabric: dict[str, Any]) -> Floats:
    """Density of contact directions by the Fourier series of second order."""
    swing = np.cos(2 * (theta - np.radians(fabric["direction"])))
    return (1 + fabric["fourier_amplitude"] * swing) / (2 * np.pi)
