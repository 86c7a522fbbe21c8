"""What a hard case is: a scene that one number makes harder, and what must come out."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Literal

from numpy.typing import ArrayLike

from loops import ContactLaw, GrainGraph

# A row of answers, one letter a value.
LETTERS = dict(s="stable", u="unstable", e="error", y="yes", n="no") | {"?": "undetermined"}


@dataclass(frozen=True, eq=False)
class Scene:
    """A state to compute with; regimes are read from the state if None.

    `stages` of a path are a programme by its name, a quantity and the value at which it ends.
    """

    graph: GrainGraph
    law: ContactLaw
    regime: ArrayLike | None = None
    spins: Literal["blocked", "affine", "free"] = "blocked"
    stages: tuple[tuple[str, str, float], ...] = ()


@dataclass(frozen=True, eq=False)
class HardCase:
    """A named hard case (docs/accuracy.md).

    `values` of `parameter` go from mild to extreme, often beyond what double precision can tell;
    `build` makes a scene of one, or raises `InputError` where none is to be had. What is expected
    stands one letter a value: for tangents by closure, and `regime`, that of contact 0 as read from
    the state (`o` open, `e` elastic, `s` sliding); for faces `loops`, `e` where they are refused.
    Paths, under the affine closure, end with `status` after `events` of these kinds in this order;
    `place` is the exact `H11` of the last one, from closed forms.
    """

    name: str
    description: str
    kind: Literal["tangent", "path", "faces"]
    parameter: str
    values: tuple[float, ...]
    build: Callable[[float], Scene]
    expected: Mapping[str, str] = field(default_factory=dict)
    status: str = ""
    events: tuple[str, ...] = ()
    place: Callable[[float], float] | None = None
