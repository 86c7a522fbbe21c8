"""The paper's diamond followed through its programme: isotropic strain to A, drained to B, beyond.

The strains and shear forces are those of the path; operators follow by the paper's closed forms.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from loops import Regime
from loops.arrays import Floats
from patterns.diamond import DiamondParameters
from patterns.diamond.geometry import opposite_contact_strain
from stability import Path
from studies.paths.followed import Followed, follow_options
from studies.paths.options import DiamondOptions
from studies.paths.states import DiamondStates, Operators, operators, states_at

NAMED = {"det_K_zero": "I", "programme_change": "A", "yield": "B"}
DETERMINANTS = ("det_Ks_zero", "det_K_zero")
# What the study lists; the others of a path follow from these.
KINDS = (
    "opposite_contact", *DETERMINANTS, "programme_change", "yield", "unloading", "opening",
    "control_limit",
)  # fmt: skip
# Grains that touch in the reference, but for the rounding of the angle.
ROUNDING = 4.0 * np.finfo(np.float64).eps
# Share of mu N that |T| may lack where contacts are said to have reached it.
REACHED = 1e-9
PAIRS = ([0, 2], [1, 3])


@dataclass(frozen=True, eq=False)
class FollowedDiamond(Followed):
    """A diamond's path; `marks` are I (det K = 0 in the confinement), A and B, where reached.

    `listed` are the events as (kind, row), every row the state as the path arrives there.
    """

    options: DiamondOptions
    loop: DiamondParameters
    states: DiamondStates
    operators: Operators
    listed: tuple[tuple[str, int], ...]

    @cached_property
    def added_forces(self) -> Floats:
        """(R, 2) forces of contacts added on axis 1 and on axis 2, over `kn l0`."""
        return _on_axes(self.path, self.path.normal_force)

    @cached_property
    def energies(self) -> dict[str, Floats]:
        """`work` from outside, `stored` in the contacts and `dissipated`, over `kn L10 L20`."""
        path = self.path
        stored = path.normal_energy + path.tangential_energy
        given = {"work": path.work[:, 0], "stored": stored, "dissipated": path.work[:, 3]}
        return {name: values / path.volume for name, values in given.items()}


def follow_diamond(options: DiamondOptions) -> FollowedDiamond:
    """Follow a diamond through the whole programme.

    >>> found = follow_diamond(DiamondOptions(table=1))
    >>> {name: round(float(found.E1[row]), 6) for name, row in found.marks.items()}
    {'I': 0.166667, 'A': 0.3, 'B': 0.409734}
    """
    path = follow_options(options)
    loop, names = options.parameters, [name for name, _ in options.stages()]
    outward = 1.0 if options.law().keeps_strength else -1.0
    states = _states(loop, path, np.array(names)[path.stage], outward)
    listed = _listed(loop, path, states, len(names))
    marks: dict[str, int] = {}
    for kind, row in listed:
        name = NAMED.get(kind)
        if name and name not in marks and (name != "I" or names[path.stage[row]] == "isotropic"):
            marks[name] = row
    tangents = operators(loop, states)
    determinants = tangents.K, tangents.det_K, tangents.det_Ks
    return FollowedDiamond(options, path, marks, *determinants, loop, states, tangents, listed)


def beyond_yield(found: FollowedDiamond) -> DiamondStates | None:
    """State B with the contacts sliding, as the path goes on; None where it has no B."""
    if "B" not in found.marks:
        return None
    row, states = found.marks["B"], found.states
    goes_on = row + 1 < len(found.path) and states.slip[row + 1] != 0.0
    outward = 1.0 if found.options.law().keeps_strength else -1.0
    slip = states.slip[row + 1] if goes_on else outward * np.sign(states.T[row])
    at = (states.E1[row], states.E2[row], states.T[row])
    return states_at(found.loop, *at, stage=states.stage[row], slip=slip, added=states.added[row])


def touching_strains(loop: DiamondParameters) -> tuple[float, float]:
    """Strains E1 and E2 at which the opposite grains on axis 1, and on axis 2, meet.

    `1 - l0/L10` and `1 - l0/L20`; negative where the grains overlap from the start.
    """
    on1, on2 = (1.0 - 0.5 / length for length in (np.cos(loop.alpha0), np.sin(loop.alpha0)))
    first = float(opposite_contact_strain(loop.alpha0))
    # At 45 degrees both pairs meet at once, whatever the rounding of sine and cosine.
    on1, on2 = (first if abs(E - first) <= ROUNDING else float(E) for E in (on1, on2))
    return tuple(0.0 if abs(E) <= ROUNDING else E for E in (on1, on2))  # type: ignore[return-value]


def _states(loop: DiamondParameters, path: Path, stage: Any, outward: float) -> DiamondStates:
    """Rows of a path; `outward` is what its law makes of the sign of T in `slip`."""
    T, slides = path.shear_force[:, 0], path.regime[:, 0] == Regime.SLIDING
    states = states_at(loop, path.H[:, 0], path.H[:, 3], T, stage=stage)
    return DiamondStates(
        **{
            **vars(states),
            "slip": np.where(slides, outward * np.where(T < 0.0, -1.0, 1.0), 0.0),
            "added": _on_axes(path, path.regime != Regime.OPEN).astype(bool),
            "N": path.normal_force[:, 0],
            "s1": path.P[:, 0],
            "s2": path.P[:, 3],
        }
    )


def _on_axes(path: Path, values: Any) -> Floats:
    """(R, 2) values of the contacts added on axis 1 and on axis 2, zero where there is none."""
    columns = np.zeros((len(path), 2))
    for axis, pair in enumerate(PAIRS):
        here = np.flatnonzero((np.sort(path.contacts, axis=1) == pair).all(axis=1))
        columns[:, axis] = values[:, here].sum(axis=1)
    return columns


def _listed(
    loop: DiamondParameters, path: Path, states: DiamondStates, stages: int
) -> tuple[tuple[str, int], ...]:
    """Events of the study: what a path says twice is said once, and A always has its own."""
    listed: list[tuple[str, int]] = []
    apart = np.array(touching_strains(loop)) >= 0.0
    for event in path.events:
        row = event.index
        if event.kind == "opposite_contact" and not apart[event.contacts[0]]:
            continue
        jumps = event.kind in DETERMINANTS and event.detail.startswith("jump")
        if event.kind not in KINDS or jumps or (event.kind, row) in listed:
            continue
        if event.kind == "control_limit" and event.contacts and _at_yield(loop, states, row):
            listed.append(("yield", row))
        listed.append((event.kind, row))
    if min(loop.kappa, loop.mu) == 0.0 and stages > 1:
        listed = _unstable_from_the_start(loop, listed)
    if stages == 1:
        listed += [("programme_change", 0), ("opening", 0)]
    return tuple(listed)


def _unstable_from_the_start(
    loop: DiamondParameters, listed: list[tuple[str, int]]
) -> list[tuple[str, int]]:
    """`det K = -N/l` without shear stiffness or friction; without friction contacts yield at A."""
    listed = [*((kind, 0) for kind in DETERMINANTS), *listed]
    at = [kind for kind, _ in listed].index("programme_change")
    if loop.mu == 0.0:
        listed.insert(at + 1, ("yield", listed[at][1]))
    return listed


def _at_yield(loop: DiamondParameters, states: DiamondStates, row: int) -> bool:
    return bool(abs(states.T[row]) >= loop.mu * states.N[row] * (1.0 - REACHED))
