"""Contact laws as the equations of motion take them: compiled, and called once a step.

A law of one's own is compiled from the methods that its author wrote for numpy, as they stand;
known laws are kernels that numba keeps (`loops.compiled.laws`).
"""

from __future__ import annotations

from collections import namedtuple
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from loops.arrays import Floats
from loops.graph import ContactState
from loops.laws.frictional import ContactLaw, FrictionalLaw

# Steps from which on a law of one's own is compiled: that takes 2 to 3 s, and saves some 0.8 ms a
# step (4,050 contacts).
COMPILED_STEPS = 2_500
# Largest difference of a compiled law from numpy, over the size of each quantity: rounding of a few
# operations. Beyond it numpy is asked.
AS_NUMPY = 1e-12
# Overlaps over the sum of the radii at which the two are compared.
TRIED = np.geomspace(1e-4, 1e-2, 7)
# Methods that are compiled as they stand.
METHODS = ("closed_force", "stiffnesses", "strength", "coupling")
# What a law leaves to its base, as numba compiles it; the kernel asks for no `kn`, and a contact
# without friction never slides.
DEFAULTS: dict[str, Callable[..., Any]] = {
    "stiffnesses": lambda law, state: (0.0, law.kt),
    "strength": lambda law, state: np.where(
        np.isfinite(law.mu), law.mu * state.normal_force, np.inf
    ),
    "coupling": lambda law, state: 0.0,
}
# Methods that the compiled law has no use for; where they are changed numpy is asked.
DERIVED = ("local_stiffness", "normal_force")

State = namedtuple(
    "State", "overlap touching_length length radii_i radii_j normal_force shear_force"
)


class Filling(NamedTuple):
    """A law as a kernel calls it, by a pointer, with its constants by pair (n, P)."""

    pointer: Any
    constants: Floats


def compiled(law: FrictionalLaw, radii: Floats, walls: Floats) -> Filling | str:
    """Return a law of one's own between pairs, compiled; or why numba cannot.

    `radii` (2, P) are those that its formulae see, `walls` (4, P) factor, pull, `kt` and `mu` as
    `PairLaw` has them, zero between grains. Numba takes some things otherwise than numpy,
    such as the truth of an array: a law whose numbers differ is not compiled.
    """
    kind = type(law)
    changed = [name for name in DERIVED if getattr(kind, name) is not getattr(FrictionalLaw, name)]
    if changed:
        return f"it changes {', '.join(changed)}"
    names = tuple(
        name
        for name, value in sorted(vars(law).items())
        if not isinstance(value, str | bool)
        and np.ndim(value) <= 1
        and np.asarray(value).dtype.kind in "iuf"
    )
    pointer = _compiled(tuple(getattr(kind, name) for name in METHODS), names)
    if isinstance(pointer, str):
        return pointer
    count = radii.shape[1]
    constants = np.array([np.broadcast_to(vars(law)[name], count) for name in names])
    constants = np.concatenate([constants.reshape(len(names), count), walls])
    # Some overlaps and shear forces of either sign, of the formulae alone.
    touching = radii.sum(axis=0)
    trial = touching * TRIED[np.arange(count) % len(TRIED)]
    overlap, before = touching - (touching - trial), 0.9 * trial
    T = trial * np.where(np.arange(count) % 2, 1.0, -1.0)
    out, grains = np.empty((4, count)), constants.copy()
    grains[len(names) :] = 0.0
    try:
        pointer.function(grains, np.ascontiguousarray(radii), overlap, before, T, out)
    except Exception as error:
        return f"compiled it raises {type(error).__name__}: {error}"
    wanted = answer_of(law, radii, overlap, before, T)
    size = np.where(np.isfinite(wanted), np.abs(wanted), 0.0).max(axis=1, keepdims=True)
    if not np.isclose(out, wanted, rtol=AS_NUMPY, atol=AS_NUMPY * size).all():
        return "compiled it gives other numbers than in numpy"
    return Filling(pointer, constants)


@cache
def _compiled(methods: tuple[Callable[..., Any], ...], names: tuple[str, ...]) -> Any:
    """Return a pointer to the methods of a law, compiled; or why numba cannot."""
    import numba
    from numba.core.errors import NumbaError

    from loops.compiled.laws import FILL, Pointer

    defaults = DEFAULTS if "mu" in names else DEFAULTS | {"strength": lambda law, state: np.inf}
    written = [
        defaults[name] if method is getattr(FrictionalLaw, name) else method
        for name, method in zip(METHODS, methods, strict=True)
    ]
    how: dict[str, Any] = {"nogil": True, "error_model": "numpy"}
    parts = {f"method_{k}": numba.njit(**how)(method) for k, method in enumerate(written)}
    parts |= {"Law": namedtuple("Law", names), "State": State, "where": np.where}
    rows = "".join(f"constants[{k}], " for k in range(len(names)))
    exec(FILLING.format(rows=rows, n=len(names)), parts)
    try:
        return Pointer(numba.njit(FILL, **how)(parts["fill"]), made=True)
    except NumbaError as error:
        lines = [line.strip() for line in str(error).splitlines() if line.strip()]
        return next((line for line in lines if not line.startswith("Failed in")), lines[0])


# Walls have constants of their own behind those of the law.
FILLING = """
def fill(constants, radii, overlap, before, T, out):
    law = Law({rows})
    factor, pull, k, mu = constants[{n}], constants[{n} + 1], constants[{n} + 2], constants[{n} + 3]
    wall, i, j = factor > 0.0, radii[0], radii[1]
    walled = wall.any()
    if walled:
        i, j = where(wall, 2.0 * radii[0], radii[0]), where(wall, 2.0 * radii[0], radii[1])
    touching = i + j
    length = touching - overlap
    state = State(overlap, touching, length, i, j, T, T)
    N = method_0(law, state)
    state = State(overlap, touching, length, i, j, N, T)
    kn, kt = method_1(law, state)
    out[0] = N
    out[1] = kt
    out[2] = method_2(law, state)
    out[3] = where(T != 0.0, T - method_3(law, state) * (before - overlap), T)
    for p in range(len(overlap) if walled else 0):
        if wall[p]:
            pushed = out[0, p] - pull[p]
            out[0, p], out[1, p] = factor[p] * pushed, k[p] * pushed / overlap[p]
            out[2, p] = mu[p] * out[0, p]
"""


def answer_of(
    law: FrictionalLaw, radii: Floats, overlap: Floats, before: Floats, T: Floats
) -> Floats:
    """Return (4, C) what a compiled law fills in, from numpy."""
    state = pressed_contacts(law, radii, overlap, T)
    D = law.local_stiffness(state, np.ones(len(T), dtype=np.int8))
    kept = np.where(T != 0.0, T - D[:, 1, 0] * (before - overlap), T)
    most = np.where(np.isfinite(law.mu), law.strength(state), np.inf)
    return np.array([state.normal_force, D[:, 1, 1], most, kept])


@dataclass(frozen=True, eq=False, repr=False)
class PressedContacts(ContactState):
    """Contacts of known overlaps, which their lengths hold to rounding of these alone."""

    depth: Floats = field(default_factory=lambda: np.zeros(0))

    @property
    def overlap(self) -> Floats:
        """(C,) `r_i + r_j - l`."""
        return self.depth


def pressed_contacts(law: ContactLaw, radii: Floats, overlap: Floats, T: Floats) -> ContactState:
    """Return contacts (C,) of these overlaps and shear forces, with the law's normal forces."""
    n, (i, j) = np.zeros((len(overlap), 2)), radii
    n[:, 0] = 1.0
    frame, rest = (i + j - overlap, n, n[:, ::-1]), (T, i, j)
    unloaded = PressedContacts(*frame, 0.0 * overlap, *rest, depth=overlap)
    N = np.asarray(law.closed_force(unloaded), dtype=float)
    return PressedContacts(*frame, N, *rest, depth=overlap)
