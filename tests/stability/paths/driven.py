"""Drive the compiled integration of a segment with any rates and event functions."""

from types import SimpleNamespace

import numpy as np

from stability.paths.calls import Callback
from stability.paths.kernels import follow
from stability.paths.ring_rates import RATES, VALUES
from stability.paths.segment import ATOL, EVENT, ROW, Steps, System


def drive(
    rates, values, y=(0.0,), *, tolerance=1e-12, two_sided=False, balance=lambda y: np.nan,
    max_step=1.0, row_step=np.inf, most=200, condition=1.0,
):  # fmt: skip
    """Integrate `y' = rates(y)` to the first event of `values(y)`, negative before it.

    `tolerance` and `two_sided` are those of each function, `balance` the determinant whose sign
    changes are branchings, `condition` that of the rates.
    """
    y = np.array(y, dtype=float)
    count, size = len(np.atleast_1d(values(y))), len(y)
    shared = np.zeros((3, max(size, count + 1, 6) + 1))
    state, out = shared[0, :size], shared[2]
    asked = []

    def reply(wanted):
        here = state.copy()
        asked.append((wanted, here))
        if wanted == RATES:
            out[:size] = rates(here)
        elif wanted == VALUES:
            out[:count], out[count] = values(here), balance(here)
        else:
            out[:5], out[5] = 0.0, condition
        out[-1] = 1.0

    limits = np.stack([np.broadcast_to(each, count) for each in (tolerance, two_sided)]) * 1.0
    call, width = Callback(reply, out), np.array([shared.shape[1]])
    system = System(call, call, shared.ravel(), width, limits)
    how = Steps(np.full(size, ATOL), max_step, row_step, 1.0, most)
    code, steps, end, _, fired, record = follow()(system, y, np.zeros(5), how)
    if system.call.raised is not None:
        raise system.call.raised
    rows, places = (record[(record[:, 0] == ROW) == own, 1 : size + 1] for own in (True, False))
    return SimpleNamespace(
        event=code == EVENT, code=code, steps=steps, y=end, fired=np.flatnonzero(fired).tolist(),
        rows=rows, branchings=places, asked=asked,
    )  # fmt: skip
