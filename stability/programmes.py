"""Loading programmes: what is controlled, and until when.

Examples
--------
Five grains compressed along axis 1 at constant stress along axis 2:

>>> from loops import LinearFrictional, Scene
>>> from patterns import regular_polygon
>>> from stability import Stage, follow, programmes
>>> stage = Stage(programmes.drained_biaxial(), "H11", 0.15)
>>> scene = Scene(regular_polygon(5, strain=0.1), LinearFrictional(1.0, 0.5))
>>> path = follow(scene, stage, closure="affine")
>>> path.status, round(abs(float(path.P[-1, 3] - path.P[0, 3])), 12)
('finished', 0.0)
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import ArrayLike

from loops.arrays import Floats
from loops.errors import InputError, check_choice, check_type, listed, number, short
from loops.shown import Shown
from loops.validation import finite
from stability.spectra import COMPONENTS, subspace_basis

Axis = Literal[1, 2]
NOTHING = np.zeros(4)
IDENTITY = np.eye(2).ravel()
QUANTITIES = tuple(f"{tensor}{component}" for tensor in "HP" for component in COMPONENTS)
# Entries of the matrix `M` of contacts at yield, one less what the packing gives way, below this
# are rounding (rows: 9e-16).
ROUNDED = 1e-13


class MixedControl(NamedTuple):
    """`stress @ P' + strain @ H' = rate`, four rows of either or of both; 11, 12, 21, 22."""

    stress: Floats
    strain: Floats
    rate: Floats

    def matrix(self, tangent: Floats) -> Floats:
        """Return what the strain rate of a packing with this tangent (4, 4) is multiplied by."""
        return self.stress @ tangent + self.strain

    def require_regular(self, tangent: Floats) -> None:
        """Raise `InputError` where stress rates leave strain rates of this tangent (4, 4) open."""
        rows = self.matrix(tangent)
        rows = rows / np.maximum(np.linalg.norm(rows, axis=1, keepdims=True), 1e-300)
        if np.linalg.cond(rows) > 1.0 / ROUNDED:
            received = "stress rates that do not determine the strain rates"
            raise InputError("P", received, "a sample that is stiff in all directions", "Give H.")

    def strains(self, tangent: Floats, offset: Floats = NOTHING) -> Floats:
        """Return strain rates (4,) at which the stress rate is `tangent @ H' + offset`."""
        right = self.rate - self.stress @ offset
        return np.asarray(np.linalg.solve(self.matrix(tangent), right))


@dataclass(frozen=True, eq=False, repr=False)
class Programme(Shown):
    """Four linear equations between rates, per unit of the loading parameter.

        stress @ P' + strain @ H' = rate

    with the nominal stress `P` and the displacement gradient `H` in the components
    (11, 12, 21, 22), positive in compression.

    Parameters
    ----------
    name : str
        Name in results and messages.
    stress, strain : (4, 4) array
        Coefficients of `P'` and of `H'`, one equation a row.
    rate : (4,) array
        Right-hand side per unit of the loading parameter, not zero.
    isochoric_row : int, optional
        Row whose strain coefficients are replaced by those of `-(det F)' = 0` in the current
        state, `F = I - H`.
    cauchy_row : int, optional
        Row, 0 or 3, of a total Cauchy stress: that of the component 11 or 22, plus the pressure of
        a fluid in the pores. It replaces the row's coefficients in the current state,
        `sigma = P F^T / det F`.
    fluid_bulk_modulus : float
        Bulk modulus `K` of the fluid of the Cauchy row (stress), whose pressure is
        `-K ln det F`; 0 without a fluid.

    Raises
    ------
    InputError
        If a shape is wrong, a number is not finite, the equations depend on each other or nothing
        is driven.

    Examples
    --------
    >>> programme = drained_biaxial()
    >>> programme.strain.diagonal().tolist(), programme.stress[3].tolist(), programme.rate.tolist()
    ([1.0, 1.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0], [1.0, 0.0, 0.0, 0.0])
    """

    unitless = ("stress",)

    name: str
    stress: Floats
    strain: Floats
    rate: Floats
    isochoric_row: int | None = None
    cauchy_row: int | None = None
    fluid_bulk_modulus: float = 0.0

    def __post_init__(self) -> None:
        check_type("name of a programme", self.name, str, "Give a text.")
        where = f"programme {self.name!r}"
        for field, shape in (("stress", (4, 4)), ("strain", (4, 4)), ("rate", (4,))):
            value = finite(f"{field} of the {where}", getattr(self, field), *shape).copy()
            value.setflags(write=False)
            object.__setattr__(self, field, value)
        check_choice(f"isochoric_row of the {where}", self.isochoric_row, (None, 0, 1, 2, 3))
        check_choice(f"cauchy_row of the {where}", self.cauchy_row, (None, 0, 3))
        number("fluid_bulk_modulus", self.fluid_bulk_modulus, 0.0)
        stress, strain, rate = self.equations(NOTHING, NOTHING)
        rank = int(np.linalg.matrix_rank(np.hstack([stress, strain])))
        if rank < 4 or not rate.any():
            raise InputError(
                where,
                f"{rank} independent equations, rate {rate.tolist()}",
                "4 independent equations and a rate that is not zero",
                "Control four independent combinations and drive one of them.",
            )

    def equations(self, H: Floats, P: Floats) -> MixedControl:
        """Return the control of rates at `H` and `P`, (4,) each.

        They are the slopes of `values`.
        """
        if self.isochoric_row is None and self.cauchy_row is None:
            return MixedControl(self.stress, self.strain, self.rate)
        stress, strain = self.stress.copy(), self.strain.copy()
        # (det F)' = cof F : F' and F' = -H'.
        cof = np.array([1.0 - H[3], H[2], H[1], 1.0 - H[0]])
        if self.isochoric_row is not None:
            strain[self.isochoric_row] = cof
        if self.cauchy_row is not None:
            row, area = self.cauchy_row, area_ratio(H)
            # (sigma det F)' = P'.F + P.F' of this row of the tensors.
            own = slice(0, 2) if row == 0 else slice(2, 4)
            stress[row] = 0.0
            stress[row, own] = (IDENTITY - H)[own] / area
            strain[row] = (cauchy(H, P, row) + self.fluid_bulk_modulus) * cof / area
            strain[row, own] -= P[own] / area
        return MixedControl(stress, strain, self.rate)

    def values(self, H: Floats, P: Floats) -> Floats:
        """Return what the equations control, (4,), at `H` and `P`, (4,) each.

        These are `stress @ P + strain @ H`, the loss of area `-det F` in the isochoric row, and the
        total Cauchy stress `sigma - K ln det F` in the Cauchy row.
        """
        values = self.stress @ P + self.strain @ H
        if self.isochoric_row is not None:
            values[self.isochoric_row] = -area_ratio(H)
        if self.cauchy_row is not None:
            pressure = -self.fluid_bulk_modulus * np.log(area_ratio(H))
            values[self.cauchy_row] = cauchy(H, P, self.cauchy_row) + pressure
        return np.asarray(values)

    def driven(self, quantity: str) -> float:
        """Rate of a component that one equation fixes alone, nan if none does."""
        controls = np.hstack([self.strain, self.stress])
        own = controls[:, QUANTITIES.index(quantity)]
        for row in np.flatnonzero(((controls != 0).sum(axis=1) == 1) & (own != 0)):
            if row not in (self.isochoric_row, self.cauchy_row):
                return float(self.rate[row] / own[row])
        return float("nan")


@dataclass(frozen=True, repr=False)
class Stage(Shown):
    """A programme and the value at which it ends.

    Parameters
    ----------
    programme : Programme or str
        Controlled quantities; or the name of one of this module at its unit rate, such as
        'isotropic_strain' or 'drained_biaxial', or as on the command line, 'isotropic', 'drained'.
    quantity : str
        Quantity that ends the stage: a component 'H11', ..., 'P22', or 'parameter', the loading
        parameter counted from the start of the stage.
    target : float
        Its value at the end.
    fallback : bool
        The stage is entered only where the one before it met the limit of its control (or its rate
        problem has no solution), and skipped otherwise.

    Raises
    ------
    InputError
        If the name or the quantity is unknown or the target is not finite.

    Examples
    --------
    >>> Stage(isotropic_strain(), "H11", 0.3).target
    0.3
    >>> Stage("drained_biaxial", "H11", 0.3).programme.name
    'drained biaxial'
    """

    programme: Programme
    quantity: str
    target: float
    fallback: bool = False

    # Names are taken too; what is kept is the programme.
    if TYPE_CHECKING:

        def __init__(
            self, programme: Programme | str, quantity: str, target: float, fallback: bool = False
        ) -> None: ...

    def __post_init__(self) -> None:
        object.__setattr__(self, "programme", programme_of(self.programme))
        check_choice("quantity of a stage", self.quantity, (*QUANTITIES, "parameter"))
        number("target of a stage", self.target)

    def value(self, H: Floats, P: Floats, parameter: float) -> float:
        """Value of the quantity at `H` and `P`, (4,), `parameter` counted from the stage's start.

        Of their rates it is the rate of the quantity.
        """
        if self.quantity == "parameter":
            return parameter
        tensor = H if self.quantity[0] == "H" else P
        return float(tensor[COMPONENTS.index(self.quantity[1:])])

    def away(self, sense: float) -> str:
        """Say why the quantity does not come to its target; empty as far as its rate is not fixed.

        `sense` is the sign of the way that it has to go.
        """
        is_parameter = self.quantity == "parameter"
        rate = 1.0 if is_parameter else self.programme.driven(self.quantity)
        if np.isnan(rate) or rate * sense > 0:
            return ""
        said = f"{self.programme.name} leads away from {self.quantity}'s target"
        return said if is_parameter or rate == 0.0 else f"{said}: reverse it with rate=-1"


def isotropic_strain(rate: float = 1.0) -> Programme:
    """`H11' = H22' = rate`, no shear.

    Examples
    --------
    >>> isotropic_strain().name
    'isotropic strain'
    """
    return _programme("isotropic strain", {"H11": rate, "H12": 0.0, "H21": 0.0, "H22": rate})


def isotropic_stress(rate: float = 1.0) -> Programme:
    """`P11' = P22' = rate`, `H12' = H21' = 0`."""
    return _programme("isotropic stress", {"P11": rate, "H12": 0.0, "H21": 0.0, "P22": rate})


def proportional_strain(H11: float, H22: float) -> Programme:
    """`H11'` and `H22'` in a fixed ratio, no shear.

    Examples
    --------
    >>> proportional_strain(1.0, -0.5).rate.tolist()
    [1.0, 0.0, 0.0, -0.5]
    """
    return _programme("proportional strain", {"H11": H11, "H12": 0.0, "H21": 0.0, "H22": H22})


def proportional_stress(P11: float, P22: float) -> Programme:
    """`P11'` and `P22'` in a fixed ratio, `H12' = H21' = 0`; `(1, 0)` is force control.

    Examples
    --------
    >>> proportional_stress(1.0, 0.0).stress.diagonal().tolist()
    [1.0, 0.0, 0.0, 1.0]
    """
    return _programme("proportional stress", {"P11": P11, "H12": 0.0, "H21": 0.0, "P22": P22})


def drained_biaxial(axis: Axis = 1, rate: float = 1.0) -> Programme:
    """Strain rate along `axis`, constant nominal stress across it, `H12' = H21' = 0` (32).

    The nominal stress is a force over the first length of the side that it acts on: this is a dead
    load. A cell or a membrane that holds the pressure holds the Cauchy stress, the force over the
    length that the side has now (`cauchy_drained`); the two are alike for small strains.

    Examples
    --------
    >>> drained_biaxial(axis=2).stress.diagonal().tolist()
    [1.0, 0.0, 0.0, 0.0]
    """
    along, across = _axes(axis)
    return _programme("drained biaxial", {f"H{along}": rate, "H12": 0, "H21": 0, f"P{across}": 0})


def oedometric(axis: Axis = 1, rate: float = 1.0) -> Programme:
    """Strain rate along `axis`, no other strain."""
    along, across = _axes(axis)
    return _programme("oedometric", {f"H{along}": rate, "H12": 0, "H21": 0, f"H{across}": 0})


def cauchy_drained(axis: Axis = 1, rate: float = 1.0) -> Programme:
    """Strain rate along `axis`, constant Cauchy stress across it, `H12' = H21' = 0`.

    With `sigma = P F^T / det F` and `F` without shear, across axis 1: `sigma22 = P22 / (1 - H11)`,
    so that `P22' + sigma22 H11' = 0`, where `drained_biaxial` has `P22' = 0`.

    Examples
    --------
    >>> import numpy as np
    >>> stress, strain, _ = cauchy_drained().equations(np.zeros(4), np.array([3.0, 0.0, 0.0, 2.0]))
    >>> stress[3].tolist(), strain[3].tolist()
    ([0.0, 0.0, 0.0, 1.0], [2.0, 0.0, 0.0, 0.0])
    """
    _, across = _axes(axis)
    drained = drained_biaxial(axis, rate)
    row = COMPONENTS.index(across)
    return replace(drained, name="Cauchy drained", cauchy_row=row)


def biaxial(axis: Axis = 1, rate: float = 1.0) -> Programme:
    """Biaxial test as DEM codes run it: `cauchy_drained` under the name that it has there.

    One axis of the cell is compressed at a rate, a servo keeps the pressure across it, the force
    over the side's length; the cell stays a rectangle.

    Examples
    --------
    >>> biaxial().cauchy_row, biaxial().name
    (3, 'biaxial')
    """
    return replace(cauchy_drained(axis, rate), name="biaxial")


def undrained(
    axis: Axis = 1, rate: float = 1.0, fluid_bulk_modulus: float = float("inf")
) -> Programme:
    """Strain rate along `axis` while a fluid fills the pores, `H12' = H21' = 0`.

    The total Cauchy stress across stays, that of the grains and the pressure of the fluid,
    `sigma22 - K ln det F` across axis 1. A fluid that can't be compressed (the default) holds the
    area exactly: `tr(F^-1 F') = 0` with `F = I - H`, hence `det F` stays what it was at the start
    of the stage; to first order this is `H11' + H22' = 0`. Without a stiffness, `K = 0`, it is
    `cauchy_drained`.

    Parameters
    ----------
    axis : {1, 2}
        Axis that is driven.
    rate : float
        Its strain rate.
    fluid_bulk_modulus : float
        `K` (stress) by the area of the sample: the fluid's over the porosity where the grains are
        stiff.

    Examples
    --------
    >>> import numpy as np
    >>> undrained().equations(np.array([0.5, 0.0, 0.0, 0.2]), np.zeros(4))[1][3].tolist()
    [0.8, 0.0, 0.0, 0.5]
    >>> undrained(fluid_bulk_modulus=7.0).equations(np.zeros(4), np.zeros(4))[1][3].tolist()
    [7.0, 0.0, 0.0, 7.0]
    """
    if fluid_bulk_modulus != np.inf:
        drained = cauchy_drained(axis, rate)
        return replace(drained, name="undrained", fluid_bulk_modulus=fluid_bulk_modulus)
    along, across = _axes(axis)
    held = _programme("undrained", {f"H{along}": rate, "H12": 0, "H21": 0, f"H{across}": 0})
    return replace(held, isochoric_row=COMPONENTS.index(across))


def simple_shear(axis: Axis = 1, rate: float = 1.0) -> Programme:
    """Shear strain rate along `axis`, no other strain: `H12' = rate` along axis 1, `H21'` along 2.

    Lines along `axis` slide over one another and the area stays, `det(1 - H) = 1`. A positive rate
    moves grains of larger coordinate across to smaller ones along `axis`, and raises `P12`.

    Examples
    --------
    >>> simple_shear(axis=2).rate.tolist()
    [0.0, 0.0, 1.0, 0.0]
    """
    _axes(axis)
    driven = {"H11": 0.0, "H12": 0.0, "H21": 0.0, "H22": 0.0}
    return _programme("simple shear", driven | {f"H{axis}{3 - axis}": rate})


def combination(
    stress: ArrayLike, strain: ArrayLike, rate: ArrayLike, name: str = "combination"
) -> Programme:
    """Any four equations `stress @ P' + strain @ H' = rate`.

    Parameters
    ----------
    stress, strain : (4, 4) array
        Coefficients of `P'` and `H'` in the components (11, 12, 21, 22), one equation a row.
    rate : (4,) array
        Right-hand side per unit of the loading parameter.
    name : str
        Name of the programme.

    Returns
    -------
    Programme

    Raises
    ------
    InputError
        See `Programme`.

    Examples
    --------
    Constant mean stress, driven by the difference of the strains:

    >>> import numpy as np
    >>> shear = np.diag([0.0, 1, 1, 0])
    >>> stress, strain = np.zeros((4, 4)), shear.copy()
    >>> stress[3, [0, 3]], strain[0, [0, 3]] = 1.0, [1.0, -1.0]
    >>> combination(stress, strain, [1, 0, 0, 0], "constant mean stress").name
    'constant mean stress'
    """
    return Programme(name, stress, strain, rate)  # type: ignore[arg-type]


def component_control(strain: ArrayLike, stress: ArrayLike | None = None) -> MixedControl:
    """Return the control of components of `H'` where they are numbers, else of `P'`."""
    H = np.asarray(strain, dtype=float)
    P = np.zeros((2, 2)) if stress is None else np.asarray(stress, dtype=float)
    driven = np.isnan(H)
    if H.shape != (2, 2) or np.isinf(H).any():
        expected = "(2, 2) finite numbers, or nan for stress control"
        remedy = "Give a number for each component that is prescribed, nan for the others."
        raise InputError("strain_rate", f"{H.tolist()}", expected, remedy)
    if P.shape != (2, 2) or not np.isfinite(P[driven]).all():
        expected = "finite numbers of shape (2, 2) where the strain is nan"
        remedy = "Give zero to hold the stress."
        raise InputError("stress_rate", f"{P.tolist()}", expected, remedy)
    by_stress = np.diag(1.0 * driven.ravel())
    return MixedControl(by_stress, np.eye(4) - by_stress, np.where(driven, P, H).ravel())


def direction_control(direction: Floats, subspace: str, driven: str) -> MixedControl:
    """Return the control that drives strain or stress along a direction of a subspace.

    Strain outside of it is zero.
    """
    basis = subspace_basis(subspace)
    m = len(basis)
    # The rest of an orthonormal basis.
    rows = np.vstack([basis, np.linalg.svd(basis)[2][m:]])
    of_stress = np.diag((np.arange(4) < m) * float(driven == "stress"))
    rate = np.append(direction, np.zeros(4 - m))
    return MixedControl(of_stress @ rows, rows - of_stress @ rows, rate)


def area_ratio(H: Floats) -> float:
    """Return `det F`, the area over that of the reference, zero where a loop is a line; H (4,)."""
    return float((1.0 - H[0]) * (1.0 - H[3]) - H[1] * H[2])


def nominal(stress: Floats, H: Floats) -> Floats:
    """Return the nominal stress over the first cell, `det F P F^-T` with `F = 1 - H`."""
    F = np.eye(2) - H
    return np.asarray(np.linalg.det(F) * stress @ np.linalg.inv(F).T)


def cauchy(H: Floats, P: Floats, component: int) -> float:
    """Return the Cauchy stress 11 (component 0) or 22 (3) of nominal stresses `P` (4,) at `H`."""
    own = slice(0, 2) if component == 0 else slice(2, 4)
    return float(P[own] @ (IDENTITY - H)[own]) / area_ratio(H)


def _programme(name: str, controlled: dict[str, float]) -> Programme:
    """Programme that controls one component of `H` or `P` per row, in the order 11 .. 22."""
    stress, strain, rate = np.zeros((4, 4)), np.zeros((4, 4)), np.zeros(4)
    for key, value in controlled.items():
        row = COMPONENTS.index(key[1:])
        (stress if key[0] == "P" else strain)[row, row] = 1.0
        rate[row] = number(key, value)
    return Programme(name, stress, strain, rate)


def _axes(axis: int) -> tuple[str, str]:
    check_choice("axis", axis, get_args(Axis))
    return ("11", "22") if axis == 1 else ("22", "11")


# Programmes that need nothing but their axis and rate, by name; `drained` and `isotropic` as on the
# command line.
BY_NAME: dict[str, Callable[..., Programme]] = {
    make.__name__: make
    for make in (
        isotropic_strain, isotropic_stress, drained_biaxial, cauchy_drained, biaxial, oedometric,
        undrained, simple_shear,
    )
} | {"drained": drained_biaxial, "isotropic": isotropic_strain}  # fmt: skip


def programme_of(given: Programme | str) -> Programme:
    """Return a programme, or that of a name at its unit rate; names of the command are taken too.

    Examples
    --------
    >>> [programme_of(name).name for name in ("simple_shear", "cauchy-drained", "drained")]
    ['simple shear', 'Cauchy drained', 'drained biaxial']
    """
    if isinstance(given, Programme):
        return given
    name = given.replace("-", "_") if isinstance(given, str) else given
    if not isinstance(name, str) or name not in BY_NAME:
        remedy = "Pick one, or give a Programme of stability.programmes."
        raise InputError("programme", short(given), ", ".join(BY_NAME), remedy)
    return BY_NAME[name]()


def stages_of(given: Sequence[Stage] | Stage) -> list[Stage]:
    """Return stages as a list; `InputError` for none, others, or a fallback to begin with."""
    stages = listed("stages", given, Stage, "Write gl.Stage('drained_biaxial', 'H11', 1e-3), say.")
    if stages[0].fallback:
        received, remedy = "a fallback as the first stage", "Give a Stage to start with."
        raise InputError("stages", received, "a stage that is always entered", remedy)
    return stages
