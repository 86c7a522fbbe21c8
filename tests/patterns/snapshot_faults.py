"""Snapshots of every format taken apart into fields, spoilt, and written again."""

from __future__ import annotations

import gzip
import re

import numpy as np
import pyarrow
import pyarrow.csv
import pyarrow.parquet

from patterns.snapshots.tables import read_table


class Deck:
    """Fields of the files of a snapshot: `(file, name)` to an array of its rows.

    `roles` says which fields hold the forces, their x and y, the ids, radii and positions.
    """

    def __init__(self, roles, **files):
        self.roles, self.fields, self.raw = roles, {}, {}
        for key, path in files.items():
            self.raw[key] = (path.name, self.load(key, path))

    def contents(self, path):
        content = path.read_bytes()
        return gzip.decompress(content) if path.suffix == ".gz" else content

    def __getitem__(self, name):
        return next(values for (_, field), values in self.fields.items() if field == name)

    def __setitem__(self, name, values):
        key = next(key for key in self.fields if key[1] == name)
        self.fields[key] = values

    def has(self, name):
        return any(field == name for _, field in self.fields)

    def keep(self, rows):
        """Some of the contacts."""
        for key in self.fields:
            if key[0] == "contacts":
                self.fields[key] = self.fields[key][rows]

    def write(self, folder):
        for key, (name, rest) in self.raw.items():
            own = {field: values for (file, field), values in self.fields.items() if file == key}
            (folder / name.removesuffix(".gz")).write_bytes(self.dump(own, rest))
        return folder / self.raw["grains"][0].removesuffix(".gz")


class Tables(Deck):
    """Tables as CSV, Parquet, npz or HDF5."""

    def __init__(self, ending, path, **options):
        self.ending, self.options = ending, options
        contacts = path.with_name(path.name.replace("grains", "contacts"))
        roles = {
            "force": ("fn", "fsx", "fsy", "fx_on_2", "fy_on_2"),
            "xy": (("fsx", "fsy"), ("fx_on_2", "fy_on_2")),
            "shear": ("fsx", "fsy"),
            "again": "fsx",
        }
        super().__init__(roles, grains=path, contacts=contacts)

    def load(self, key, path):
        for name in (table := read_table(path)).names:
            values = table.column(name)
            whole = name.startswith(("id", "cell_d")) or name in ("type", "sliding")
            self.fields[key, name] = values.astype(int) if whole else values.copy()

    def write(self, folder):
        files = {
            key: pyarrow.table({n: v for (f, n), v in self.fields.items() if f == key})
            for key in self.raw
        }
        if self.ending in ("npz", "h5"):
            arrays = {f"{f}/{n}": v for (f, n), v in self.fields.items()}
            path = folder / f"packing.{self.ending}"
            if self.ending == "npz":
                np.savez(path, **arrays)
                return path
            import h5py

            with h5py.File(path, "w") as file:
                for name, values in arrays.items():
                    file[name] = values
            return path
        for key, table in files.items():
            path = folder / f"{key}_1.{self.ending}"
            write = {"csv": pyarrow.csv.write_csv, "parquet": pyarrow.parquet.write_table}
            write[self.ending](table, path)
        return folder / f"grains_1.{self.ending}"


class Dumps(Deck):
    """Text dumps: a head of nine lines, rows of numbers under names."""

    def __init__(self, roles, names, grains, contacts, **options):
        self.names, self.options = names, options
        super().__init__(roles, grains=grains, contacts=contacts)

    def load(self, key, path):
        lines = self.contents(path).decode().splitlines()
        rows = np.array([line.split() for line in lines[9:]], dtype=float)
        columns = lines[8].split()[2:]
        for column, values in zip(columns, rows.T, strict=True):
            # Atoms have forces as well.
            name = self.names.get(column, f"atom_{column}" if column in ("fx", "fy") else column)
            self.fields[key, name] = values.copy()
        return lines[:9]

    def dump(self, own, head):
        rows = np.column_stack(list(own.values()))
        head = [*head[:3], str(len(rows)), *head[4:]]
        return "\n".join([*head, *_lines(rows)]).encode() + b"\n"


class Mercury(Deck):
    """`.data` of 8 columns and `.fstat` of one snapshot."""

    def __init__(self, grains, contacts, **options):
        self.options = options
        roles = {"force": ("fn", "ft"), "xy": (("nx", "ny"), ("tx", "ty")), "shear": ("ft",)}
        super().__init__(roles, grains=grains, contacts=contacts)

    def load(self, key, path):
        names = {
            "grains": "x y vx vy radius angle omega info",
            "contacts": "time id1 id2 cx cy cz delta delta_t fn ft nx ny nz tx ty tz",
        }[key].split()
        lines = self.contents(path).decode().splitlines()
        start = 1 if key == "grains" else 3
        rows = np.array([line.split() for line in lines[start:]], dtype=float)
        for name, values in zip(names, rows.T, strict=True):
            self.fields[key, name] = values.copy()
        return lines[:start]

    def dump(self, own, head):
        return "\n".join([*head, *_lines(np.column_stack(list(own.values())))]).encode() + b"\n"


class Save(Deck):
    """Yade's XML."""

    PLACES = (
        ("fn", r"<normalForce>\s*<x>([^<]*)</x>\s*<y>([^<]*)</y>", "xy"),
        ("fs", r"<shearForce>\s*<x>([^<]*)</x>\s*<y>([^<]*)</y>", "xy"),
        ("", r"<position>\s*<x>([^<]*)</x>\s*<y>([^<]*)</y>", "xy"),
        ("", r"<id1>([^<]*)</id1>\s*<id2>([^<]*)</id2>", ("id1", "id2")),
        ("", r"<radius>([^<]*)</radius>", ("radius",)),
        ("", r"<kn>([^<]*)</kn>", ("kn",)),
        ("", r"<ks>([^<]*)</ks>", ("ks",)),
        ("", r"<tangensOfFrictionAngle>([^<]*)<", ("mu",)),
    )

    def __init__(self, path, **options):
        self.options = options
        roles = {"force": ("fnx", "fny", "fsx", "fsy"), "xy": (("fnx", "fny"), ("fsx", "fsy"))}
        roles["shear"] = ("fsx", "fsy")
        super().__init__(roles, grains=path)

    def load(self, key, path):
        text = self.contents(path).decode()
        for stem, pattern, names in self.PLACES:
            rows = np.array(re.findall(pattern, text), dtype=float).reshape(-1, len(names))
            for name, values in zip(names, rows.T, strict=True):
                self.fields[key, f"{stem}{name}"] = values.copy()
        return text

    def dump(self, own, text):
        for stem, pattern, names in self.PLACES:
            rows = iter(np.column_stack([own[f"{stem}{name}"] for name in names]))

            def put(match, rows=rows, names=names):
                whole, start = match.group(0), match.start()
                numbers = [f"{v:.0f}" if names[0] == "id1" else f"{v:.17g}" for v in next(rows)]
                for k in range(len(names), 0, -1):
                    at = [p - start for p in match.span(k)]
                    whole = whole[: at[0]] + numbers[k - 1] + whole[at[1] :]
                return whole

            text = re.sub(pattern, put, text)
        return text.encode()

    def keep(self, rows):
        """Interactions lose their geometry where contacts are left out."""
        name, text = self.raw["grains"]
        keep = iter(np.resize(rows, text.count("<id1>")))
        # In a save each interaction is an item that begins with its ids.
        parts = re.split(r"(?=<id1>)", text)
        head, items = parts[0], parts[1:]
        kept = [
            item if next(keep) else item.replace("<geom>", "<none>").replace("</geom>", "</none>")
            for item in items
        ]
        self.raw["grains"] = name, head + "".join(kept)


def _lines(rows, digits=17):
    return [" ".join(f"{value:.{digits}g}" for value in row) for row in rows]


# The faults: each spoils a deck in place.


def flip(deck):
    for name in deck.roles["force"]:
        if deck.has(name):
            deck[name] = -deck[name]


def exchange_ids(deck):
    if deck.has("id1"):
        deck["id1"], deck["id2"] = deck["id2"], deck["id1"]


def exchange_xy(deck):
    for x, y in deck.roles["xy"]:
        if deck.has(x):
            deck[x], deck[y] = deck[y], deck[x]


def turn_fn(deck):
    if deck.has("fn"):
        deck["fn"] = -deck["fn"]


def turn_shear(deck):
    for name in ("fsx", "fsy", "ft"):
        if deck.has(name):
            deck[name] = -deck[name]
    if deck.has("fx_on_2"):
        for axis in "xy":
            deck[f"f{axis}_on_2"] = deck["fn"] * deck[f"n{axis}"] + deck[f"fs{axis}"]


def _scale(deck, name, option, factor):
    if deck.has(name):
        deck[name] = deck[name] * factor
    else:
        deck.options = deck.options | {option: deck.options[option] * factor}


def little_friction(deck):
    _scale(deck, "mu", "mu", 0.5)


def degrees(deck):
    if deck.has("mu"):
        deck["mu"] = np.full_like(deck["mu"], 26.565)
    else:
        deck.options = deck.options | {"mu": 26.565}


def other_units(deck):
    _scale(deck, "kn", "kn", 1e-4)
    _scale(deck, "ks", "kt", 1e-4)


def exchange_stiffness(deck):
    if deck.has("kn") and deck.has("ks"):
        deck["kn"], deck["ks"] = deck["ks"], deck["kn"]
    else:
        deck.options = deck.options | {"kn": deck.options["kt"], "kt": deck.options["kn"]}


def _radii(deck):
    return "radii" if deck.has("radii") else "radius"


def diameters(deck):
    deck[_radii(deck)] = 2 * deck[_radii(deck)]


def centimetres(deck):
    deck[_radii(deck)] = 100 * deck[_radii(deck)]


def other_snapshot(deck):
    """Centres after 1 % of pure shear and as much of the grains' own motion."""
    rng = np.random.default_rng(4)
    moved = deck[_radii(deck)] > 0 if len(deck[_radii(deck)]) == len(deck["x"]) else 1.0
    size = 0.01 * float(np.median(deck[_radii(deck)]))
    for name, strain in (("x", -0.01), ("y", 0.01)):
        motion = strain * deck[name] + rng.normal(0, size, len(deck[name]))
        deck[name] = deck[name] + moved * motion


def out_of_balance(deck):
    rng = np.random.default_rng(5)
    factor = None
    for name in deck.roles["force"]:
        if deck.has(name):
            factor = rng.lognormal(0, 0.6, len(deck[name])) if factor is None else factor
            deck[name] = deck[name] * factor


def few_contacts(deck):
    rng = np.random.default_rng(6)
    rows = len(deck[deck.roles["force"][0]])
    deck.keep(rng.random(rows) > 0.45)


def _typical(deck):
    """Row of a contact between grains whose force is the median one; walls have no shear."""
    force = deck.roles["force"]
    size = np.abs(deck[force[0]])
    sheared = np.any([deck[name] != 0 for name in deck.roles.get("shear", force)], axis=0)
    rows = np.flatnonzero(sheared)
    return int(rows[np.argsort(size[rows])[len(rows) // 2]])


def _change(deck, names, rows, factor):
    for name in names:
        if deck.has(name):
            values = deck[name].copy()
            values[rows] *= factor
            deck[name] = values


def turn_one(deck):
    """The force of one contact."""
    _change(deck, deck.roles["force"], _typical(deck), -1)


def turn_one_shear(deck):
    """The shear force of one contact, of the larger ones."""
    shear = deck.roles["shear"]
    size = np.hypot(*(deck[name] for name in shear)) if len(shear) == 2 else np.abs(deck[shear[0]])
    row = int(np.argsort(size)[9 * len(size) // 10])
    _change(deck, shear, row, -1)
    if deck.has("fx_on_2"):
        for axis in "xy":
            deck[f"f{axis}_on_2"] = deck["fn"] * deck[f"n{axis}"] + deck[f"fs{axis}"]


def stiff_contact(deck):
    """Stiffness kn of one contact."""
    _change(deck, ["kn"], _typical(deck), 1e4)


def _without_flags(deck):
    deck.fields = {key: values for key, values in deck.fields.items() if key[1] != "sliding"}


def rough_half(deck):
    """Friction of every other contact, in a file without flags."""
    _without_flags(deck)
    deck["mu"] = np.where(np.arange(len(deck["mu"])) % 2 == 0, 1.6 * deck["mu"], deck["mu"])


def much_friction(deck):
    if deck.has("mu"):
        deck["mu"] = deck["mu"] + 0.2
    else:
        deck.options = deck.options | {"mu": deck.options["mu"] + 0.2}


def no_flags(deck):
    deck["sliding"] = 0 * deck["sliding"]


def _one_in_hundred(count):
    return np.random.default_rng(7).choice(count, -(-count // 100), replace=False)


def other_shear(deck):
    """Shear forces of 1 % of the contacts, in one of two columns that hold them."""
    name = deck.roles["again"]
    _change(deck, [name], _one_in_hundred(len(deck[name])), 1.2)


def other_normals(deck):
    """Normals of 1 % of the contacts, turned by 0.01 rad."""
    rows = _one_in_hundred(len(deck["nx"]))
    nx, ny = deck["nx"].copy(), deck["ny"].copy()
    nx[rows], ny[rows] = nx[rows] - 0.01 * ny[rows], ny[rows] + 0.01 * nx[rows]
    deck["nx"], deck["ny"] = nx, ny


def repeat(deck):
    """Rows of 1 % of the contacts once more."""
    rows = len(deck[deck.roles["force"][0]])
    deck.keep(np.append(np.arange(rows), _one_in_hundred(rows)))


def large_radii(deck):
    deck[_radii(deck)] = 1.001 * deck[_radii(deck)]


# Each with the checks that may notice it; an `InputError` does as well.
FAULTS = {
    flip: {"directions"},
    exchange_ids: {"directions", "balance"},
    exchange_xy: {"directions"},
    turn_fn: {"fn", "directions"},
    turn_shear: {"balance"},
    little_friction: {"friction", "sliding"},
    degrees: {"friction"},
    other_units: {"stiffness"},
    exchange_stiffness: {"stiffness"},
    diameters: {"distances"},
    centimetres: {"distances"},
    other_snapshot: {"same_snapshot", "touching", "stiffness"},
    out_of_balance: {"balance"},
    few_contacts: {"jammed", "balance"},
    turn_one: {"turned", "repeated"},
    turn_one_shear: {"turned", "repeated"},
    stiff_contact: {"kn"},
    rough_half: {"one_ratio"},
    much_friction: {"sliding", "one_ratio"},
    no_flags: {"flags"},
    other_shear: {"fsx, fsy"},
    other_normals: set(),
    repeat: {"repeated"},
    large_radii: {"radii", "stiffness"},
}
# Signs and orders that a reader may tell from the grains.
HEALED = {flip, exchange_ids, exchange_xy}
