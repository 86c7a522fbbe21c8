"""Follow a loop or a packing through a sequence of stages."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields
from typing import Any, Literal

from loops import InputError
from loops.closures import Closure
from loops.closures.system import closure_of
from loops.errors import whole_number
from loops.scene import Scene, of_scene
from stability.path import Path
from stability.paths.loop_path import LoopPathOptions, follow_loop
from stability.programmes import Stage, stages_of


@of_scene
def follow(
    scene: Scene,
    stages: Sequence[Stage] | Stage,
    *,
    closure: Closure | Literal["packing"] | None = None,
    rows: int = 0,
    max_steps: int = 20_000,
    **options: Any,
) -> Path:
    """Integrate the rate equations of a graph under loading programmes, with exact events.

    Every contact is elastic, sliding or open (Nicot et al. 2016, equation (8)). The normal force is
    that of the geometry, the shear force of a sliding contact is `s mu N`; the rest is integrated
    by an explicit Runge-Kutta method of order 8 over the length of the path in the space of `H`,
    restarted at every event. Events are located on the dense output and corrected by integrating
    to them again. Where contacts are at the edge of their law, a rate problem decides
    (`stability.regimes`).

    Under the `packing` closure the whole of a packing under `LinearFrictional` is followed,
    periodic or between walls, its spins free: within short intervals of strain the rates are
    piecewise linear and contacts change regime by pivots (Theory, equation (11.10)); geometry and
    normal forces are exact at their ends, so the error halves with the interval. What is out of
    balance at the start is balanced by a load, of which `load_kept` stays.
    Of the options below it takes `max_steps` (intervals), `rows`, `interval`, `instabilities`,
    `past`, `load_kept`, `spread`, `progress` and `pathologies`.

    Spheres that barely touch have no stiffness (Hertz), and no rate problem has an answer there:
    such a path starts at an isotropic strain of 1e-8, and ends that far from the path that starts
    at rest, to 1e-12 in natural units.

    Parameters
    ----------
    scene : Scene or Snapshot
        Initial state: a loop (contacts 0..n-1 are the ring, chords may follow); under the affine
        closure also a packing, in a state that is an affine image of its reference; or a packing
        in a cell or between four walls along the axes (`boundary_of`), with their forces where
        walls are rough. Walls move with the strain of the box and keep their directions
        (`H12 = H21 = 0`); grains that touch a wall later have its mean stiffness over the radius,
        or its mean stiffness where that varies less. The volume of the boundary is the reference
        area V0 of a loop; the cell's or the polygon's if it has none. The diamond of Nicot et al.
        2016 uses `L10 L20`, twice its polygon.
    stages : Stage or sequence of Stage
        Programmes and the values at which they end.
    closure : {'affine', 'traction', 'packing'}
        How the surrounding medium drives the grains. A scene in a cell or between walls is followed
        as a packing if it is left out; a free one names its closure.
    spins : {'blocked', 'affine', 'free'}
        What the grains' spins do.
    subspace : {'diagonal', 'symmetric', 'full'}, or several of them
        Where the spectra are taken: `Event.subspace` names it; the first is that of `Path.K`.
    contact_on_touch : {'ignore', 'stop', 'add'}
        What to do where grains without a contact touch: report it and let them overlap (the
        paper), stop, or add the contact, with the parameters of contact 0. Not looked for in
        periodic cells.
    max_steps : int
        Accepted steps after which the path is given up.
    rows : int
        Rows of each stage, evenly spaced from event to event over its length as judged from its
        start (a strain of one at most), whatever the steps are; 0 for a row at every accepted step.
        Of a packing: evenly spaced in the quantity that ends the stage; 0 for its end alone.
    model : {'auto', 'full'}
        The smallest model that serves: rates in the fields that the symmetry of state and
        programmes leaves, and one contact of an orbit in the branch search; or all unknowns, and a
        search over all contacts. `Path.model` describes it. The tangents are full in either, so the
        losses of stability are those of all motions. Motions that break the symmetry are not
        looked for where a symmetric one goes on: 'branching' events mark where they set in, with
        spins that are not free.
    interval : float
        Of a packing: strain of an interval, the norm of the change of `H`.
    instabilities : int
        Of a packing: number of unstable contacts at which the path stops.
    past : {'viscous', 'dynamic', 'stop'}
        Of a packing, how the path continues where no regime of a contact is consistent: springs on
        the grains of its mode until the interval ends; the equations of motion from there on, over
        the strain of an interval at an inertial number of 2.5e-7, then held until at rest (discs of
        unit density, Cundall's damping of 0.3); or the path stops there, status 'instabilities'.
    load_kept : float
        Of a packing that is out of balance at the start: share of the load that balances it that
        stays; the rest decreases to zero over the first strain of 1e-5. 1 for a sample that goes on
        at its rate, 0 for the limit of slow loading from this state.
    spread : bool
        Of a packing: whether to follow it a second time if it meets an instability, with springs
        three times as stiff ('viscous') or a third of the damping ('dynamic'): the stress behind an
        instability is that of one of several ways on, and `Path.stress_spread` says how far they
        part.
    progress : callable, optional
        Of a packing: called after every interval with the parameter that the path has reached.
    pathologies : bool
        Of a packing: look at every row whether the rates are the only ones and stable
        (`Path.pathologies`).

    Returns
    -------
    Path
        Also where the path ends early: see `Path.status`.

    Raises
    ------
    InputError
        If an option is unknown, the scene does not fit the closure, a free one names none, or its
        forces do not fit the law.

    Examples
    --------
    >>> import numpy as np
    >>> from loops import GrainGraph, LinearFrictional, Scene
    >>> from stability import Stage, follow, programmes
    >>> x = np.array([[1.0, 0], [0, 1], [-1, 0], [0, -1]]) * np.sqrt(0.5)
    >>> ring = [[0, 1], [1, 2], [2, 3], [3, 0]]
    >>> square = GrainGraph(x=x, radii=[0.5] * 4, contacts=ring)
    >>> law = LinearFrictional(kn=1.0, kt=0.2, mu=np.tan(np.radians(5)))
    >>> stages = [Stage(programmes.isotropic_strain(), "H11", 0.25),
    ...           Stage(programmes.drained_biaxial(), "H11", 0.4)]
    >>> path = follow(Scene(square, law), stages, closure="affine")
    >>> path.status, [event.kind for event in path.events if not event.contacts]
    ('finished', ['det_Ks_zero', 'det_K_zero', 'programme_change'])
    >>> round(float(path.H[path.events[0].index, 0]), 12), path.of_kind("yield")[0].contacts
    (0.166666666667, (0, 1, 2, 3))
    """
    stages = stages_of(stages)
    closure = closure_of(scene, closure, ("cell", "walls"))
    whole_number("max_steps", max_steps, 1)
    whole_number("rows", rows, 0)
    taken: Any = LoopPathOptions
    if closure == "packing":
        from stability.packing.path import PackingPathOptions, follow_packing

        taken = PackingPathOptions
    names = [field.name for field in fields(taken)]
    for name in (one for one in options if one not in names):
        received = f"{options[name]!r} with the {closure} closure"
        raise InputError(name, received, f"one of {', '.join(names)}", "Leave it out.")
    chosen = taken(**options)
    if closure == "packing":
        return follow_packing(scene, stages, chosen, rows=rows, max_steps=max_steps)
    return follow_loop(scene, stages, closure, chosen, rows=rows, max_steps=max_steps)
