"""Checks of grain graphs and of arguments: each names the offending grain, contact or number."""

from __future__ import annotations

from collections.abc import Callable
from types import EllipsisType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from loops.arrays import Flags, Floats, Integers, Regimes
from loops.errors import InputError, short

Length = int | None | EllipsisType


def check_graph(graph: Any) -> None:
    """Raise `InputError` at the first fault of a grain graph."""
    require_shape("x", graph.x, ..., None, 2, remedy="Give two coordinates: grains in the plane.")
    require_shape("contacts", graph.contacts, None, 2)
    grains, count = graph.grain_count, len(graph.contacts)
    shapes = {"radii": (..., grains), "x0": (..., grains, 2), "images": (count, 2)}
    shapes |= dict.fromkeys(("cell", "cell0"), (..., 2, 2))
    for name in (*shapes, "normal_force", "shear_force", "rolling_moment"):
        if (value := getattr(graph, name)) is not None:
            require_shape(name, value, *shapes.get(name, (..., count)))
    if graph.cell is not None:
        _check_cell("cell", graph.cell)
        _check_cell("cell0", graph.cell0)
    elif graph.cell0 is not None or (graph.images is not None and np.any(graph.images)):
        name = "images" if graph.cell0 is None else "cell0"
        received = "periodic images without a cell" if graph.cell0 is None else "no cell with it"
        raise InputError(name, received, "a cell", "Give the cell vectors.")
    try:
        _ = graph.batch_shape
    except ValueError as error:
        expected = "axes that broadcast"
        raise InputError("batch axes", str(error), expected, "Align them.") from None
    moved = () if graph.x0 is graph.x else (("reference position", graph.x0),)
    for name, value in (("position", graph.x), *moved):
        ok = np.logical_and.reduce([np.isfinite(value[..., k]) for k in range(2)])
        _finite(name, "grain", ok, value)
    _finite("radius", "grain", np.isfinite(graph.radii), graph.radii)
    if not (graph.radii > 0).all():
        index = _first(graph.radii <= 0)
        where, received = f"radius of grain {index[-1]}", f"{graph.radii[index]}"
        raise InputError(where, received, "a positive length", "Correct it.")
    _check_contacts(graph)


def checked_regimes(regime: ArrayLike, contacts: int) -> Regimes:
    """Regimes as int8, or `InputError` unless each is open (0), elastic (1) or sliding (2)."""
    array = real("regime", regime, ..., contacts, expected="0 (open), 1 (elastic) or 2 (sliding)")
    known = (array == 0) | (array == 1) | (array == 2)
    if not known.all():
        index = _first(~known)
        where, expected = f"regime of contact {index[-1]}", "0 (open), 1 (elastic) or 2 (sliding)"
        raise InputError(where, f"{array[index]:g}", expected, "Use gl.Regime.")
    return array.astype(np.int8)


def _check_cell(name: str, cell: Floats) -> None:
    if not (np.isfinite(cell).all() and (np.linalg.det(cell) != 0).all()):
        raise InputError(
            name, str(cell.tolist()), "independent cell vectors as columns", "Correct the cell."
        )


def require_shape(name: str, value: NDArray[Any], *shape: Length, remedy: str = "") -> None:
    """Raise `InputError` for another shape: None is any length, `...` any axes before."""
    leading = shape[:1] == (...,)
    own = value.shape[1 - len(shape) :] if leading and len(shape) > 1 else value.shape
    if len(own) != len(shape[leading:]) or not fits(own, shape[leading:]):
        expected = f"shape {shape}".replace("None", "n").replace("Ellipsis", "...")
        remedy = remedy or "Reshape or complete the array."
        raise InputError(name, f"shape {value.shape}", expected, remedy)


def fits(own: tuple[int, ...], shape: tuple[Length, ...], *single: int) -> bool:
    """Return whether the last lengths are those of a shape, or the `single` one."""
    pairs = zip(own[::-1], shape[::-1], strict=False)
    return len(own) <= len(shape) and all(m is None or n in (m, *single) for n, m in pairs)


def _finite(what: str, item: str, ok: Flags, value: Floats) -> None:
    if ok.all():
        return
    index = _first(~ok)
    where, received = f"{what} of {item} {index[-1]}", str(value[index])
    raise InputError(where, received, "finite numbers", "Correct or drop it.")


def _check_contacts(graph: Any) -> None:
    contacts, grains = graph.contacts, graph.grain_count
    if len(contacts) == 0:
        return
    if contacts.min() < 0 or contacts.max() >= grains:
        c = _first(np.asarray(((contacts < 0) | (contacts >= grains)).any(axis=1)))[0]
        received, expected = f"grains {contacts[c].tolist()}", f"grains 0 to {grains - 1}"
        raise InputError(f"contact {c}", received, expected, "Add the grain or drop the contact.")
    for name in ("normal_force", "shear_force", "rolling_moment"):
        value = getattr(graph, name)
        if value is not None:
            _finite(name.replace("_", " "), "contact", np.isfinite(value), value)
    own = contacts[:, 0] == contacts[:, 1]
    if graph.images is not None:
        own &= (graph.images[:, 0] == 0) & (graph.images[:, 1] == 0)
    if own.any():
        c = _first(own)[0]
        received = f"grain {contacts[c, 0]} with itself"
        expected = "two grains, or a grain and its periodic image"
        raise InputError(f"contact {c}", received, expected, "Drop the contact.")
    again, first = repeated_contacts(contacts, graph.images, grains)
    if len(again):
        received = f"grains {contacts[again[0]].tolist()}, the same as contact {first[0]}"
        where, expected = f"contact {again[0]}", "each contact once"
        raise InputError(where, received, expected, "Drop one of the two.")


def repeated_contacts(
    contacts: Integers, images: Integers | None, grain_count: int
) -> tuple[Integers, Integers]:
    """Contacts with the grains and image of an earlier one, and the first one of each."""
    i, j = contacts.T
    key = np.minimum(i, j) * grain_count + np.maximum(i, j)
    # Sorting values alone is faster than with their places; they are usually all different.
    ascending = np.sort(key)
    twice = ascending[1:][ascending[1:] == ascending[:-1]]
    if not len(twice):
        return twice, twice
    # Only pairs of grains that occur more than once need their images compared.
    rows = np.flatnonzero(np.isin(key, twice))
    at = np.zeros((len(rows), 2), dtype=np.int64) if images is None else images[rows]
    table = np.hstack(ordered(contacts[rows], at))
    _, first, which = np.unique(table, axis=0, return_index=True, return_inverse=True)
    earlier = rows[first][which.ravel()]
    again = earlier != rows
    return rows[again], earlier[again]


def ordered(grains: Integers, images: Integers) -> tuple[Integers, Integers]:
    """The smaller grain first, of one grain the larger image."""
    i, j = grains.T
    back = (images[:, 0] < 0) | ((images[:, 0] == 0) & (images[:, 1] < 0))
    flip = (i > j) | ((i == j) & back)
    return (
        np.where(flip[:, None], grains[:, ::-1], grains),
        np.where(flip[:, None], -images, images),
    )


def check_branches(what: str, contacts: Integers, branches: Floats) -> None:
    """Raise `InputError` if a contact joins two grains with the same centre."""
    distinct = np.logical_or.reduce([branches[..., k] != 0 for k in range(branches.shape[-1])])
    if distinct.all():
        return
    c = _first(~distinct)[-1]
    i, j = contacts[c].tolist()
    where, received = f"contact {c}", f"coincident {what} of grains {i} and {j}"
    raise InputError(where, received, "distinct centres", "Move or drop one of the grains.")


def _first(mask: Flags) -> tuple[int, ...]:
    """Index of the first true entry."""
    return tuple(int(k) for k in np.unravel_index(np.argmax(mask), mask.shape))


def real(
    name: str, value: ArrayLike, *shape: Length, expected: str = "real numbers", remedy: str = ""
) -> Floats:
    """Return real numbers as a float64 array; `InputError` for others, or another shape."""
    try:
        array = np.asarray(value)
        # Objects are numbers of other libraries; None and text would turn into numbers.
        objects = array.dtype.kind == "O" and all(hasattr(x, "__float__") for x in array.flat)
        if array.dtype.kind not in "biuf" and not objects:
            raise TypeError
        array = array.astype(np.float64, copy=False)
    except (TypeError, ValueError):
        raise InputError(name, short(value), expected, remedy or f"Correct {name}.") from None
    if shape:
        require_shape(name, array, *shape, remedy=remedy)
    return array


def integers(name: str, values: ArrayLike, *shape: Length) -> Integers:
    """Return whole numbers as an int64 array; `InputError` for others, or another shape."""
    try:
        array = np.asarray(values)
    except ValueError:
        array = np.array(None)
    if array.size and array.dtype.kind not in "iu":
        raise InputError(name, short(values), "integers", "Convert the numbers first.")
    if shape:
        require_shape(name, array, *shape)
    return array.astype(np.int64, copy=False)


Check = Callable[..., Floats]


def _checked(holds: Callable[[Floats], Flags], expected: str) -> Check:
    def check(name: str, value: ArrayLike, *shape: Length) -> Floats:
        array = real(name, value, *shape, expected=expected)
        for within, wanted in ((np.isfinite, "a finite number"), (holds, expected)):
            wrong = np.argwhere(~np.atleast_1d(within(array)))
            if len(wrong):
                first = tuple(wrong[0].tolist())
                where = name if array.ndim == 0 else f"{name}{list(first)}"
                received = f"{np.atleast_1d(array)[first]:.17g}"
                raise InputError(where, received, wanted, f"Correct {name}.")
        return array

    return check


# Each takes the argument's name, its value and perhaps its shape, and returns a float64 array or
# raises `InputError`.
finite = _checked(np.isfinite, "a finite number")
nonnegative = _checked(lambda a: a >= 0.0, "zero or more")
positive = _checked(lambda a: a > 0.0, "a positive number")
acute_angle = _checked(
    lambda a: (a > 0.0) & (a < np.pi / 2),
    "an angle between 0 and pi/2 radians (0 and 90 degrees), both out",
)
# pi/2 means that nothing slides.
friction_angle = _checked(
    lambda a: (a >= 0.0) & (a <= np.pi / 2), "an angle from 0 to pi/2 radians (0 to 90 degrees)"
)
# The cost of a drained path grows with the ratio.
drained_kappa = _checked(lambda a: (a >= 0.0) & (a <= 1000.0), "a stiffness ratio from 0 to 1000")
# At 1 the side length would vanish.
strain = _checked(lambda a: a < 1.0, "a compressive strain below 1")
confining_strain = _checked(lambda a: (a >= 0.0) & (a < 1.0), "a compressive strain in [0, 1)")
sliding_sign = _checked(lambda a: np.abs(a) == 1.0, "+1 or -1, the sign of T")
