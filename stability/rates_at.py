"""Rates of a scene under a programme, or under rates of strain and stress."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal, get_args, overload

import numpy as np
from numpy.typing import ArrayLike

from loops import InputError, Support
from loops.arrays import Floats
from loops.closures import Closure, Spins
from loops.closures.system import closure_of
from loops.errors import check_choice, whole_number
from loops.scene import Scene, Subject, of_scene
from loops.system import packing_stress
from loops.validation import real
from stability.complementarity import STARTS
from stability.packing.response import YIELD_BAND, PackingResponse, rate_problem
from stability.paths.regimes import EdgeTrial, Held, rates_of_loop
from stability.paths.supported import SupportedRates, supported_rates
from stability.programmes import NOTHING, MixedControl, Programme, component_control, programme_of
from stability.regimes import Regimes


@overload
def rates_at(scene: Subject, /, programme: Support) -> Regimes[SupportedRates]: ...


@overload
def rates_at(
    scene: Subject,
    /,
    programme: Programme | str | None = None,
    *,
    H: ArrayLike | None = None,
    P: ArrayLike | None = None,
    regime: Held | None = None,
    closure: Closure,
    spins: Spins | None = None,
) -> Regimes[EdgeTrial]: ...


@overload
def rates_at(
    scene: Subject,
    /,
    programme: Programme | str | None = None,
    *,
    H: ArrayLike | None = None,
    P: ArrayLike | None = None,
    regime: Held | None = None,
    closure: Literal["packing"] | None = None,
    yield_band: float | None = None,
    starts: int | None = None,
) -> PackingResponse: ...


@of_scene
def rates_at(
    scene: Scene,
    programme: Programme | str | Support | None = None,
    *,
    H: ArrayLike | None = None,
    P: ArrayLike | None = None,
    regime: Held | None = None,
    closure: Closure | Literal["packing"] | None = None,
    spins: Spins | None = None,
    yield_band: float | None = None,
    starts: int | None = None,
) -> Regimes[EdgeTrial] | PackingResponse | Regimes[SupportedRates]:
    """Rates of one state under a control, contacts at the edge of their law included.

    Contacts at yield stick or slide, touching ones part as well, as the motion decides. Of a loop
    all combinations are tried if there are few. In a packing centres move by `x' = -H' x + u'`,
    `u'` periodic, spins are free, and `K [u', w] = -F_aff(H')` with the contacts' tangents;
    contacts at yield slide where that dissipates: a complementarity problem, condensed on these
    contacts (Theory, equations (11.1) and (11.2)).

    Parameters
    ----------
    scene : Scene or Snapshot
        One state. Without a closure a packing, if it ends at a cell, at walls or at held grains;
        a free one names its closure.
    programme : Programme, str or Support, optional
        Control, or its name; rates are per unit of its loading parameter. Or the held grains of a
        cluster and the motions imposed on them: then each grain that is free balances itself, there
        is no closure, and forces need not be those of the overlaps.
    H, P : (2, 2) array, optional
        In place of a programme: rates of the displacement gradient, of the nominal stress (force
        per length), compression positive. Each component is a number in one of them, not a number
        in the other; one that is left out is zero where the other has none.
    regime : {'elastic', 'sliding'}, optional
        Contacts at the edge all stick, or all slide that may, whether that agrees with their rates
        or not; nothing is searched, and `status` is 'given'.
    closure : {'affine', 'traction', 'packing'}, optional
        How the surrounding medium drives the grains.
    spins : {'blocked', 'affine', 'free'}, optional
        What the spins of a loop do, 'blocked' if left out; those of packings are free.
    yield_band : float, optional
        Of a packing: contacts with `|T|` of at least this share of their strength may slide, 0.99
        if left out; those whose regime says that they slide may as well.
    starts : int, optional
        Of a packing: starts of the search for solutions beyond 12 contacts at yield.

    Returns
    -------
    Regimes or PackingResponse
        Of either `status`, `strain_rate`, `stress_rate` (nominal) and `cauchy_rate`, (2, 2) arrays,
        compression positive. Of a loop `status` is 'unique', 'none', 'several' or 'family' (a line
        of solutions or more), or says what was not tried; of each solution `rates.mode.regime`,
        `rates.rates` of the contacts; of a supported cluster `rates.regime`, `rates.motion`,
        `rates.spin`, `rates.normal_force`, `rates.shear_force`, and no mean rates.

    Raises
    ------
    InputError
        As in `follow`; if the packing floats, a component is given twice or not at all, or the
        boundary has no volume.

    Examples
    --------
    >>> from loops import GrainGraph, LinearFrictional, Scene
    >>> from stability import programmes, rates_at
    >>> x = [[1, 0], [0, 1], [-1, 0], [0, -1]]
    >>> ring = [[0, 1], [1, 2], [2, 3], [3, 0]]
    >>> square = GrainGraph(x=x, radii=[0.5 ** 0.5] * 4, contacts=ring)
    >>> law = LinearFrictional(kn=1.0, kt=0.2, mu=0.1)
    >>> found = rates_at(Scene(square, law), "isotropic_strain", closure="affine")
    >>> found.status, found.taken.rates.mode.regime.tolist()
    ('unique', [1, 1, 1, 1])

    A square lattice of discs in its cell, under uniaxial compression:

    >>> import numpy as np
    >>> lattice = GrainGraph(x=[[0, 0], [1, 0], [0, 1], [1, 1]], radii=[0.5] * 4,
    ...     contacts=[[0, 1], [1, 0], [2, 3], [3, 2], [0, 2], [2, 0], [1, 3], [3, 1]],
    ...     images=[[0, 0], [1, 0], [0, 0], [1, 0], [0, 0], [0, 1], [0, 0], [0, 1]],
    ...     cell=2 * np.eye(2), normal_force=np.full(8, 0.01))
    >>> found = rates_at(Scene(lattice, LinearFrictional(1.0, 0.5, 0.5)), H=[[1, 0], [0, 0]])
    >>> found.status, found.stress_rate.round(9).tolist(), found.cauchy_rate.round(9).tolist()
    ('unique', [[1.0, 0.0], [0.0, 0.0]], [[1.0, 0.0], [0.0, 0.01]])

    A disc on two others, both contacts at yield; one comes nearer. Either contact may slide, and
    any share of the two does:

    >>> from loops import Support
    >>> row = GrainGraph(x=[[0, 0], [0.8, 0.6], [1.6, 0]], radii=[0.5] * 3,
    ...     contacts=[[0, 1], [1, 2]], normal_force=[1e-9] * 2, shear_force=[-1e-10, 1e-10])
    >>> support = Support([True, False, True], [[0, 0, 0], [0, 0, 0], [-1, 0, 0]])
    >>> found = rates_at(Scene(row, law), support)
    >>> found.status, found.families[0].corners.round(3).tolist()
    ('family', [[0.333, 0.0], [0.0, 0.333]])
    """
    if (programme is None) == (H is None and P is None):
        received = "none" if programme is None else "a programme and components"
        raise InputError("control", received, "a programme, or H= and P=", "Give one of them.")
    if regime is not None:
        check_choice("regime", regime, get_args(Held))
    options = {"spins": spins, "yield_band": yield_band, "starts": starts}
    if isinstance(programme, Support):
        _refuse(options | {"closure": closure, "regime": regime}, (), "a support")
        return supported_rates(scene.graph, scene.law, programme)
    closure = closure_of(scene, closure, ("cell", "walls", "outline"))
    of_packing = ("yield_band", "starts")
    _refuse(options, of_packing if closure == "packing" else ("spins",), f"the {closure} closure")
    control: Programme | MixedControl
    control = (
        component_control(*_components(H, P)) if programme is None else programme_of(programme)
    )
    if closure == "packing":
        starts = STARTS if starts is None else whole_number("starts", starts, 0)
        rates = rate_problem(scene, yield_band=YIELD_BAND if yield_band is None else yield_band)
        if isinstance(control, Programme):
            control = control.equations(NOTHING, packing_stress(rates.system).ravel())
        control.require_regular(rates.elastic.tangent)
        if regime is None:
            return rates.solved(control, starts).response
        return rates.given(control, rates.none if regime == "elastic" else ~rates.none)
    spins = spins or "blocked"
    check_choice("spins", spins, get_args(Spins))
    if not isinstance(control, Programme):
        control = Programme("rates", *control)
    return rates_of_loop(scene, control, closure, spins, regime)


def _refuse(options: Mapping[str, object], taken: tuple[str, ...], where: str) -> None:
    """Refuse options that are given and do not belong there."""
    for name, value in options.items():
        if value is not None and name not in taken:
            expected = f"one of {', '.join(taken)}" if taken else "nothing but the support"
            raise InputError(name, f"{value!r} with {where}", expected, "Leave it out.")


def _components(H: ArrayLike | None, P: ArrayLike | None) -> tuple[Floats, Floats]:
    """Return rates of strain and stress, each with numbers where the other has none."""
    strain, stress = (
        None if one is None else real(name, one, 2, 2) for name, one in (("H", H), ("P", P))
    )
    if strain is None:
        assert stress is not None
        strain = np.where(np.isnan(stress), 0.0, np.nan)
    if stress is None:
        stress = np.where(np.isnan(strain), 0.0, np.nan)
    if (twice := ~np.isnan(strain) & ~np.isnan(stress)).any():
        where = ", ".join(f"{i + 1}{j + 1}" for i, j in np.argwhere(twice).tolist())
        remedy = "Give nan in one of them."
        raise InputError("H and P", f"both of {where}", "each component once", remedy)
    return strain, stress
