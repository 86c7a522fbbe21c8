"""Known contact laws as kernels: what each gives for all pairs at once, and its pointer.

A function here fills `out` (4, P) with `N`, `kt`, the strength, and the shear force that a pair
keeps as its overlap changes; `out` (8, P) also with their slopes over the overlap. It takes
constants (n, P), radii (2, P), overlaps (P,) now and a step before, and shear forces (P,). What it
gives for pairs that are apart is not read. `loops.laws.compiled` makes the same of a law of one's
own, without the slopes.
"""

from __future__ import annotations

import math
from typing import Any

from numba import types
from numba.experimental.function_type import _get_wrapper_address
from numba.extending import typeof_impl

from loops.arrays import Floats
from loops.compiled import kernel

LINE, TABLE = (types.Array(types.float64, n, "C") for n in (1, 2))
FILL = types.void(TABLE, TABLE, LINE, LINE, LINE, TABLE)
POINTED = types.FunctionType(FILL)


class Pointer(types.WrapperAddressProtocol):
    """A compiled law that a kernel calls by its address; `made` of a law of one's own."""

    def __init__(self, function: Any, made: bool = False) -> None:
        if FILL.args not in function.overloads:
            function.compile(FILL)
        self.function = function
        self.made = made
        self.address = int(_get_wrapper_address(function, FILL))

    def __wrapper_address__(self) -> int:
        """Return the address of the function."""
        return self.address

    def signature(self) -> Any:
        """Return the types of the arguments."""
        return FILL


@typeof_impl.register(Pointer)
def _pointed(pointer: Pointer, context: Any) -> Any:
    """Return the type of every pointer: numba makes one anew at each call, which takes longer."""
    return POINTED


@kernel
def springs(
    constants: Floats, radii: Floats, overlap: Floats, before: Floats, T: Floats, out: Floats
) -> None:
    """Fill in linear springs of the constants `kn`, `kt`, `mu`, attraction, cohesion."""
    for p in range(len(overlap)):
        normal, mu = constants[0, p] * overlap[p] - constants[3, p], constants[2, p]
        out[0, p], out[1, p], out[3, p] = normal, constants[1, p], T[p]
        out[2, p] = math.inf if math.isinf(mu) else max(mu * normal + constants[4, p], 0.0)
    for p in range(len(overlap) if len(out) > 4 else 0):
        out[4, p], out[5, p], out[7, p] = constants[0, p], 0.0, 0.0
        strength = constants[2, p] * out[0, p] + constants[4, p]
        out[6, p] = constants[2, p] * constants[0, p] if strength >= 0.0 else 0.0


@kernel
def hertz(
    constants: Floats, radii: Floats, overlap: Floats, before: Floats, T: Floats, out: Floats
) -> None:
    """Fill in spheres of the constants `kn`, `kt` over the root of the overlap, `mu`."""
    for p in range(len(overlap)):
        normal, root = constants[0, p] * overlap[p], math.sqrt(overlap[p])
        out[0, p], out[1, p] = normal * root, constants[1, p] * root
        out[2, p], out[3, p] = constants[2, p] * normal * root, T[p]
    for p in range(len(overlap) if len(out) > 4 else 0):
        root = math.sqrt(overlap[p])
        out[4, p], out[5, p] = 1.5 * constants[0, p] * root, 0.5 * constants[1, p] / root
        out[6, p], out[7, p] = constants[2, p] * out[4, p], 0.0


@kernel
def hertz_by_displacement(
    constants: Floats, radii: Floats, overlap: Floats, before: Floats, T: Floats, out: Floats
) -> None:
    """Fill in the same, of shear forces that go with `kt`."""
    hertz(constants, radii, overlap, before, T, out)
    for p in range(len(overlap)):
        out[3, p] = T[p] * (math.sqrt(overlap[p]) / math.sqrt(before[p]))
    for p in range(len(overlap) if len(out) > 4 else 0):
        out[7, p] = 0.5 * out[3, p] / overlap[p]


@kernel
def given(
    constants: Floats, radii: Floats, overlap: Floats, before: Floats, T: Floats, out: Floats
) -> None:
    """Fill in what numpy was asked for: the constants are the answers."""
    for p in range(len(overlap)):
        for k in range(len(out)):
            out[k, p] = constants[k, p]


@kernel
def asked(
    constants: Floats, radii: Floats, overlap: Floats, before: Floats, T: Floats, out: Floats
) -> None:
    """Write what is asked for into the constants (3, P): overlaps, those before, shear forces."""
    for p in range(len(overlap)):
        constants[0, p], constants[1, p], constants[2, p] = overlap[p], before[p], T[p]
