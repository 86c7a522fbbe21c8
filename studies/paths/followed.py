"""A loop followed along its programme: rows, operators in (11, 22), events."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from loops import Regime
from loops.arrays import Flags, Floats, Integers
from stability import Path, follow
from studies.paths.options import DiamondOptions, PolygonOptions

SUBSPACES = ("diagonal", "symmetric", "full")
# A tenth of what a path keeps by default: strains and energies to 2e-15, for 5 % more steps.
TOLERANCES = {"rtol": 1e-13, "atol": 1e-15}
# A path of so many steps is given up, and said to be lost.
MOST_STEPS = 2000


@dataclass(frozen=True, eq=False)
class Followed:
    """A path with what its study asks of every row; E1, E2 are H11, H22, s1, s2 are P11, P22.

    `marks` names rows; `K (R, 2, 2)` is the tangent in (11, 22), NaN where it is not known.
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
    def stage_names(self) -> NDArray[np.str_]:
        """Name of every stage."""
        return np.array([name for name, _ in self.options.stages()])

    @property
    def stage(self) -> NDArray[np.str_]:
        """(R,) name of each row's stage."""
        return self.stage_names[self.path.stage]

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
        return np.flatnonzero(self.path.stage == len(self.stage_names) - 1)

    @cached_property
    def direction(self) -> Floats:
        """(R, 2) the path's own direction `(E1', E2')`, of unit length; NaN where it stands."""
        rate = self.path.H_rate[:, [0, 3]]
        size = np.linalg.norm(rate, axis=-1, keepdims=True)
        return rate / np.where(size > 0.0, size, np.nan)

    @cached_property
    def jumps(self) -> Integers:
        """Rows before which the regimes change: the operator jumps there."""
        regime = self.path.regime
        return np.flatnonzero((regime[1:] != regime[:-1]).any(axis=1)) + 1

    def broken(self, values: Floats) -> Floats:
        """A column, or several side by side, with NaN at jumps: no line joins them."""
        return np.insert(np.asarray(values, dtype=float), self.jumps, np.nan, axis=0)

    def smooth(self) -> list[slice]:
        """Rows between the jumps."""
        bounds = [0, *self.jumps.tolist(), len(self.path)]
        return [slice(a, b) for a, b in pairwise(bounds)]


def follow_options(
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
