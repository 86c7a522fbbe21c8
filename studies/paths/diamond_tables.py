"""Tables of the diamond study beside its path: polar diagrams, Fig. 4, added contacts, the loop."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import pandas as pd
from scipy.integrate import solve_ivp

from loops import GrainGraph, LinearFrictional, Regime
from loops.arrays import Flags, Floats
from patterns.diamond import DiamondParameters, critical_strain
from patterns.diamond.geometry import work_compress_then_shear, work_shear_then_compress
from stability import (
    PolarDiagram,
    directional_work,
    symmetric_spectrum,
)
from studies.paths.diamond import FollowedDiamond, diamond_states, touching_strains
from studies.paths.followed import operator_diagram

# Compression of Fig. 4 if the confinement is zero, and its largest turn of the branch.
COMPRESSION, LAST_ANGLE = 0.2, np.pi / 4
ROUTES = {
    "shear_then_compress": ("shear", "compress"),
    "compress_then_shear": ("compress", "shear"),
}
# Columns of the comparison of paths with and without added contacts.
ADDED_COLUMNS = [
    "stage", "regime", "E1", "E2", "s1", "s2", "lambda_1", "lambda_2", "det_K", "det_Ks",
    "chord_1", "chord_2",
]  # fmt: skip
# Strains of a curve between two meetings of opposite grains.
CURVE_STRAINS = 401


def diamond_tables(
    found: FollowedDiamond, ignored: FollowedDiamond | None
) -> dict[str, pd.DataFrame]:
    """Every table by its name; `ignored` is the path without added contacts, if they are added."""
    tables = {
        "path": found.table,
        "polar": polar_table(found),
        "path_dependence": path_dependence_table(found.loop),
    }
    if "A" in found.marks:
        loop = snapshot_tables(found, found.marks["A"])
        tables |= {f"{name}_A": table for name, table in loop.items()}
    if ignored is not None:
        both = {"ignored": ignored.table[ADDED_COLUMNS], "added": found.table[ADDED_COLUMNS]}
        joined = pd.concat(both, names=["opposite"])
        tables["added_contact"] = joined.reset_index("opposite").reset_index(drop=True)
    return tables


def snapshot_tables(found: FollowedDiamond, row: int) -> dict[str, pd.DataFrame]:
    """The loop at a row as the two tables of a plain snapshot, `grains` and `contacts`."""
    path = found.path
    closed = np.flatnonzero(path.regime[row] != Regime.OPEN)
    x, (i, j) = path.x[row], path.contacts[closed].T
    branch = x[j] - x[i]
    normal = branch / np.linalg.norm(branch, axis=1, keepdims=True)
    tangent = np.stack([-normal[:, 1], normal[:, 0]], axis=1)
    shear = path.shear_force[row, closed][:, None] * tangent
    grains = {"id": np.arange(len(x)), "x": x[:, 0], "y": x[:, 1], "radius": 0.5}
    contacts = {
        "id1": i,
        "id2": j,
        "branch_x": branch[:, 0],
        "branch_y": branch[:, 1],
        "fn": path.normal_force[row, closed],
        "fsx": shear[:, 0],
        "fsy": shear[:, 1],
        "kn": 1.0,
        "ks": found.loop.kappa,
        "mu": found.loop.mu,
    }
    return {"grains": pd.DataFrame(grains), "contacts": pd.DataFrame(contacts)}


# ---- polar diagrams


def polar_table(found: FollowedDiamond) -> pd.DataFrame:
    """Normalised second-order work in every direction at the named states (45).

    `alphaE_deg`, `tan(alphaE) = E1'/E2'`; `w2`; `x, y`, the points of the polar diagram,
    `(2 + w2) (cos alphaE, sin alphaE)`; `regime` that the direction activates.
    """
    none = {"state": np.array([], dtype=str), "alphaE_deg": np.zeros(0), "w2": np.zeros(0)}
    none |= {"x": np.zeros(0), "y": np.zeros(0), "regime": np.array([], dtype=str)}
    tables = []
    for name in found.marks:
        diagram, slides = state_diagram(found, name)
        columns: dict[str, Any] = {"state": name, "alphaE_deg": np.degrees(diagram.angle)}
        columns |= {"w2": diagram.work, "x": diagram.points[:, 0], "y": diagram.points[:, 1]}
        columns["regime"] = np.where(slides, "sliding", "elastic")
        tables.append(pd.DataFrame(columns))
    return pd.concat(tables, ignore_index=True) if tables else pd.DataFrame(none)


def state_diagram(found: FollowedDiamond, name: str) -> tuple[PolarDiagram, Flags]:
    """Polar diagram at a named state, and whether the contacts slide along each direction.

    At B the direction decides on the regime, elastic or sliding.
    """
    path, row, loop = found.path, found.marks[name], found.loop
    closed = path.regime[row] != Regime.OPEN
    graph = found.options.graph()
    here = GrainGraph(
        x=path.x[row],
        x0=graph.x,
        radii=graph.radii,
        contacts=path.contacts[closed],
        normal_force=path.normal_force[row, closed],
        shear_force=path.shear_force[row, closed],
    )
    direction = operator_diagram(found.K[row]).direction
    law = LinearFrictional(1.0, loop.kappa, loop.mu)
    by_branch = directional_work(here, law, direction, volume=path.volume)
    diagram = operator_diagram(found.K[row], by_branch.normalised[:, 0])
    return diagram, by_branch.regime[:, 0] == Regime.SLIDING


# ---- Fig. 4


def path_dependence_table(loop: DiamondParameters, angles: int = 46) -> pd.DataFrame:
    """Fig. 4: work along both routes over the turn of the branch, (9), (10) and integrated.

    `kn = l0 = 1`, `kt = kappa`; the compression is the confinement, where there is one.
    """
    D = loop.confinement or COMPRESSION
    alpha = np.linspace(0.0, LAST_ANGLE, angles)
    columns = {
        "alpha_deg": np.degrees(alpha),
        "compression": D,
        "shear_then_compress": work_shear_then_compress(1.0, alpha, D, 1.0, loop.kappa),
        "compress_then_shear": work_compress_then_shear(1.0, alpha, D, 1.0, loop.kappa),
    }
    for route, legs in ROUTES.items():
        # Integrate the rate law (8a), (8b) for all angles at once: length, N, T and work.
        y = np.stack([np.ones_like(alpha), *np.zeros((3, alpha.size))])
        for leg in legs:
            stretching, turning = (0.0, alpha) if leg == "shear" else (-D, 0.0)

            def slope(_: float, flat: Floats, a: float = stretching, b: Any = turning) -> Floats:
                length, N, T, _work = flat.reshape(4, -1)
                still = np.zeros_like(N)
                arc = length * b
                return np.concatenate([still + a, still - a, loop.kappa * arc, T * arc - N * a])

            found = solve_ivp(slope, (0.0, 1.0), y.ravel(), "DOP853", rtol=1e-12, atol=1e-14)
            y = found.y[:, -1].reshape(4, -1)
        columns[f"{route}_integrated"] = y[-1]
    return pd.DataFrame(columns)


# ---- contacts added between opposite grains


def added_summary(loop: DiamondParameters) -> dict[str, Any]:
    """Strains between which the diamond is stable under isotropic strain, without and with."""
    return {
        "touching_strains": list(touching_strains(loop)),
        "definite_ignored": definite_intervals(loop, added=False),
        "definite_added": definite_intervals(loop, added=True),
    }


def added_critical_strain(loop: DiamondParameters, added: tuple[bool, bool]) -> float:
    """Isotropic strain at which `det K` vanishes with contacts on axis 1, on axis 2.

    From (40) with `1/tan(alpha0)` added to K11 and `tan(alpha0)` to K22. With both it is
    `(1 + kappa)/(2 + kappa)` whatever the angle: that of the triangle.
    """
    cos2, sin2 = np.cos(loop.alpha0) ** 2, np.sin(loop.alpha0) ** 2
    reserve = {
        (False, False): 0.0,
        (True, False): sin2 / (1.0 + cos2),
        (False, True): cos2 / (1.0 + sin2),
        (True, True): 1.0,
    }[added]
    return float(critical_strain(loop.kappa + reserve))


def definite_intervals(loop: DiamondParameters, *, added: bool) -> list[tuple[float, float]]:
    """Isotropic strains over which Ks is positive definite, in rising order."""
    found: list[tuple[float, float]] = []
    for start, end, contacts in _between_meetings(loop, 1.0, added):
        end = min(end, added_critical_strain(loop, contacts))
        if end > start:
            joined = found and found[-1][1] == start
            found[-1:] = [(found[-1][0], end)] if joined else [*found[-1:], (start, end)]
    return found


def isotropic_eigenvalues(loop: DiamondParameters, *, added: bool) -> tuple[Floats, Floats]:
    """Strains (n,) and eigenvalues of Ks (n, 2) under isotropic strain, past the last stable one.

    NaN separates the parts of the path where a contact is added.
    """
    last = 1.05 * definite_intervals(loop, added=True)[-1][1]
    strains, eigenvalues = [], []
    for start, end, contacts in _between_meetings(loop, last, added):
        E = np.linspace(start, end, CURVE_STRAINS)
        K = diamond_states(loop, E, E, added=contacts).K
        strains += [E, np.full(1, np.nan)]
        eigenvalues += [symmetric_spectrum(K), np.full((1, 2), np.nan)]
    return np.concatenate(strains), np.concatenate(eigenvalues)


def _between_meetings(
    loop: DiamondParameters, last: float, added: bool
) -> list[tuple[float, float, tuple[bool, bool]]]:
    """Start and end of each part of the isotropic path, and the contacts added on axis 1 and 2."""
    on1, on2 = touching_strains(loop)
    meetings = sorted({E for E in (on1, on2) if 0.0 < E < last}) if added else []
    return [
        (start, end, (added and on1 <= start, added and on2 <= start))
        for start, end in pairwise([0.0, *meetings, last])
    ]
