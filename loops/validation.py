"""Checks of grain graphs and of arguments: each names the offending grain, contact or number."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from loops.arrays import Flags, Floats, Integers, Regimes
from loops.errors import InputError, short


def check_graph(graph: Any) -> None:
    """Raise `InputError` at the first fault of a grain graph."""
    _shape("x", graph.x, "(..., G, 2)", graph.x.ndim >= 2 and graph.x.shape[-1] in (2, 3))
    grains, d = graph.x.shape[-2:]
    contacts = graph.contacts
    _shape("contacts", contacts, "(C, 2)", contacts.ndim == 2 and contacts.shape[1] == 2)
    count = len(contacts)
    _shape("radii", graph.radii, f"(..., {grains})", graph.radii.shape[-1:] == (grains,))
    _shape("x0", graph.x0, f"(..., {grains}, {d})", graph.x0.shape[-2:] == (grains, d))
    for name in ("normal_force", "shear_force", "rolling_moment"):
        value = getattr(graph, name)
        if value is not None:
            _shape(name, value, f"(..., {count})", value.shape[-1:] == (count,))
    if graph.cell is not None and graph.cell0 is not None and graph.images is not None:
        _shape("images", graph.images, f"({count}, {d})", graph.images.shape == (count, d))
        _shape("cell", graph.cell, f"(..., {d}, {d})", graph.cell.shape[-2:] == (d, d))
        _shape("cell0", graph.cell0, f"(..., {d}, {d})", graph.cell0.shape[-2:] == (d, d))
        _check_cell("cell", graph.cell)
        _check_cell("cell0", graph.cell0)
    elif graph.cell0 is not None or (graph.images is not None and np.any(graph.images)):
        name = "images" if graph.cell0 is None else "cell0"
        received = "periodic images without a cell" if graph.cell0 is None else "no cell with it"
        raise InputError(name, received, "a cell", "Give the cell vectors.")
    try:
        _ = graph.batch_shape
    except ValueError as error:
        raise InputError(
            "batch axes", str(error), "axes that broadcast", "Align the leading axes."
        ) from None
    moved = () if graph.x0 is graph.x else (("reference position", graph.x0),)
    for name, value in (("position", graph.x), *moved):
        ok = np.logical_and.reduce([np.isfinite(value[..., k]) for k in range(d)])
        _finite(name, "grain", ok, value)
    _finite("radius", "grain", np.isfinite(graph.radii), graph.radii)
    if not (graph.radii > 0).all():
        index = _first(graph.radii <= 0)
        raise InputError(
            f"radius of grain {index[-1]}",
            f"{graph.radii[index]}",
            "a positive length",
            "Correct it.",
        )
    _check_contacts(graph)
    if d == 3 and np.any(graph.shear_force):
        expected = "zero in three dimensions, where a shear force is a vector"
        raise InputError("shear_force", "numbers", expected, "Give normal forces alone.")


def checked_regimes(regime: ArrayLike, contacts: int) -> Regimes:
    """Regimes as int8, or `InputError` unless each is open (0), elastic (1) or sliding (2)."""
    array = real("regime", regime, expected="0 (open), 1 (elastic) or 2 (sliding)")
    if array.shape[-1:] != (contacts,):
        raise InputError(
            "regime", f"shape {array.shape}", f"shape (..., {contacts})", "Give one a contact."
        )
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


def _shape(name: str, value: NDArray[Any], expected: str, ok: bool) -> None:
    if not ok:
        raise InputError(
            name, f"shape {value.shape}", f"shape {expected}", "Reshape or complete the array."
        )


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
    if not (ascending[1:] == ascending[:-1]).any():
        return np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64)
    # Only pairs of grains that occur more than once need their images compared.
    order = np.argsort(key, kind="stable")
    same = key[order[1:]] == key[order[:-1]]
    rows = np.sort(order[np.append(same, False) | np.append(False, same)])
    table = key[rows, None]
    if images is not None:
        # Images as seen from the lower grain; of a grain's own images, one of the two signs.
        i, j, image = i[rows], j[rows], images[rows]
        backwards = (image[:, 0] < 0) | ((image[:, 0] == 0) & (image[:, 1] < 0))
        flip = (i > j) | ((i == j) & backwards)
        table = np.column_stack([table, np.where(flip[:, None], -image, image)])
    # After sorting, equal rows are adjacent, in the order of the list.
    order = np.lexsort(table.T)
    starts = np.append(True, (np.diff(table[order], axis=0) != 0).any(axis=1))
    earlier = np.empty_like(order)
    earlier[order] = order[starts][np.cumsum(starts) - 1]
    again = np.flatnonzero(earlier != np.arange(len(rows)))
    return rows[again], rows[earlier[again]]


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


Length = int | None


def real(
    name: str, value: ArrayLike, *shape: Length, expected: str = "real numbers", remedy: str = ""
) -> Floats:
    """Return real numbers as a float64 array; `InputError` for others, or another shape.

    A length of None is any.
    """
    remedy = remedy or f"Correct {name}."
    try:
        array = np.asarray(value)
        # Objects are numbers of other libraries; None and text would turn into numbers.
        objects = array.dtype.kind == "O" and all(hasattr(x, "__float__") for x in array.flat)
        if array.dtype.kind not in "biuf" and not objects:
            raise TypeError
        array = array.astype(np.float64, copy=False)
    except (TypeError, ValueError):
        raise InputError(name, short(value), expected, remedy) from None
    if shape and not _is_of(shape, array.shape):
        wanted = f"shape {shape}".replace("None", "n")
        raise InputError(name, f"shape {array.shape}", wanted, remedy)
    return array


def integers(name: str, values: ArrayLike) -> Integers:
    """Return whole numbers as an int64 array, or raise `InputError`."""
    try:
        array = np.asarray(values)
    except ValueError:
        array = np.array(None)
    if array.size and array.dtype.kind not in "iu":
        raise InputError(name, short(values), "integers", "Convert the numbers first.")
    return array.astype(np.int64, copy=False)


def _is_of(shape: tuple[Length, ...], own: tuple[int, ...]) -> bool:
    return len(own) == len(shape) and all(n in (None, m) for n, m in zip(shape, own, strict=True))


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
