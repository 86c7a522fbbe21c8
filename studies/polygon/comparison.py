"""Loops of several orders under one programme, side by side."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from loops import InputError
from studies.polygon.parameters import SUBSPACES, PolygonParameters
from studies.polygon.path import PolygonPath, described, determinants, follow_polygon
from studies.polygon.peak import axial_peak
from studies.polygon.summary import DEFINITIONS, critical_strains

MOST = 40
# Share of mu N that |T| may lack where a contact is said to have reached it.
REACHED = 1e-9


@dataclass(frozen=True)
class ComparisonParameters:
    """Orders to compare, and all that the loops share.

    Parameters
    ----------
    orders : tuple of int
        Numbers of grains, ascending.
    shared : PolygonParameters
        Its order plays no part.

    Raises
    ------
    InputError
        If there is no order, one is twice, or one is out of range.
    """

    orders: tuple[int, ...]
    shared: PolygonParameters

    def __post_init__(self) -> None:
        if not self.orders or len(set(self.orders)) < len(self.orders) or len(self.orders) > MOST:
            raise InputError(
                "--compare", str(self.orders), f"1 to {MOST} different orders", "Write 3-12."
            )
        for order in self.orders:
            self.of(order)

    def of(self, order: int) -> PolygonParameters:
        """Parameters of one of the loops.

        Parameters
        ----------
        order : int
            Number of grains.

        Returns
        -------
        PolygonParameters
        """
        return replace(self.shared, order=order)

    def described(self) -> dict[str, Any]:
        """Every value in force, under the names of the command line.

        Returns
        -------
        dict
        """
        described = self.shared.described()
        del described["order"]
        return {"compare": list(self.orders), **described}


def orders_of(text: str) -> tuple[int, ...]:
    """Orders written as ranges and numbers, by commas.

    Parameters
    ----------
    text : str
        Such as '3-12' or '3,4,6-8'.

    Returns
    -------
    tuple of int
        Ascending, each once.

    Raises
    ------
    InputError
        If it can't be read.

    Examples
    --------
    >>> orders_of("3-5,8")
    (3, 4, 5, 8)
    """
    orders: set[int] = set()
    try:
        for part in text.split(","):
            first, _, last = part.partition("-")
            low, high = int(first), int(last or first)
            if not 0 <= high - low < 10 * MOST:
                raise ValueError
            orders.update(range(low, high + 1))
    except ValueError:
        raise InputError(
            "--compare", repr(text), "orders such as 3-12 or 3,4,6-8", "Write them so."
        ) from None
    return tuple(sorted(orders))


@dataclass(frozen=True, eq=False)
class Compared:
    """Loops of several orders, followed.

    Attributes
    ----------
    parameters : ComparisonParameters
        What was asked.
    found : tuple of PolygonPath
        In the order of `parameters.orders`.
    loops : tuple of dict
        `order, critical_strain, first_yield, peak, status, message, end` of each.
    """

    parameters: ComparisonParameters
    found: tuple[PolygonPath, ...]
    loops: tuple[dict[str, Any], ...]

    def summary(self) -> dict[str, Any]:
        """Summary without its provenance.

        Returns
        -------
        dict
        """
        early = [str(loop["order"]) for loop in self.loops if loop["status"] != "finished"]
        notes = [f"paths that end before their target: orders {', '.join(early)}"] if early else []
        return {
            "parameters": self.parameters.described(),
            "loops": list(self.loops),
            "notes": notes,
            "definitions": DEFINITIONS
            | {
                "first_yield": "first event at which contacts reach |T| = mu N; of kind "
                "control_limit where the path has no way on with them sliding"
            },
        }


def compare(parameters: ComparisonParameters) -> Compared:
    """Follow a loop of every order.

    Parameters
    ----------
    parameters : ComparisonParameters
        Orders and programme.

    Returns
    -------
    Compared
    """
    found = tuple(follow_polygon(parameters.of(n), ("diagonal",)) for n in parameters.orders)
    return Compared(parameters, found, tuple(_row(each) for each in found))


def compared_tables(compared: Compared) -> dict[str, dict[str, Any]]:
    """Tables of a comparison.

    Parameters
    ----------
    compared : Compared
        From `compare`.

    Returns
    -------
    dict of str to dict
        `compare`, a row an order: `order, critical_strain_*`, `first_yield_*` and `peak_*` (E1,
        E2, s1), `end_E1, status`; NaN where there is none. `paths`: `order, stage, E1, E2, s1, s2,
        det_K, det_Ks, lambda_min` in (11, 22).
    """
    rows = compared.loops
    columns: dict[str, Any] = {"order": [row["order"] for row in rows]}
    for subspace in SUBSPACES:
        columns[f"critical_strain_{subspace}"] = [
            _number(row["critical_strain"][subspace]) for row in rows
        ]
    for name in ("first_yield", "peak"):
        for key in ("E1", "E2", "s1"):
            columns[f"{name}_{key}"] = [_number((row[name] or {}).get(key)) for row in rows]
    columns["end_E1"] = [row["end"]["E1"] for row in rows]
    columns["status"] = [row["status"] for row in rows]
    return {"compare": columns, "paths": _curves(compared)}


def _curves(compared: Compared) -> dict[str, Any]:
    tables = []
    for found in compared.found:
        path = found.path
        det_K, det_Ks = determinants(path)
        tables.append(
            {
                "order": np.full(len(path), found.parameters.order),
                "stage": np.array(found.stage_names)[path.stage],
                "E1": path.H[:, 0],
                "E2": path.H[:, 3],
                "s1": path.P[:, 0],
                "s2": path.P[:, 3],
                "det_K": det_K,
                "det_Ks": det_Ks,
                "lambda_min": path.symmetric_eigenvalues[:, 0],
            }
        )
    return {name: np.concatenate([table[name] for table in tables]) for name in tables[0]}


def _row(found: PolygonPath) -> dict[str, Any]:
    path = found.path
    return {
        "order": found.parameters.order,
        "critical_strain": critical_strains(found.parameters),
        "first_yield": first_yield(found),
        "peak": axial_peak(found),
        "status": path.status,
        "message": path.message,
        "end": {"E1": float(path.H[-1, 0]), "E2": float(path.H[-1, 3]), "s1": float(path.P[-1, 0])},
    }


def first_yield(found: PolygonPath) -> dict[str, Any] | None:
    """First event at which contacts reach `|T| = mu N`.

    Parameters
    ----------
    found : PolygonPath
        From `follow_polygon`.

    Returns
    -------
    dict or None
        As in `found_events`: of kind 'yield', or 'control_limit' where the path has no way on with
        these contacts sliding.
    """
    path, mu = found.path, found.parameters.mu
    for event in path.events:
        contacts = list(event.contacts)
        if event.kind == "control_limit" and contacts:
            N, T = path.normal_force[event.index, contacts], path.shear_force[event.index, contacts]
            reached = bool((np.abs(T) >= mu * N * (1.0 - REACHED)).all())
        else:
            reached = event.kind == "yield"
        if reached:
            return described(path, event, None, found.stage_names)
    return None


def _number(value: float | None) -> float:
    return float("nan") if value is None else float(value)
