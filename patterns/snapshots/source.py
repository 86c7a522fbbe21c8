"""A file and the options of `read_snapshot`, checked."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, get_args

from loops import HertzMindlin, InputError
from loops.arrays import Floats
from loops.errors import check_choice, check_type, number, path_of
from loops.laws.frictional import ShearHistory, ShearIncrement, friction_of
from patterns.snapshots.geometry import as_cell, as_periodic

LawName = Literal["linear", "hertz", "cohesive", "bonded"]
# Options that are one of these words, which `cell_....json` may have too.
CHOICES = {
    "law": get_args(LawName),
    "shear_history": get_args(ShearHistory),
    "shear_increment": get_args(ShearIncrement),
}
# Those of `CohesiveFrictional`: attraction, and bonds.
COHESIVE = ("cohesive", "bonded")
# Laws, and the options that they alone have.
OPTIONS_OF_LAWS = {
    ("hertz",): ("young", "poisson", "shear_history"),
    COHESIVE: ("adhesion", "cohesion"),
}


@dataclass(frozen=True, eq=False)
class Source:
    """A file and the options of `read_snapshot`, None where they are left to the file.

    `cell` holds the vectors as columns; parameters of the law are for columns that a file lacks,
    but `young` and `poisson` replace `kn` and `ks`, which are tangents under Hertz's law.
    """

    path: Path
    contacts: Path | None = None
    cell: Floats | None = None
    periodic: tuple[bool, bool] | None = None
    format: str = "auto"
    columns: Mapping[str, str] = field(default_factory=dict)
    strict: bool = True
    law: LawName | None = None
    kn: float | None = None
    kt: float | None = None
    mu: float | None = None
    young: float | None = None
    poisson: float | None = None
    shear_increment: ShearIncrement | None = None
    shear_history: ShearHistory | None = None
    adhesion: float | None = None
    cohesion: float | None = None


def check_words(given: Mapping[str, Any], of: str = "") -> None:
    """Raise `InputError` for one of the `CHOICES` that is another word."""
    for name, known in CHOICES.items():
        if given.get(name) is not None:
            check_choice(f"{name}{of}", given[name], known)


def source_of(
    path: str | Path,
    contacts: str | Path | None = None,
    *,
    mu: float | None = None,
    phi: float | None = None,
    columns: Mapping[str, str | int] | None = None,
    **options: Any,
) -> Source:
    """Check a path and options of `read_snapshot`."""
    asked = {name: value for name, value in options.items() if value is not None}
    law, friction = asked.get("law"), friction_of(mu, phi)
    check_words(asked)
    for laws, names in OPTIONS_OF_LAWS.items():
        others = [name for name in names if name in asked]
        if others and law not in laws:
            named = " or ".join(f"--law {one}" for one in laws)
            received = f"{', '.join(others)} under {law or 'no named law'}"
            remedy = f"Give {named}, or leave them out."
            raise InputError("law", received, "options of that law", remedy)
    for name in {"kn", "kt", "young", "poisson", "adhesion", "cohesion"} & {*asked}:
        number(name, asked[name], 0.0, open_low=name == "kn")
    if friction is not None and friction != math.inf:
        number("mu", friction, 0.0)
    if law == "hertz" and {"kn", "kt"} & {*asked}:
        remedy = "Give young and poisson, or columns kn and ks with the tangents of each contact."
        raise InputError("law", "one kn or kt under Hertz's law", "its moduli", remedy)
    if ("young" in asked) != ("poisson" in asked):
        (alone,) = {"young", "poisson"} & {*asked}
        raise InputError("law", f"{alone} alone", "young and poisson", "Give both.")
    if "young" in asked:
        HertzMindlin(asked["young"], asked["poisson"])  # raises for numbers out of range
    given = {} if columns is None else columns
    check_type("columns", given, Mapping, "Give {'radius': 'R'}, plain name to column.")
    remedy = "Give the name of a column, or its number."
    for name, column in given.items():
        check_type(f"columns[{name!r}]", column, (str, int), remedy)
    remedy = "Name a file; for tables in memory call snapshot_from_tables."
    asked["contacts"] = None if contacts is None else path_of("contacts", contacts, remedy)
    asked["cell"] = as_cell(asked.get("cell"))
    asked["periodic"] = as_periodic(asked.get("periodic"))
    asked["columns"] = {name: str(column) for name, column in given.items()}
    asked["mu"] = friction
    return Source(path_of("path", path, remedy), **asked)
