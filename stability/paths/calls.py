"""The doors of a segment: the compiled rates of a ring, and Python functions that kernels call."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from typing import Any

import numpy as np
from numba import carray, types  # type: ignore[attr-defined]
from numba.experimental.function_type import _get_wrapper_address
from numba.extending import typeof_impl

from loops.arrays import Floats
from stability.paths.ring_rates import (
    BALANCE,
    CONDITION,
    HEADER,
    LEAST_RATE_PIVOT,
    PLACE,
    RATES,
    SOLUTION,
    SOLVED,
    UNIT,
    VALUES,
    balance_of_ring,
    complete,
    condition_of,
    describe,
    eliminate,
    force_rates,
    lengths,
    place_contacts,
    problem_in,
    solve_path,
    system,
    tangent_of_ring,
    write_control,
    write_equations,
    write_rates,
    write_values,
)

ANSWER = types.void(types.int64, types.CPointer(types.float64), types.CPointer(types.int64))
ASKED = types.FunctionType(ANSWER)
ADDRESS = ctypes.CFUNCTYPE(None, ctypes.c_int64, ctypes.c_void_p, ctypes.c_void_p)


def answer(what: int, numbers: Any, whole_numbers: Any) -> None:
    """Compute what is asked of the loop whose arrays begin at these pointers, see `RATES`.

    The last place of the answer is 0 where null vectors have to be looked for, and 1 otherwise.
    """
    floats, whole = lengths(carray(whole_numbers, (HEADER,)))
    p = problem_in(carray(numbers, (floats,)), carray(whole_numbers, (whole,)))
    y, gauge, out = p.shared
    out[len(out) - 1] = 1.0
    if what < SOLVED:
        place_contacts(p, y)
        if what == PLACE:
            write_control(p, p.small[SOLUTION, UNIT])
            return
        N, gear = write_equations(p)
        known = what < VALUES or tangent_of_ring(p, N) > LEAST_RATE_PIVOT
        complete(p, N, gauge)
        known = eliminate(p, system(p, 2, N + 5, N + 6), N + 5) > LEAST_RATE_PIVOT and known
        if not known:
            out[len(out) - 1] = 0.0
            return
        solve_path(p, N, gear)
        if what == VALUES:
            p.small[SOLUTION, BALANCE] = balance_of_ring(p, N)
        elif what != RATES:
            p.small[SOLUTION, CONDITION] = condition_of(p, N + 5)
    else:
        what -= SOLVED
    force_rates(p)
    if what == RATES:
        write_rates(p, out)
    elif what == VALUES:
        write_values(p, y, out)
    else:
        describe(p, out)


class Compiled(types.WrapperAddressProtocol):
    """The compiled `answer`, as kernels and Python call it."""

    raised = None

    def __init__(self, function: Any) -> None:
        function.compile(ANSWER)
        self.address = int(_get_wrapper_address(function, ANSWER))
        self.function, self.call = function, ADDRESS(self.address)

    def __wrapper_address__(self) -> int:
        """Return the address of the function."""
        return self.address

    def signature(self) -> Any:
        """Return the types of the arguments."""
        return ANSWER


class Callback(types.WrapperAddressProtocol):
    """A Python function of what is asked, as kernels call it, which writes numbers to `out`.

    What it raises is kept for the caller of the kernel, and `out` is not a number from then on.
    """

    def __init__(self, reply: Callable[[int], None], out: Floats) -> None:
        self.raised: BaseException | None = None

        def call(wanted: int, *_: int) -> None:
            try:
                if self.raised is None:
                    reply(wanted)
            except BaseException as error:
                self.raised = error
            if self.raised is not None:
                out[:] = np.nan

        self.pointer = ADDRESS(call)

    def __wrapper_address__(self) -> int:
        """Return the address of the function."""
        return int(ctypes.cast(self.pointer, ctypes.c_void_p).value or 0)

    def signature(self) -> Any:
        """Return the types of the arguments."""
        return ANSWER


@typeof_impl.register(Compiled)
@typeof_impl.register(Callback)
def _asked(door: Compiled | Callback, context: Any) -> Any:
    """Return the type of both: numba makes one anew at each call, which takes longer."""
    return ASKED
