"""Loops of a path as kernels take them: the arrays of a `Problem`."""

from __future__ import annotations

from functools import cache, lru_cache
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from loops.arrays import Floats, Integers
from loops.closures import ring as equations
from loops.closures.rings import CLOSURES, SPINS
from loops.compiled import compiled
from loops.laws.of_pairs import KERNELS, PairLaw
from loops.symmetry import identity
from stability.paths import ring_rates, segment
from stability.paths.model import PathModel
from stability.paths.ring_rates import Problem
from stability.programmes import Programme

# Kernels that are compiled into their callers.
INLINED = ("turn_block", "kept_motions", "condense", "weigh_moments", "_norm4")
# Laws as the kernels number them.
LAWS = ("springs", "cohesive", "hertz", "hertz_by_displacement", "given")
# Numbers of the quantities that end a stage.
QUANTITIES = {f"{tensor}{i}{j}": k for k, (tensor, i, j) in enumerate(product("HP", "12", "12"))}
QUANTITIES["parameter"] = 8


class EventFunctions(NamedTuple):
    """Event functions of a segment, see `Problem` and `System`.

    `watch` (M, 2): kinds, and the contact or eigenvalue that each belongs to, four eigenvalues a
    subspace, -1 for none; `numbers`: target, sense and start of the stage, sizes of strains and of
    the parameter per strain.
    """

    watch: Integers
    tolerance: Floats
    bases: Floats
    spaces: Integers
    quantity: int
    numbers: tuple[float, ...]


@cache
def answer() -> Any:
    """Return the compiled rates of loops, see `ring_rates.RATES`."""
    from stability.paths import calls

    modules = equations, ring_rates, calls
    return calls.Compiled(compiled(*modules, entry=("answer",), inlined=INLINED).answer)


@cache
def follow() -> Any:
    """Return the compiled integration of a segment."""
    return compiled(segment, entry=("follow",), inlined=()).follow


@lru_cache(maxsize=16)
def parts_of(model: PathModel) -> dict[str, Any]:
    """Constant parts of a `Problem` of this model."""
    law: Any = model.law
    n, known = model.contact_count, model.is_ring and type(law) in KERNELS
    radii = model.radii[model.contacts].T
    table, kind = np.zeros((n, ring_rates.WIDTH)), "given"
    columns = [
        *model.d0.T,
        model.length0,
        model.overlap0,
        model.touching,
        *np.zeros((2, n)),
        *radii,
    ]
    by_radii = getattr(law, "shear_increment", "radii") == "radii"
    if known:
        pairs = PairLaw.made(law, radii, np.full(n, -1))
        kind, constants = KERNELS[type(law)](pairs)
        columns += [pairs.reach, *constants]
    for k, column in enumerate(columns):
        table[:, ring_rates.D0X + k] = column
    if model.closure == "traction":
        # Columns of the grains: the ring's contacts come first.
        ring = slice(0, model.grain_count)
        table[ring, ring_rates.M0X : ring_rates.M0Y + 1] = model.m
        table[ring, ring_rates.BX : ring_rates.BY + 1] = model.b
    small, codes = np.zeros((ring_rates.ROWS, 9)), np.zeros(ring_rates.CODES, dtype=np.int64)
    small[ring_rates.NUMBERS, :3] = model.volume, model.length, model.stiffness
    group = model.group or identity(model.grain_count, n)
    codes[ring_rates.MIRRORS], codes[ring_rates.GRAINS] = model.mirrors, model.grain_count
    codes[ring_rates.LAW] = LAWS.index("cohesive" if known and law.cohesive else kind)
    codes[ring_rates.BY_RADII] = by_radii
    codes[ring_rates.CLOSURE], codes[ring_rates.SPINS] = CLOSURES[model.closure], SPINS[model.spins]
    pairs_apart = np.zeros((0, 2), dtype=np.int64)
    if model.is_ring:
        table[:, ring_rates.X0 : ring_rates.Y0 + 1] = model.x0
        i, j = np.triu_indices(n, 1)
        apart = ~np.isin(i * n + j, model.met) & model.watches_pairs
        pairs_apart = np.column_stack([i, j])[apart]
    return {
        "table": table, "small": small, "codes": codes,
        "images": group.contacts, "maps": group.maps, "pairs": pairs_apart,
    }  # fmt: skip


def law_is_given(model: PathModel) -> bool:
    """Whether numpy is called back for the law: it is not known, or the loop is no ring."""
    return bool(parts_of(model)["codes"][ring_rates.LAW] == ring_rates.GIVEN)


def arrays_of(
    model: PathModel, regime: Any, side: Floats, programme: Programme, events: EventFunctions
) -> tuple[Floats, Integers, Problem]:
    """Return the arrays of a loop with its regimes, programme and events, and the problem there."""
    parts, n, functions = parts_of(model), model.contact_count, len(events.watch)
    L = max(model.size, functions + 1, 6) + 1
    equations = 3 * n + 11 if model.is_ring else 0
    counts = len(parts["maps"]), functions, len(events.spaces), len(parts["pairs"]), equations
    header = np.array([L, n, *counts])
    floats, whole = ring_rates.lengths(header)
    arrays = np.zeros(floats), np.zeros(whole, dtype=np.int64)
    arrays[1][: ring_rates.HEADER] = header
    p = ring_rates.problem_in(*arrays)
    for name, values in parts.items():
        getattr(p, name)[:] = values
    p.places[ring_rates.FROM : ring_rates.TO + 1, :n] = model.contacts.T
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
