"""Follow a sequence of stages from a grain graph."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Literal, get_args, overload

import numpy as np
from numpy.typing import ArrayLike

from loops import ContactLaw, GrainGraph, InputError, Regime, contact_state
from loops.arrays import Floats
from loops.closures import Closure, Spins
from loops.closures.macro_tangent import check_choice
from loops.laws.protocol import require_law
from stability.arguments import number, whole_number
from stability.paths.edge import EdgeTrial, edge_problem
from stability.paths.model import PathModel, compressed, path_model
from stability.paths.path import ModelOption, Past, Path, PathStatus
from stability.paths.record import Record, model_choice
from stability.paths.stage import walk_stage
from stability.paths.state import initial_state, pack, unpack
from stability.paths.walk import Walk, start_mode
from stability.programmes import Programme, Stage
from stability.rate_problem import RateProblem
from stability.subspaces import subspace_basis

if TYPE_CHECKING:
    from stability.packing.path import PackingPath

# Isotropic strain at which a path starts where its law has no stiffness at first touch.
FIRST_STRAIN = 1e-8
# Absolute tolerance of such a path over that strain, by which its start is off. Loops with free
# spins are all but mechanisms there: rounding of their rates is beyond tighter ones.
FIRST_ATOL = 1e-4
OnTouch = Literal["ignore", "stop", "add"]
# Options of loops, as they stand if left out.
OF_LOOPS: dict[str, Any] = {
    "spins": "blocked",
    "subspace": "diagonal",
    "volume": None,
    "contact_on_touch": "ignore",
    "rtol": 1e-12,
    "atol": 1e-14,
    "max_step": 0.05,
    "model": "auto",
}
# Options of packings.
OF_PACKINGS: dict[str, Any] = {
    **{"interval": 5e-6, "instabilities": 20, "past": "viscous", "progress": None}
}


@overload
def follow(
    graph: GrainGraph,
    law: ContactLaw,
    stages: Sequence[Stage] | Stage,
    *,
    closure: Literal["packing"],
    rows: int = 0,
    max_steps: int = 20_000,
    interval: float = 5e-6,
    instabilities: int = 20,
    past: Past = "viscous",
    progress: Callable[[float], None] | None = None,
) -> PackingPath: ...


@overload
def follow(
    graph: GrainGraph,
    law: ContactLaw,
    stages: Sequence[Stage] | Stage,
    *,
    closure: Closure = "affine",
    spins: Spins = "blocked",
    subspace: str | Sequence[str] = "diagonal",
    volume: ArrayLike | None = None,
    contact_on_touch: OnTouch = "ignore",
    rtol: float = 1e-12,
    atol: float = 1e-14,
    max_step: float = 0.05,
    max_steps: int = 20_000,
    rows: int = 0,
    model: ModelOption = "auto",
) -> Path: ...


def follow(
    graph: GrainGraph,
    law: ContactLaw,
    stages: Sequence[Stage] | Stage,
    *,
    closure: Closure | Literal["packing"] = "affine",
    spins: Spins = "blocked",
    subspace: str | Sequence[str] = "diagonal",
    volume: ArrayLike | None = None,
    contact_on_touch: OnTouch = "ignore",
    rtol: float = 1e-12,
    atol: float = 1e-14,
    max_step: float = 0.05,
    max_steps: int = 20_000,
    rows: int = 0,
    model: ModelOption = "auto",
    interval: float = 5e-6,
    instabilities: int = 20,
    past: Past = "viscous",
    progress: Callable[[float], None] | None = None,
) -> Path | PackingPath:
    """Integrate the rate equations of a graph under loading programmes, with exact events.

    Every contact is elastic, sliding or open (Nicot et al. 2016, equation (8)). The normal force is
    that of the geometry, the shear force of a sliding contact is `s mu N`; the rest is integrated
    by an explicit Runge-Kutta method of order 8 over the length of the path in the space of `H`,
    restarted at every event. Events are located on the dense output and corrected by integrating
    to them again. Where contacts are at the edge of their law, a rate problem decides
    (`stability.rate_problem`).

    Under the `packing` closure the whole of a periodic packing under `LinearFrictional` is
    followed, its spins free: within short intervals of strain the rates are piecewise linear and
    contacts change regime by pivots (Theory, equation (11.10)); geometry and normal forces are
    exact at their ends, so the error halves with the interval. What is out of balance at the start
    stays as a constant load.
    Of the options below it takes `max_steps` (intervals), `rows`, `interval`, `instabilities`,
    `past` and `progress`.

    Spheres that barely touch have no stiffness (Hertz), and no rate problem has an answer there:
    such a path starts at an isotropic strain of 1e-8, and ends that far from the path that starts
    at rest; `atol` is 1e-12 at least.

    Parameters
    ----------
    graph : GrainGraph
        Initial state: a loop (contacts 0..n-1 are the ring, chords may follow); under the affine
        closure also a packing, in a state that is an affine image of its reference.
    law : ContactLaw
        Contact law.
    stages : Stage or sequence of Stage
        Programmes and the values at which they end.
    closure : {'affine', 'traction', 'packing'}
        How the surrounding medium drives the grains.
    spins : {'blocked', 'affine', 'free'}
        What the grains' spins do.
    subspace : {'diagonal', 'symmetric', 'full'}, or several of them
        Where the spectra are taken: `Event.subspace` says which; the first is that of `Path.K`.
    volume : float, optional
        Reference area V0; the cell's or the polygon's if left out. The diamond of Nicot et al.
        2016 uses `L10 L20`, twice its polygon.
    contact_on_touch : {'ignore', 'stop', 'add'}
        What to do where grains without a contact touch: report it and let them overlap (the
        paper), stop, or add the contact, with the parameters of contact 0. Not looked for in
        periodic cells.
    rtol, atol : float
        Tolerances of the integrator; `atol` in natural units of each variable.
    max_step : float
        Longest step in the space of `H`; events are looked for four times a step.
    max_steps : int
        Accepted steps after which the path is given up.
    rows : int
        Rows of each stage, evenly spaced from event to event over its length as judged from its
        start (a strain of one at most), whatever the steps are; 0 for a row at every accepted step.
        Of a packing: evenly spaced in the quantity that ends the stage; 0 for its end alone.
    model : {'auto', 'full'}
        The smallest model that serves: rates in the fields that the symmetry of state and
        programmes leaves, and one contact of an orbit in the branch search; or all unknowns, and a
        search over all contacts. `Path.model` says which. The tangents are full in either, so the
        losses of stability are those of all motions. Motions that break the symmetry are not
        looked for where a symmetric one goes on: 'branching' events tell where they set in, with
        spins that are not free.
    interval : float
        Of a packing: strain of an interval, the norm of the change of `H`.
    instabilities : int
        Of a packing: number of unstable contacts at which the path stops.
    past : {'viscous', 'dynamic', 'stop'}
        Of a packing, the way past an instability, where no regimes of a contact agree: springs on
        the grains of its mode until the interval ends; the equations of motion from there on, over
        the strain of an interval at an inertial number of 2.5e-7, then held until at rest (discs of
        unit density, Cundall's damping of 0.3); or the path stops there, status 'instabilities'.
    progress : callable, optional
        Of a packing: called after every interval with the parameter that the path has reached.

    Returns
    -------
    Path, or PackingPath
        Also where the path ends early: see `Path.status`.

    Raises
    ------
    InputError
        If an option is unknown, the graph does not fit the closure, or its forces do not fit the
        law.

    Examples
    --------
    >>> import numpy as np
    >>> from loops import GrainGraph, LinearFrictional
    >>> from stability import Stage, follow, programmes
    >>> x = np.array([[1.0, 0], [0, 1], [-1, 0], [0, -1]]) * np.sqrt(0.5)
    >>> ring = [[0, 1], [1, 2], [2, 3], [3, 0]]
    >>> square = GrainGraph(x=x, radii=[0.5] * 4, contacts=ring)
    >>> law = LinearFrictional(kn=1.0, kt=0.2, mu=np.tan(np.radians(5)))
    >>> stages = [Stage(programmes.isotropic_strain(), "H11", 0.25),
    ...           Stage(programmes.drained_biaxial(), "H11", 0.4)]
    >>> path = follow(square, law, stages)
    >>> path.status, [event.kind for event in path.events if not event.contacts]
    ('finished', ['det_Ks_zero', 'det_K_zero', 'programme_change'])
    >>> round(float(path.H[path.events[0].index, 0]), 12), path.of_kind("yield")[0].contacts
    (0.166666666667, (0, 1, 2, 3))
    """
    stages = [stages] if isinstance(stages, Stage) else list(stages)
    if closure == "packing":
        given = (spins, subspace, volume, contact_on_touch, rtol, atol, max_step, model)
        _check_stages(stages)
        remedy = "Leave it out: a packing's spins are free, its events those of contacts."
        _refuse(given, OF_LOOPS, "the packing closure", remedy)
        number("interval", interval, 0.0, open_low=True)
        for name, value, least in (
            ("instabilities", instabilities, 1),
            ("max_steps", max_steps, 1),
            ("rows", rows, 0),
        ):
            whole_number(name, value, least)
        check_choice("past", past, get_args(Past))
        from stability.packing.path import follow_packing

        return follow_packing(
            graph,
            law,
            stages,
            rows=rows,
            interval=interval,
            instabilities=instabilities,
            past=past,
            max_steps=max_steps,
            progress=progress,
        )
    _check(law, stages, closure, spins, contact_on_touch)
    remedy = "Leave it out: it is of packings, closure='packing'."
    _refuse(
        (interval, instabilities, past, progress), OF_PACKINGS, f"the {closure} closure", remedy
    )
    number("rtol", rtol, 0.0)
    number("atol", atol, 0.0)
    number("max_step", max_step, 0.0, open_low=True)
    whole_number("max_steps", max_steps, 1)
    whole_number("rows", rows, 0)
    subspaces = (subspace,) if isinstance(subspace, str) else tuple(subspace)
    for each in subspaces:
        subspace_basis(each)
    if not subspaces:
        raise InputError("subspace", "none", "one at least", "Name 'diagonal', say.")
    check_choice("model", model, get_args(ModelOption))
    full = path_model(graph, law, closure, spins, volume)
    full, y, lifted = _first_state(full, graph)
    walk = Walk(
        model=replace(full, search_all=model == "full"),
        y=y,
        mode=start_mode(full, graph),
        record=Record(),
        subspaces=subspaces,
        on_touch=contact_on_touch,
        rtol=rtol,
        atol=max(atol, FIRST_ATOL * FIRST_STRAIN) if lifted else atol,
        max_step=max_step,
        rows=rows,
        steps_left=max_steps,
        programmes=tuple(stage.programme for stage in stages),
        choice=model,
        periodic=graph.cell is not None,
    )
    walk.find_symmetry()
    start = walk.model
    status, message = _walk_all(walk, stages)
    chosen = model_choice(start, model, walk.searches, walk.kept)
    return walk.record.path(walk.model, status, message, subspaces[0], chosen)


def _first_state(model: PathModel, graph: GrainGraph) -> tuple[PathModel, Floats, bool]:
    """The graph's state; where no contact has any stiffness that at a first overlap, its scale.

    Whether it is at a first overlap comes last.
    """
    y = initial_state(model, graph)
    elastic = np.full(graph.contact_count, Regime.ELASTIC, dtype=np.int8)
    stiffness = model.law.local_stiffness(contact_state(graph), elastic)[:, 0, 0]
    if not graph.contact_count or (stiffness > 0.0).any():
        return model, y, False
    state = unpack(model, y)
    if model.closure == "affine":
        place = state.place + FIRST_STRAIN * (np.eye(2).ravel() - state.place)
    else:
        place = state.place - FIRST_STRAIN * (model.x0 + state.place)
    pressed = compressed(contact_state(graph), model.law, 1.0 - FIRST_STRAIN)
    kn = float(model.law.local_stiffness(pressed, elastic)[:, 0, 0].mean())
    # Between the first stiffness, for what is singular, and the later ones, for tolerances.
    model = replace(model, stiffness=float(np.sqrt(kn * model.stiffness)))
    return model, pack(place, state.shear_force, state.parameter, state.work), True


def _walk_all(walk: Walk, stages: Sequence[Stage]) -> tuple[PathStatus, str]:
    status: PathStatus = "finished"
    message = "every stage reached its target"
    for k, stage in enumerate(stages):
        limited = status in ("control_limit", "no_solution")
        if stage.fallback != limited:
            if limited:
                break
            continue
        if walk.record.rows:
            walk.record.event(
                "programme_change", walk.parameter, detail=f"to {stage.programme.name}"
            )
        walk.record.stage = k
        walk.enter(stage.programme)
        status, message = walk_stage(walk, stage)
        if status in ("opposite_contact", "no_load", "lost"):
            break
    return status, message


def _check(law: object, stages: Sequence[Stage], closure: str, spins: str, on_touch: str) -> None:
    require_law(law)
    check_choice("closure", closure, (*get_args(Closure), "packing"))
    check_choice("spins", spins, get_args(Spins))
    check_choice("contact_on_touch", on_touch, get_args(OnTouch))
    _check_stages(stages)


def _refuse(given: Sequence[Any], others: dict[str, Any], closure: str, remedy: str) -> None:
    """Options of other closures, unless they stand as if left out."""
    for value, (name, default) in zip(given, others.items(), strict=True):
        if not np.array_equal(value, default):
            expected = f"nothing but {default!r}"
            raise InputError(name, f"{value!r} with {closure}", expected, remedy)


def _check_stages(stages: Sequence[Stage]) -> None:
    if not stages or stages[0].fallback:
        raise InputError(
            "stages",
            "no stage" if not stages else "a fallback as the first stage",
            "at least one stage to start with",
            "Give a Stage.",
        )


def rates_at(
    graph: GrainGraph,
    law: ContactLaw,
    programme: Programme,
    *,
    closure: Closure = "affine",
    spins: Spins = "blocked",
    volume: ArrayLike | None = None,
) -> RateProblem[EdgeTrial]:
    """Rates of a graph under a programme, contacts at the edge of their law included.

    Contacts at yield stick or slide, touching ones part as well, as the motion decides: all
    combinations are tried if there are few.

    Parameters
    ----------
    graph : GrainGraph
        One state, see `follow`.
    law : ContactLaw
        Contact law.
    programme : Programme
        Control; rates are per unit of its loading parameter.
    closure, spins, volume
        As in `follow`.

    Returns
    -------
    RateProblem
        `status` 'unique', 'none' or 'several'; of each solution `rates.mode.regime`,
        `rates.rates.H` and `rates.rates.P`.

    Raises
    ------
    InputError
        As in `follow`.

    Examples
    --------
    >>> from loops import GrainGraph, LinearFrictional
    >>> from stability import programmes, rates_at
    >>> x = [[1, 0], [0, 1], [-1, 0], [0, -1]]
    >>> ring = [[0, 1], [1, 2], [2, 3], [3, 0]]
    >>> square = GrainGraph(x=x, radii=[0.5 ** 0.5] * 4, contacts=ring)
    >>> law = LinearFrictional(kn=1.0, kt=0.2, mu=0.1)
    >>> found = rates_at(square, law, programmes.isotropic_strain())
    >>> found.status, found.taken.rates.mode.regime.tolist()
    ('unique', [1, 1, 1, 1])
    """
    require_law(law)
    check_choice("closure", closure, get_args(Closure))
    check_choice("spins", spins, get_args(Spins))
    model = path_model(graph, law, closure, spins, volume)
    state = unpack(model, initial_state(model, graph))
    return edge_problem(
        model, state, start_mode(model, graph), programme, preferred={}, direction=None
    )
