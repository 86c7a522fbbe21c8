"""Which model a path took: the smallest that its scene needs, or the full one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from loops.symmetry import invariant_fields
from stability.paths.model import PathModel
from stability.paths.symmetry import symmetry_or_identity
from stability.paths.unknowns import Kind
from stability.rate_problem import RateProblem

ModelOption = Literal["auto", "full"]


@dataclass(frozen=True)
class ModelChoice:
    """What was modelled, and what was left out; counts as 'part of whole'.

    Attributes
    ----------
    choice : {'auto', 'full'}
        The smallest model that was found, or all of it as asked.
    symmetry : str
        Point group that the path keeps, 'D2 (order 4)' for example, or 'none'.
    freedoms : str
        Independent displacements of the centres.
    spins : str
        Independent spins, or why there are none.
    unknowns : str
        Size of the linear system of the rates, control included.
    contact_orbits : str
        Contacts that differ.
    branch_search : str
        Combinations of regimes that were solved for. Under a symmetry, of those motions alone that
        keep it: `rates_at` counts all.
    branch_solves : int
        How many these were, those of rate problems without a choice included.
    kernels : str
        'plain': nothing is compiled for one loop.
    kept : str
        Whether the symmetry served to the end of the path.
    """

    choice: ModelOption
    symmetry: str
    freedoms: str
    spins: str
    unknowns: str
    contact_orbits: str
    branch_search: str
    branch_solves: int
    kernels: str
    kept: str


@dataclass
class Searches:
    """Counts of the rate problems of a path."""

    problems: int = 0
    without_choice: int = 0
    tried: int = 0
    combinations: float = 0.0

    def add(self, problem: RateProblem[Any]) -> None:
        """Count one rate problem."""
        self.problems += 1
        if problem.combinations == 1:
            self.without_choice += 1
        else:
            self.tried += problem.tried
            self.combinations += problem.combinations

    def __str__(self) -> str:
        searched = self.problems - self.without_choice
        return (
            f"skipped in {self.without_choice} of {self.problems} rate problems; "
            f"{self.tried} of {self.combinations:.6g} combinations tried in the other {searched}"
        )


def model_choice(
    model: PathModel, choice: ModelOption, searches: Searches, kept: str
) -> ModelChoice:
    """Describe the model of a path.

    Parameters
    ----------
    model : PathModel
        As the path started.
    choice : {'auto', 'full'}
        What was asked for.
    searches : Searches
        Rate problems of the path.
    kept : str
        See `ModelChoice`.

    Returns
    -------
    ModelChoice
    """
    group = symmetry_or_identity(model)
    freedoms = invariant_fields(group.grains, group.maps).shape[-1]
    kind: Kind = "affine"
    if model.closure == "traction":
        kind = "ring" if model.is_plain_ring else "saddle"
    sets = model.unknowns[kind]
    return ModelChoice(
        choice=choice,
        symmetry="none" if group.order == 1 else f"{group.name} (order {group.order})",
        freedoms=f"{freedoms} of {2 * model.grain_count}",
        spins=_spins(model),
        unknowns=f"{sets.rates.count + 1} of {_size(model, kind) + 1}",
        contact_orbits=f"{len(np.unique(group.contact_orbits))} of {model.contact_count}",
        branch_search=str(searches),
        branch_solves=searches.without_choice + searches.tried,
        kernels="plain",
        kept=kept,
    )


def _spins(model: PathModel) -> str:
    if model.spins != "free":
        return "none: blocked" if model.spins == "blocked" else "none: tied to the loop"
    group = symmetry_or_identity(model)
    fields = invariant_fields(group.grains, group.parity[:, None, None])
    return f"{fields.shape[-1]} of {model.grain_count}"


def _size(model: PathModel, kind: Kind) -> int:
    """Unknowns without symmetry."""
    spins = model.grain_count if model.spins == "free" else 0
    places = {"affine": spins, "ring": 2, "saddle": 2 * model.grain_count + spins}
    return 8 + places[kind]
