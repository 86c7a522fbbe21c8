"""What a hard case is: a scene that one number makes harder, and what must come out."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Literal

from numpy.typing import ArrayLike

from loops import ContactLaw, GrainGraph

Kind = Literal["tangent", "path", "faces"]

# A row of answers, one letter a value.
LETTERS = {
    "s": "stable",
    "u": "unstable",
    "?": "undetermined",
    "e": "error",
    "y": "yes",
    "n": "no",
}


@dataclass(frozen=True, eq=False)
class Scene:
    """A state to compute with.

    Attributes
    ----------
    graph : GrainGraph
        Grains, contacts and forces.
    law : ContactLaw
        Contact law.
    regime : (C,) array of int, optional
        Regimes of the contacts; read from the state if None.
    spins : str
        Spin rule.
    stages : tuple of (str, str, float)
        For paths: name of the programme, quantity and value at which it ends.
    """

    graph: GrainGraph
    law: ContactLaw
    regime: ArrayLike | None = None
    spins: Literal["blocked", "affine", "free"] = "blocked"
    stages: tuple[tuple[str, str, float], ...] = ()


@dataclass(frozen=True, eq=False)
class HardCase:
    """A named hard case (theory note, section 10).

    Attributes
    ----------
    name : str
        Its name.
    description : str
        What is hard about it, in one line.
    kind : {'tangent', 'path', 'faces'}
        What is computed of it.
    parameter : str
        What `values` are.
    values : tuple of float
        From mild to extreme, and often beyond what double precision can tell.
    build : callable
        Scene for one value; `InputError` where none is to be had.
    expected : mapping of str to str
        Expected answers, one letter a value. For tangents, by closure: `s` stable, `u` unstable,
        `?` undetermined, `e` refused with `InputError`; and `regime`, that of contact 0 as read
        from the state: `o` open, `e` elastic, `s` sliding. For faces, `loops`: `y` all of them
        right, `e` refused.
    subspace : str
        Where tangents are judged.
    status, events : str and tuple of str
        For paths under the affine closure: how they end, and the kinds of the events that must be
        met, in this order.
    place : callable, optional
        For paths: exact `H11` of the last of these events, from closed forms.
    """

    name: str
    description: str
    kind: Kind
    parameter: str
    values: tuple[float, ...]
    build: Callable[[float], Scene]
    expected: Mapping[str, str] = field(default_factory=dict)
    subspace: str = "symmetric"
    status: str = ""
    events: tuple[str, ...] = ()
    place: Callable[[float], float] | None = None
