"""A loop followed along its programme: rows, operators in (11, 22), their spectra and cones."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from loops import Regime
from loops.arrays import Flags, Floats, Integers
from stability import (
    RTOL,
    Path,
    PolarDiagram,
    follow,
    operator_norm,
    plane_cone,
    polar_diagram,
    restrict,
    spectrum,
    symmetric_spectrum,
    unstable_fraction,
)
from studies.paths.options import DiamondOptions, PolygonOptions

SUBSPACES = ("diagonal", "symmetric", "full")
# A tenth of the default tolerances of a path: strains and energies to 2e-15, for 5 % more steps.
TOLERANCES = {"rtol": 1e-13, "atol": 1e-15}
# A path of so many steps is given up with the status `lost`.
MOST_STEPS = 2000
# Directions of a polar diagram, and its radius where the second-order work is zero.
DIRECTIONS, RADIUS = 720, 2.0


@dataclass(frozen=True, eq=False)
class Followed:
    """A path of a loop; E1, E2 are H11, H22, and s1, s2 are P11, P22.

    `marks` are rows by name; `K (R, 2, 2)` is the tangent in (11, 22), NaN where it is not known.
    """

    options: DiamondOptions | PolygonOptions
    path: Path
    marks: dict[str, int]
    K: Floats
    det_K: Floats
    det_Ks: Floats

    @property
    def E1(self) -> Floats:
        """(R,) H11."""
        return self.path.H[:, 0]

    @property
    def E2(self) -> Floats:
        """(R,) H22."""
        return self.path.H[:, 3]

    @property
    def s1(self) -> Floats:
        """(R,) P11."""
        return self.path.P[:, 0]

    @property
    def s2(self) -> Floats:
        """(R,) P22."""
        return self.path.P[:, 3]

    @cached_property
    def stages(self) -> tuple[str, ...]:
        """Names of the stages."""
        return tuple(name for name, _ in self.options.stages())

    @cached_property
    def stage(self) -> NDArray[np.str_]:
        """(R,) name of each row's stage."""
        return np.array(self.stages)[self.path.stage]

    @cached_property
    def slides(self) -> Flags:
        """(R,) whether a contact slides."""
        return np.asarray((self.path.regime == Regime.SLIDING).any(axis=1))

    @cached_property
    def opens(self) -> Flags:
        """(R,) whether a contact of the loop has opened."""
        ring = self.path.regime[:, : len(self.path.x[0])]
        return (ring == Regime.OPEN).any(axis=1) & (np.arange(len(self.path)) > 0)

    @property
    def loading(self) -> Integers:
        """Rows of the programme that follows the confinement."""
        return np.flatnonzero(self.path.stage == len(self.stages) - 1)

    @cached_property
    def direction(self) -> Floats:
        """(R, 2) direction of the path `(E1', E2')`, of unit length; NaN where it stands still."""
        rate = self.path.H_rate[:, [0, 3]]
        size = np.linalg.norm(rate, axis=-1, keepdims=True)
        return rate / np.where(size > 0.0, size, np.nan)

    @cached_property
    def jumps(self) -> Integers:
        """Rows before which the regimes change and the operator jumps."""
        regime = self.path.regime
        return np.flatnonzero((regime[1:] != regime[:-1]).any(axis=1)) + 1

    def broken(self, values: Floats) -> Floats:
        """One column or several with a NaN at each jump, which interrupts a drawn line."""
        return np.insert(np.asarray(values, dtype=float), self.jumps, np.nan, axis=0)

    @cached_property
    def plane(self) -> pd.DataFrame:
        """Spectra and cone in (11, 22) of every row, see `plane_columns`."""
        return plane_columns(self.K, self.det_K, self.det_Ks)

    @cached_property
    def subspaces(self) -> pd.DataFrame:
        """`lambda_min_*` and `unstable_fraction_*` of every subspace at every row."""
        columns: dict[str, Floats] = {}
        for subspace in SUBSPACES:
            # Eigenvalues within the round-off of the norm are zero.
            K = restrict(self.path.A, subspace)
            values = symmetric_spectrum(K)
            values = np.where(np.abs(values) <= RTOL * operator_norm(K)[..., None], 0.0, values)
            columns[f"lambda_min_{subspace}"] = values[:, 0]
            columns[f"unstable_fraction_{subspace}"] = unstable_fraction(values)
        return pd.DataFrame(columns)


def follow_path(
    options: DiamondOptions | PolygonOptions, subspaces: tuple[str, ...] = ("diagonal",)
) -> Path:
    """The path of a study, with the spectral events of every subspace."""
    return follow(
        options.graph(),
        options.law(),
        [stage for _, stage in options.stages()],
        closure=options.closure,
        spins=options.spins,
        subspace=subspaces,
        volume=options.volume,
        contact_on_touch=options.contact_on_touch,
        **TOLERANCES,
        max_steps=MOST_STEPS,
        rows=options.rows,
        model=options.model,
    )


def plane_columns(K: Floats, det_K: Floats, det_Ks: Floats) -> pd.DataFrame:
    """Determinants, eigenvalues of Ks (ascending) and of K, and the instability cone in (11, 22).

    A cone that closes within the tolerance is a single direction, of opening 0.
    """
    values, symmetric, cone = spectrum(K), symmetric_spectrum(K), plane_cone(K)
    columns = {
        "det_K": det_K,
        "det_Ks": det_Ks,
        "lambda_1": symmetric[:, 0],
        "lambda_2": symmetric[:, 1],
        "eigenvalue_1_real": values[:, 0].real,
        "eigenvalue_1_imag": values[:, 0].imag,
        "eigenvalue_2_real": values[:, 1].real,
        "eigenvalue_2_imag": values[:, 1].imag,
        "cone_status": cone.status,
        "cone_opening_deg": np.degrees(np.where(cone.status == "ray", 0.0, cone.opening)),
        "cone_axis_deg": np.degrees(cone.axis),
    }
    return pd.DataFrame(columns)


def operator_diagram(K: Floats, work: Floats | None = None) -> PolarDiagram:
    """Polar diagram of one operator, or of a given second-order work along its directions.

    `w2 = 0` along directions that K annuls within the tolerance: where det K vanishes, round-off
    alone decides the sign of w2 in the kernel of K.
    """
    diagram = polar_diagram(K, r=RADIUS, directions=DIRECTIONS)
    stress = np.einsum("ij,nj->ni", K, diagram.direction)
    annulled = np.linalg.norm(stress, axis=-1) <= RTOL * operator_norm(K)
    work = np.where(annulled, 0.0, diagram.work if work is None else work)
    outward = np.stack([np.cos(diagram.angle), np.sin(diagram.angle)], axis=-1)
    return PolarDiagram(diagram.angle, diagram.direction, work, (RADIUS + work)[:, None] * outward)
