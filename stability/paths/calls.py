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
from stability.paths.ring_rates import HEADER, answer_of, lengths, problem_in

ANSWER = types.void(types.int64, types.CPointer(types.float64), types.CPointer(types.int64))
ASKED = types.FunctionType(ANSWER)
ADDRESS = ctypes.CFUNCTYPE(None, ctypes.c_int64, ctypes.c_void_p, ctypes.c_void_p)


def answer(what: int, numbers: Any, whole_numbers: Any) -> None:
    """Compute what is asked of the loop whose arrays begin at these pointers, see `answer_of`."""
    floats, whole = lengths(carray(whole_numbers, (HEADER,)))
    answer_of(problem_in(carray(numbers, (floats,)), carray(whole_numbers, (whole,))), what)


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
