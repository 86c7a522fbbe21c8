"""What the search for flutter writes."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from itertools import product
from pathlib import Path
from typing import Any, get_args

import numpy as np
from rich.console import Console
from rich.progress import track

from loops import InputError
from studies.flutter.figures import Maps, draw_maps, draw_shares
from studies.flutter.sample import Contacts, Forces, Ranges
from studies.flutter.search import OPERATORS, UNCERTAINTY, flutter_map, search
from studies.output import provenance, result_folder, write_summary, write_table
from studies.style import save_figure

UNITS = "forces over kn times length (kn = 1), eigenvalues over kn"
# Levels of the maps.
FRICTIONS, OVERLAPS = 25, 25
KEYS = ("shape", "forces", "contacts")
DEFINITIONS = {
    "flutter": "a complex pair of K beyond what an error of its entries of 1e-10 |K| explains",
    "share": "of the loops whose operator is known",
    "flutter_stable": "loops with flutter and a positive definite Ks: W2 > 0 in every direction",
    "largest_ratio": "|Im lambda|/|lambda|",
    "least": "smallest |T|/N, N/l and kt/kn among the loops with flutter; |Im| under 1e-5 |K| "
    "counts as none, which hides what small T/l do",
    "assigned": "contact forces drawn one by one",
    "balanced": "contact forces in equilibrium with a uniform symmetric stress",
    "grains": "grain-level tangent, translations with spins blocked: grains of equal mass",
}


@dataclass(frozen=True)
class FlutterSearch:
    """Parameters of the search.

    Attributes
    ----------
    orders : tuple of int
        Orders n.
    loops : int
        Loops in each family: order, shape, forces, contacts.
    map_order, map_loops : int
        Order of the maps, and number of loops in them.
    seed : int
        Seed of everything.
    kappa : (float, float)
        Range of kt/kn.
    """

    orders: tuple[int, ...] = (3, 4, 5, 6, 7, 8)
    loops: int = 4000
    map_order: int = 6
    map_loops: int = 150
    seed: int = 1
    kappa: tuple[float, float] = (0.05, 1.0)


def run_flutter(given: FlutterSearch, out: Path, *, force: bool = False) -> dict[str, Any]:
    """Search, and write `summary.json`, `flutter.parquet` and `.csv`, and the figures.

    Parameters
    ----------
    given : FlutterSearch
        What to search.
    out : Path
        Result folder.
    force : bool
        Whether results may be replaced.

    Returns
    -------
    dict
        The summary.

    Raises
    ------
    InputError
        If an order is below 3, a number of loops below 1, or the folder holds files.
    """
    if min(*given.orders, given.map_order) < 3 or min(given.loops, given.map_loops) < 1:
        raise InputError(
            "search for flutter",
            f"orders {given.orders}, {given.loops} loops",
            "orders of 3 or more and at least one loop",
            "Correct them.",
        )
    ranges = Ranges(kappa=given.kappa)
    with result_folder(out, force=force) as folder:
        made = provenance("flutter study", {**asdict(given), "ranges": asdict(ranges)}, UNITS)
        rows = _searched(given, ranges)
        friction = np.linspace(*ranges.friction, FRICTIONS)
        overlap = np.geomspace(*ranges.overlap, OVERLAPS)
        maps: Maps = {}
        for forces, contacts in product(get_args(Forces), get_args(Contacts)):
            found = flutter_map(
                forces, contacts, friction, overlap, order=given.map_order,
                loops=given.map_loops, seed=given.seed, ranges=ranges,
            )  # fmt: skip
            maps |= {(closure, forces, contacts): each for closure, each in found.items()}
        maps = dict(sorted(maps.items()))
        summary = flutter_summary(rows) | {"provenance": made}
        write_summary(folder, summary)
        write_table(
            folder, "flutter", {key: [row[key] for row in rows] for key in rows[0]}, made, csv=True
        )
        write_table(folder, "maps", _map_columns(friction, overlap, maps), made, csv=False)
        save_figure(draw_maps(friction, overlap, maps), folder, "flutter_maps", made)
        save_figure(draw_shares(rows), folder, "flutter_orders", made)
    return summary


def flutter_summary(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Totals over the families, and the extremes.

    Parameters
    ----------
    rows : list of dict
        From `search`.

    Returns
    -------
    dict
        `loops`, `operators`, `flutter`, `flutter_stable`; `families`: for each operator and family
        the flutter of all orders; `orders_without`: orders in which none was found; `extremes`.
    """
    groups: dict[str, dict[str, Any]] = {name: {} for name in OPERATORS}
    for name, *family in dict.fromkeys((row["operator"], *(row[k] for k in KEYS)) for row in rows):
        own = [r for r in rows if [r["operator"], *(r[k] for k in KEYS)] == [name, *family]]
        hit = [row for row in own if row["flutter"]]
        groups[name][", ".join(family)] = {
            "flutter": sum(row["flutter"] for row in own),
            "known": sum(row["known"] for row in own),
            "flutter_stable": sum(row["flutter_stable"] for row in own),
            "largest_ratio": max(row["largest_ratio"] for row in own),
            "orders_without": [row["order"] for row in own if not row["flutter"]],
            **{key: min((row[key] for row in hit), default=None) for key in LEAST},
        }
    return {
        "families": groups,
        "loops": sum(row["loops"] for row in rows if row["operator"] == "grains"),
        "operators": sum(row["known"] for row in rows),
        "flutter": sum(row["flutter"] for row in rows),
        "flutter_stable": sum(row["flutter_stable"] for row in rows),
        "uncertainty": UNCERTAINTY,
        "definitions": DEFINITIONS,
    }


LEAST = ("least_friction", "least_overlap", "least_kappa")


def _searched(given: FlutterSearch, ranges: Ranges) -> list[dict[str, Any]]:
    """All rows of the table, with a progress bar on a terminal."""
    total = len(given.orders) * 8 * len(OPERATORS)
    console = Console(stderr=True)
    found = search(given.orders, given.loops, given.seed, ranges)
    return list(track(found, "flutter", total, console=console, disable=not console.is_terminal))


def _map_columns(friction: np.ndarray, overlap: np.ndarray, maps: Maps) -> dict[str, Any]:
    """One row for each cell of each map."""
    level_o, level_f = np.meshgrid(overlap, friction, indexing="ij")
    cells = level_o.size
    names = np.array(list(maps), dtype=str).repeat(cells, axis=0)
    return {
        "closure": names[:, 0],
        "forces": names[:, 1],
        "contacts": names[:, 2],
        "friction": np.tile(level_f.ravel(), len(maps)),
        "overlap": np.tile(level_o.ravel(), len(maps)),
        "largest_ratio": np.concatenate([ratio.ravel() for ratio, _ in maps.values()]),
        "share": np.concatenate([share.ravel() for _, share in maps.values()]),
    }
