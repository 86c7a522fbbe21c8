"""Yade's straight strain paths of the diamond, as recorded."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from loops import InputError
from loops.laws.linear_frictional import ShearIncrement
from patterns.diamond.strain_lines import (
    Floats,
    LineStates,
    StrainLine,
    half_diagonals,
    line_states,
    strain_line,
    yield_position,
)

KAPPA, UNIT = 0.2, 1e5 * 0.02  # kt/kn; kn l0 in newton
ISOTROPIC_STEPS = 3000
# Above any friction angle: Yade's way to say that nothing slides.
NO_SLIDING = 1e6


@dataclass(frozen=True, eq=False)
class Probe:
    """One straight strain path of Yade; forces over `kn l0`, radians.

    Attributes
    ----------
    alpha0, mu, confinement, angle : float
        Reference angle, friction (inf where nothing slides), isotropic strain `E0`, direction in
        the (E1, E2) plane.
    increment : {'branch', 'radii'}
        Yade's shear increment: `avoidGranularRatcheting` off and on.
    steps : ndarray (n,) of int
        Steps from the first record on.
    E1, E2, F1, F2, N, T : ndarray (n,)
        Records: strains, external forces, contact forces.
    """

    alpha0: float
    mu: float
    confinement: float
    angle: float
    increment: ShearIncrement
    steps: NDArray[np.int64]
    E1: Floats
    E2: Floats
    F1: Floats
    F2: Floats
    N: Floats
    T: Floats

    @property
    def line(self) -> StrainLine:
        """The line from the first record on."""
        return strain_line(self.alpha0, self.E1[0], self.E2[0], self.angle)

    @property
    def u(self) -> Floats:
        """Lengths along the line at the records."""
        return half_diagonals(self.alpha0, self.E1, self.E2) @ self.line.direction

    @property
    def sliding(self) -> NDArray[np.bool_]:
        """Whether the contacts slide, at every record; by the closed form."""
        return self.u > yield_position(self.line, KAPPA, self.mu, self.increment)

    @property
    def slides(self) -> bool:
        """Whether the contacts yield on the way."""
        return bool(np.any(self.sliding))


def read_probes(folder: Path) -> list[Probe]:
    """Yade's probes, without their isotropic stage.

    Parameters
    ----------
    folder : Path
        Holds `probes.csv.gz` and `probes_large.csv.gz`, in N and m, one row a record.

    Returns
    -------
    list of Probe

    Raises
    ------
    InputError
        If a table is missing.

    Examples
    --------
    >>> from patterns import sample_path
    >>> probes = read_probes(sample_path("yade_diamond"))
    >>> len(probes), sum(probe.slides for probe in probes)
    (13, 6)
    """
    probes = []
    for name in ("probes.csv.gz", "probes_large.csv.gz"):
        rows = read_table(folder / name)
        keys = ["a0_deg", "mu", "agr", "E0", "probe_deg"]
        probes += [_probe(own) for _, own in rows.groupby(keys)]
    return probes


def read_table(path: Path) -> pd.DataFrame:
    """One of Yade's tables.

    Parameters
    ----------
    path : Path
        CSV, compressed or not.

    Returns
    -------
    DataFrame

    Raises
    ------
    InputError
        If there is no such file.
    """
    if not path.is_file():
        raise InputError(str(path), "no such file", "Yade's table", "Name its folder by --data.")
    return pd.read_csv(path)


def _probe(rows: pd.DataFrame) -> Probe:
    # One probe of a series is recorded from the virgin loop on, and confined by one step more.
    first = rows.step[rows.step <= ISOTROPIC_STEPS + 1].max()
    rows = rows[rows.step >= first].sort_values("step")
    key = rows.iloc[0]
    return Probe(
        alpha0=float(np.radians(key.a0_deg)),
        mu=float(key.mu) if key.mu < NO_SLIDING else float("inf"),
        confinement=float(key.E0),
        angle=float(np.radians(key.probe_deg)),
        increment="radii" if key.agr else "branch",
        steps=(rows.step - first).to_numpy(),
        E1=rows.E1.to_numpy(),
        E2=rows.E2.to_numpy(),
        F1=rows.Fx_right.to_numpy() / UNIT,
        F2=rows.Fy_top.to_numpy() / UNIT,
        N=rows.Fn_RT.fillna(0.0).to_numpy() / UNIT,
        T=rows.Fs_RT.fillna(0.0).to_numpy() / UNIT,
    )


def exact_states(probe: Probe) -> LineStates:
    """Exact states at the strains that Yade recorded.

    Parameters
    ----------
    probe : Probe
        From `read_probes`.

    Returns
    -------
    LineStates
        Arrays (n,).
    """
    return line_states(probe.line, probe.u, KAPPA, probe.mu, probe.increment)
