"""The one table of columns: names, other names, units; words of file names; known layouts."""

from __future__ import annotations

import re
import tomllib
from collections import defaultdict
from collections.abc import Iterable, Mapping
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from numpy.typing import NDArray

from loops import InputError
from patterns.snapshots.tables import Table, listed

TABLE = tomllib.loads((Path(__file__).parent / "columns.toml").read_text(encoding="utf-8"))
Dimension = tuple[int, int, int]  # powers of length, force and time
DIMENSIONS: dict[str, Dimension] = {name: tuple(own) for name, own in TABLE["dimensions"].items()}


class Column(NamedTuple):
    """Dimension of a column, and its other names."""

    dimension: Dimension
    others: tuple[str, ...]


def _columns(*kinds: str) -> dict[str, Column]:
    """Columns of kinds of tables, those of a vector one by one."""
    found = {}
    for name, (dimension, others) in (one for kind in kinds for one in TABLE[kind].items()):
        for k, axis in enumerate("xyz") if "@" in name else [(0, "")]:
            spelt = others.replace("@", axis).replace("#", str(k)).split()
            found[name.replace("@", axis)] = Column(DIMENSIONS[dimension], tuple(spelt))
    return found


WHEN, GRAINS, CONTACTS = _columns("when"), _columns("grains", "when"), _columns("contacts", "when")
OF_WALLS = [f"{part}{axis}" for part in ("branch_", "c", "n", "f") for axis in "xyz"]
OF_WALLS += ["kn", "ks", "mu", "sliding", *WHEN]
WALLS = {"id": GRAINS["id"], **{name: CONTACTS[name] for name in OF_WALLS}}
KINDS = {"grains": GRAINS, "contacts": CONTACTS, "walls": WALLS}
# All names that a column map may give.
PLAIN_NAMES = tuple(dict.fromkeys([*GRAINS, *CONTACTS]))
# Vectors among them, and axial ones: `@` is the axis.
AXIAL = ("theta_@", "omega_@", "m@_on_2")
VECTORS = tuple(n for n in {**TABLE["grains"], **TABLE["contacts"]} if "@" in n and n not in AXIAL)
UNITS: dict[str, tuple[float, Dimension]] = {
    name: (size, DIMENSIONS[dimension])
    for dimension, units in TABLE["units"].items()
    for name, size in units.items()
}
WORDS = {kind: tuple(words.split()) for kind, words in TABLE["words"].items()}
# Columns of pairs of files without names, by their numbers: grains, contacts.
LAYOUTS = {
    (len(grains), len(contacts)): (grains, contacts)
    for grains, contacts in (map(str.split, one.values()) for one in TABLE["layouts"])
}


def components(name: str, values: NDArray[Any]) -> dict[str, NDArray[Any]]:
    """Columns of a vector by plain names, `@` is the axis: `values` (rows, 2 or 3)."""
    return {name.replace("@", axis): own for axis, own in zip("xyz", values.T, strict=False)}


NONE = "none"  # entry of a column map for a column that the file lacks

# What codes call a grain: `Particle ID`, `ball.pos.x`, `Element 1 ID`.
NOUNS = re.compile("(grain|particle|body|atom|ball|sphere|disc|disk|node|element)s?")
NUMBERS = re.compile("identifiers?|identities|ids|number|no")


@cache
def plain_name(name: str, kind: str) -> str | None:
    """Plain name of a column of a kind of table by its own or another name, None if it has none."""
    key = re.sub(r"[\W_]+", "", name.lower())
    known = KINDS[kind]
    table = {re.sub("_", "", plain): plain for plain in known}
    table |= {other: plain for plain, column in known.items() for other in column.others}
    found = table.get(key)
    if found is None and kind == "contacts" and key.startswith("contact"):
        found = table.get(key.removeprefix("contact"))
    if found is None and (noun := NOUNS.match(key)):
        rest = NUMBERS.sub("id", key[noun.end() :]).replace("id", "")
        found = table.get(f"id{rest}") or table.get(key[noun.end() :])
        # Kinds of particles are species, where `type` tells walls.
        found = None if found in ("type", "type1", "type2") else found
    return found


def read_as(name: str, kind: str) -> str | None:
    """Plain name of a column, as `plain_name`, whose name may hold a unit."""
    return plain_name(name, kind) or plain_name(_parts(name)[0], kind)


def is_column(name: str) -> bool:
    """Whether a column of any table has this name."""
    return any(read_as(name, kind) for kind in KINDS)


NO_UNIT = ("", "-", "1", "--")


@cache
def unit(text: str) -> tuple[float, Dimension] | None:
    """Size in SI units and dimension of a unit such as `mm`, `N/m`, `rad/s`; None if unknown."""
    if text in NO_UNIT:
        return 1.0, (0, 0, 0)
    size, powers = 1.0, (0, 0, 0)
    for k, part in enumerate(text.replace("²", "2").replace("³", "3").split("/")):
        factors = [one for one in re.split(r"[\s*·.]+", part) if one]
        for factor in factors:
            match = re.fullmatch(r"([^\W\d]+|°)\^?(-?\d)?", factor)
            if match is None or match[1] not in UNITS:
                return None
            power = int(match[2] or 1) * (-1 if k else 1)
            size *= UNITS[match[1]][0] ** power
            one, two, three = (power * own for own in UNITS[match[1]][1])
            powers = powers[0] + one, powers[1] + two, powers[2] + three
        if not factors:
            return None
    return size, powers


def _parts(name: str) -> tuple[str, str]:
    """Stem and unit of a name: `X (m)`, `Fn [N]`, `radius_mm`, `x/mm`; the unit may be empty."""
    match = re.fullmatch(r"(.*?)\s*[\[(]([^\[\]()]*)[\])]", name)
    if match is None:
        # Of one letter only after a stroke: k_n is a stiffness.
        match = re.fullmatch(r"(.*?)(?:\s*/\s*|[_\s](?=..))([^\d_\s]+)", name)
        if match and unit(match[2]) is None:
            match = None
    return (match[1], match[2].strip()) if match else (name, "")


class Unit(NamedTuple):
    """Unit of a column as its name has it."""

    text: str
    size: float
    dimension: Dimension


def plain_tables(
    tables: Mapping[str, Table], given: Mapping[str, str]
) -> tuple[dict[str, Table], list[str], list[str]]:
    """Tables of grains, contacts and walls under plain names; notes, and columns not used.

    `given` is the user's column map: `{plain name: column}`, or `none` for one that is not used.
    """
    check_names(given, PLAIN_NAMES)
    for name, column in given.items():
        if column != NONE and not any(table.has(column) for table in tables.values()):
            where = " and ".join(f"{listed(t.names)} of {t.path}" for t in tables.values())
            remedy = "Write NAME=COLUMN, the column as the file calls it."
            raise InputError(
                f"--columns {name}={column}", f"columns {where}", f"a column {column!r}", remedy
            )
    found: dict[str, Table] = {}
    units: dict[tuple[str, str], Unit] = {}
    notes: list[str] = []
    unused: list[str] = []
    for kind, table in tables.items():
        names = _matched(table, kind, given)
        for plain, column in names.items():
            if column != plain and given.get(plain) != column:
                notes.append(f"column {column!r} of {table.path} read as {plain!r}")
            text = _parts(column)[1]
            size = unit(text) if text else None
            if size is not None and text not in NO_UNIT:
                units[kind, plain] = Unit(text, *size)
        unused += [f"{one} of {kind}" for one in table.names if one not in names.values()]
        left = {f"{n} (left out)": n for n, column in given.items() if column == NONE}
        found[kind] = table.renamed(names | left)
    for kind, name, factor in _factors(units, notes):
        table = found[kind]
        found[kind] = table.with_column(name, factor * table.column(name))
    return found, notes, unused


def _matched(table: Table, kind: str, given: Mapping[str, str]) -> dict[str, str]:
    """Columns of a table by plain name: as given, else of this name, else the one that may be."""
    known = KINDS[kind]
    names = {n: c for n, c in given.items() if n in known and (c == NONE or table.has(c))}
    spelt: dict[str, list[str]] = defaultdict(list)
    for column in table.names:
        plain = read_as(column, kind)
        if plain and plain not in names and column not in names.values():
            spelt[plain].append(column)
    for plain, columns in spelt.items():
        if plain in columns or len(columns) == 1:
            names[plain] = plain if plain in columns else columns[0]
    return {plain: column for plain, column in names.items() if column != NONE}


def _factors(
    units: Mapping[tuple[str, str], Unit], notes: list[str]
) -> Iterable[tuple[str, str, float]]:
    """Factors that bring columns to the unit of x, else of the first length, and of a force."""
    of_x = [one for (_, name), one in units.items() if name == "x"]
    base = {
        wanted: next((one for one in (*of_x, *units.values()) if one.dimension == wanted), None)
        for wanted in (DIMENSIONS["length"], DIMENSIONS["force"])
    }
    one, other = (1.0 if unit is None else unit.size for unit in base.values())
    for (kind, name), own in units.items():
        if own.dimension != KINDS[kind][name].dimension:
            notes.append(f"unit {own.text} of {name!r} of {kind} not used: not that of its column")
            continue
        length, force, _ = own.dimension
        factor = own.size / (one**length * other**force)
        if own in base.values() or factor == 1.0:
            continue
        if factor != factor:
            if all(unit is None or unit.text == own.text for unit in base.values() if length):
                continue
            where, remedy = f"units of {name!r} of {kind}", "Give all lengths in one unit."
            received = ", ".join(unit.text for unit in (own, *base.values()) if unit)
            raise InputError(where, received, "units that can be converted", remedy)
        to = " and ".join(unit.text for unit in base.values() if unit) or "SI units"
        notes.append(f"{name} of {kind} in {own.text}, times {factor:.6g}: in {to}")
        yield kind, name, factor


def check_names(given: Mapping[str, str], known: Iterable[str]) -> None:
    """Raise `InputError` for names in a column map that the format does not know."""
    for name, column in given.items():
        if name not in known:
            where = f"--columns {name}={column}"
            remedy = "Write NAME=COLUMN, the column as the file calls it."
            raise InputError(where, f"the name {name!r}", f"one of {', '.join(known)}", remedy)


def names_beside(path: Path, kind: str) -> list[str]:
    """Names that a file of contacts, walls or the cell may have beside that of the grains."""
    found = []
    for word in sorted(WORDS["grains"], key=len, reverse=True):
        for match in re.finditer(word, path.name, re.IGNORECASE):
            case = str.upper if match[0].isupper() else str.title if match[0][0].isupper() else str
            found += [path.name[: match.start()] + case(other) + path.name[match.end() :]
                      for other in WORDS[kind]]  # fmt: skip
    return list(dict.fromkeys(found))
