"""Results: one line at the prompt, a small table in a notebook, a data frame, a figure."""

from __future__ import annotations

from html import escape
from typing import Any, ClassVar

import numpy as np

from loops.errors import InputError
from loops.lazy import SERVED, named

LONGEST_REPR = 240  # characters of the line at the prompt; the table of a notebook has all facts
FEW = 4  # numbers that are shown one by one
MOST_WORDS = 6  # different words of an array that are counted
# Names of fields by their unit.
NAMES = {
    "length": "x x0 radii radii_i radii_j cell cell0 branch branches reference_branches length",
    "length²": "area volume",
    "force": "force normal_force shear_force",
    "force/length": "P additive_work alone alone_error elastic_stress elastic_tangent matrix "
    "reaction second_order_work stress stress_before stress_rate tangent work",
    "force·length": "released rolling_moment",
    "rad": "angle axis edges opening",
}
UNITS = {name: unit for unit, names in NAMES.items() for name in names.split()}


class Shown:
    """Base of all results: `repr` in one line, `_repr_html_`, `table()` and `plot()`.

    `shown` are the attributes in the line, all fields if there are none; `unitless` those whose
    names stand for other quantities in `NAMES`.
    """

    shown: ClassVar[tuple[str, ...]] = ()
    unitless: ClassVar[tuple[str, ...]] = ()

    def facts(self) -> dict[str, object]:
        """Names and short values with units; arrays by their shape and range."""
        names = self.shown or getattr(self, "__dataclass_fields__", vars(self))
        values = {name: getattr(self, name) for name in names if not name.startswith("_")}
        return {
            name: f"{brief(value)} {UNITS[name]}"
            if name in UNITS and name not in self.unitless
            else brief(value)
            for name, value in values.items()
            if value is not None
        }

    def __repr__(self) -> str:
        said = ", ".join(f"{name}: {value}" for name, value in self.facts().items())
        if len(said) > LONGEST_REPR:
            said = said[:LONGEST_REPR].rpartition(", ")[0] + ", ..."
        return f"{type(self).__name__}({said})"

    def _repr_html_(self) -> str:
        rows = "".join(
            f"<tr><th>{escape(name)}</th><td>{escape(str(value))}</td></tr>"
            for name, value in self.facts().items()
        )
        return f"<table><caption>{type(self).__name__}</caption>{rows}</table>"

    def table(self) -> Any:
        """Return a pandas DataFrame: a row a direction, a state, a loop, or one row of facts."""
        return _served("table")(self)

    def plot(self, ax: Any = None) -> Any:
        """Draw the result into these axes, or pyplot's, and return them."""
        return _served("plot")(self, ax=ax)


def _served(name: str) -> Any:
    """Return the function of the front door that makes tables or figures of results."""
    if name not in SERVED:
        remedy = "Write import grainloops first."
        raise InputError(f".{name}()", "no front door", "grainloops, imported", remedy)
    return named(SERVED[name])


def brief(value: object) -> object:
    """A value in few characters: a number or word as it is, an array by its range and shape."""
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, str | int | np.generic):
        return value
    if isinstance(value, tuple | list):
        plain = all(isinstance(one, str | int | float) for one in value)
        if plain and len(value) <= FEW:
            return "(" + ", ".join(str(brief(one)) for one in value) + ")"
        return f"{len(value)} {type(value[0]).__name__ if len(value) else 'items'}"
    if not isinstance(value, np.ndarray):
        return getattr(value, "name", type(value).__name__)
    shape = f"({', '.join(map(str, value.shape))})"
    kind = value.dtype.kind
    if value.size == 0 or kind not in "biufU":
        return shape
    if value.ndim < 2 and value.size <= FEW:
        few = str([brief(one) for one in value.ravel().tolist()]).replace("'", "")
        return few if value.ndim else few[1:-1]
    if kind == "U":
        words, counts = np.unique(value, return_counts=True)
        pairs = zip(counts.tolist(), words.tolist(), strict=True)
        return " + ".join(f"{n} {word}" for n, word in pairs) if len(words) <= MOST_WORDS else shape
    if kind == "b":
        return f"{np.count_nonzero(value)} of {value.size}"
    known = value[np.isfinite(value)]
    if known.size == 0:
        return f"{value.flat[0]} {shape}"
    low, high = known.min(), known.max()
    return (f"{low:.4g}" if low == high else f"{low:.4g} to {high:.4g}") + f" {shape}"
