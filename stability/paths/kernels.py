"""Rings of a path as kernels take them, and numpy where a loop is no ring of a known law.

Compiled are rings without chords under linear springs, with cohesion or not, and Hertz's law. Under
a law of one's own, with rolling resistance, with chords or as a packing the segment calls numpy
back for its rates and event functions.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache, lru_cache
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from loops.arrays import Floats, Integers, Regimes
from loops.closures import ring as equations
from loops.closures.rings import CLOSURES, SPINS
from loops.compiled import compiled
from loops.laws.frictional import Regime
from loops.laws.of_pairs import KERNELS, PairLaw
from loops.symmetry import identity
from stability.paths import ring_rates, segment
from stability.paths.model import PathModel
from stability.paths.ring_rates import Problem
from stability.programmes import Programme

# Kernels that are compiled into their callers.
INLINED = ("turn_block", "kept_motions", "condense", "weigh_moments", "_norm4")
# Laws as the kernels number them.
LAWS = ("springs", "cohesive", "hertz", "hertz_by_displacement")
# Numbers of the quantities that end a stage.
QUANTITIES = {f"{tensor}{i}{j}": k for k, (tensor, i, j) in enumerate(product("HP", "12", "12"))}
QUANTITIES["parameter"] = 8


class EventFunctions(NamedTuple):
    """Event functions of a segment, see `Problem` and `System`.

    `watch` (M, 2): kinds, and the contact or eigenvalue that each belongs to, four eigenvalues a
    subspace, -1 for none; `numbers`: target, sense and start of the stage, sizes of strains and of
    the parameter per strain; `functions` give the values of a state by numpy, kind by kind.
    """

    watch: Integers
    tolerance: Floats
    bases: Floats
    spaces: Integers
    quantity: int
    numbers: tuple[float, ...]
    functions: Sequence[Callable[[Any], Any]] = ()

    def values(self, here: Any) -> Floats:
        """(M,) dimensionless values in a state."""
        return np.concatenate([function(here) for function in self.functions])


@cache
def answer() -> Any:
    """Return the compiled rates of rings, see `ring_rates.RATES`."""
    from stability.paths import calls

    modules = equations, ring_rates, calls
    return calls.Compiled(compiled(*modules, entry=("answer",), inlined=INLINED).answer)


@cache
def follow() -> Any:
    """Return the compiled integration of a segment."""
    return compiled(segment, entry=("follow",), inlined=()).follow


@lru_cache(maxsize=16)
def ring_of(model: PathModel) -> dict[str, Any] | None:
    """Constant parts of a `Problem` of this model, if the kernels serve it."""
    law: Any = model.law
    n, known = model.grain_count, type(law) in KERNELS
    ring = np.column_stack([np.arange(n), np.roll(np.arange(n), -1)])
    if not known or n < 3 or not np.array_equal(model.contacts, ring):
        return None
    radii = model.radii[model.contacts].T
    pairs = PairLaw.made(law, radii, np.full(n, -1))
    kind, constants = KERNELS[type(law)](pairs)
    traction = model.closure == "traction"
    table = np.zeros((n, ring_rates.WIDTH))
    columns = (
        *model.d0.T, model.length0, model.overlap0, model.touching,
        *(model.m.T if traction else np.zeros((2, n))), *radii, pairs.reach, *constants,
    )  # fmt: skip
    for k, column in enumerate(columns):
        table[:, ring_rates.D0X + k] = column
    table[:, ring_rates.X0 : ring_rates.Y0 + 1] = model.x0
    if traction:
        table[:, ring_rates.BX : ring_rates.BY + 1] = model.b
    small, codes = np.zeros((ring_rates.ROWS, 9)), np.zeros(ring_rates.CODES, dtype=np.int64)
    small[ring_rates.NUMBERS, :3] = model.volume, model.length, model.stiffness
    group = model.group or identity(n, n)
    codes[ring_rates.MIRRORS] = model.mirrors
    codes[ring_rates.LAW] = LAWS.index("cohesive" if law.cohesive else kind)
    codes[ring_rates.BY_RADII] = pairs.by_radii
    codes[ring_rates.CLOSURE], codes[ring_rates.SPINS] = CLOSURES[model.closure], SPINS[model.spins]
    i, j = np.triu_indices(n, 1)
    apart = ~np.isin(i * n + j, model.met) & model.watches_pairs
    return {
        "table": table, "small": small, "codes": codes,
        "images": group.contacts, "maps": group.maps,
        "pairs": np.column_stack([i, j])[apart].astype(np.int64),
    }  # fmt: skip


def ring_under(model: PathModel, regime: Regimes, programme: Programme) -> dict[str, Any] | None:
    """Constant parts of a `Problem` with these regimes, if the kernels serve it."""
    if type(programme) is not Programme:
        return None
    if model.spins == "free" and (regime != Regime.ELASTIC).any():
        # Moments on grains that roll along with each other may be left that nothing balances.
        return None
    return ring_of(model)


def arrays_of(
    ring: dict[str, Any], regime: Any, side: Floats, programme: Programme, events: EventFunctions
) -> tuple[Floats, Integers, Problem]:
    """Return the arrays of a ring with its regimes, programme and events, and the problem there."""
    n, functions = len(ring["table"]), len(events.watch)
    L = max(3 * n + 5, functions + 1, 7) + 1
    header = np.array([L, n, len(ring["maps"]), functions, len(events.spaces), len(ring["pairs"])])
    floats, whole = ring_rates.lengths(header)
    arrays = np.zeros(floats), np.zeros(whole, dtype=np.int64)
    arrays[1][:6] = header
    p = ring_rates.problem_in(*arrays)
    for name in ("table", "small", "codes", "images", "maps", "pairs"):
        getattr(p, name)[:] = ring[name]
    p.watch[:], p.bases[:], p.spaces[:] = events.watch, events.bases, events.spaces
    p.table[:, ring_rates.REGIME], p.table[:, ring_rates.SIDE] = regime, side
    p.small[ring_rates.STRESS : ring_rates.STRESS + 4, :4] = programme.stress
    p.small[ring_rates.STRAIN : ring_rates.STRAIN + 4, :4] = programme.strain
    p.small[ring_rates.RATE, :4] = programme.rate
    p.small[ring_rates.NUMBERS, ring_rates.BULK] = programme.fluid_bulk_modulus
    p.small[ring_rates.NUMBERS, ring_rates.TARGET :] = events.numbers
    rows = (-1 if row is None else row for row in (programme.isochoric_row, programme.cauchy_row))
    p.codes[ring_rates.ISOCHORIC], p.codes[ring_rates.CAUCHY] = rows
    p.codes[ring_rates.QUANTITY] = events.quantity
    return *arrays, p


NO_FUNCTIONS = EventFunctions(
    np.zeros((0, 2), dtype=np.int64), np.zeros((2, 0)), np.zeros((0, 4, 4)),
    np.zeros(0, dtype=np.int64), 8, (0.0, 1.0, 0.0, 1.0, 1.0),
)  # fmt: skip
