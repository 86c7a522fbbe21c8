"""A packing brought to rest by damped equations of motion before it is asked for its rates."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from loops.arrays import Floats, Integers
from loops.boundary import Boundary, PlaneContacts, boundary_of
from loops.contacts import Contacts, contacts_at_start, start_state
from loops.errors import InputError, check_choice, counted, number, whole_number
from loops.graph import GrainGraph, contact_state
from loops.laws.frictional import FrictionalLaw, Regime
from loops.laws.of_pairs import law_of
from loops.scene import Scene, of_scene
from loops.shown import Shown
from loops.validation import finite
from stability.packing.equations_of_motion import (
    Moving,
    lasting,
    masses_of,
    servo_of,
    steered,
    step_of,
)

HoldControl = Literal["strain", "stress"]
HoldStatus = Literal["at rest", "not at rest", "flows"]

# Steps between two looks at the unbalanced force.
LOOK = 500
# A sample whose cell strains by more under a held stress flows.
FLOWS = 0.05
# Lag of the servo over that of the answer, in the run that tells what its strain hangs on: by 9 to
# 26 % on four real states; at a third of the lag by 1 to 6 %, at nine times it up to twenty-fold.
SLOWER = 3.0
# Stresses 11, 22 and the mean shear stress are held; the cell does not rotate.
HELD_STRESS = np.array([[1, 0, 0, 0], [0, 0, 0, 1], [0, 0.5, 0.5, 0], [0, 0, 0, 0.0]])
NO_ROTATION = np.array([[0] * 4, [0] * 4, [0] * 4, [0, 1, -1, 0.0]])
# Contacts within this share of their strength count as sliding, as in the tables of Yade.
SLIDING_SHARE = 0.999


@dataclass(frozen=True, eq=False, repr=False)
class HeldPacking(Shown):
    """A packing at rest, and what holding it changed.

    Attributes
    ----------
    graph : GrainGraph
        The closed contacts at rest.
    law : FrictionalLaw or RollingResistance
        Stiffness and friction of these contacts.
    boundary : Boundary
        Its cell, or the contacts with walls at rest and their forces.
    ids : (G,) array of int
        Ids of the grains, those of the scene that was held.
    status : {'at rest', 'not at rest', 'flows'}
        Whether the unbalanced force fell below the bound; `flows`: under a held stress the cell
        strained by more than 0.05, or no contact was left.
    other_status : {'at rest', 'not at rest', 'flows'}
        The same of the run with the other damping. Only where one run alone comes to rest do the
        two differ in this: rounding then decides where the avalanche ends.
    damping : float
        Cundall's damping of the run that all other numbers are of: the first one, or the one that
        comes to rest.
    control : {'strain', 'stress'}
        What was held.
    unbalanced_before, unbalanced : float
        Mean resultant on a grain over the mean contact force, before and after.
    stress_before, stress : (2, 2) array
        Cauchy stress (force per length, compression positive).
    strain : (2, 2) array
        Displacement gradient `H` of the cell, compression positive; zero if it was held.
    forces_changed : float
        `|f_after - f_before| / |f_before|` over all contacts, lost and gained ones included.
    lost, gained : int
        Contacts between grains that opened, and that closed.
    sliding_before, sliding : int
        Contacts within a thousandth of their strength.
    spread : float
        Difference of the stress at rest between the two dampings over its size. Beyond a few
        percent the state at rest is one of many: what follows is about this one alone.
    strain_spread : float
        Largest difference of the strain at rest over its size: to the run with the other damping,
        and to one whose servo lags three times as long. A stress is reached on many ways, and
        each leaves a strain of its own. Zero where the strain is held.
    steps : int
        Steps of the run with this damping.
    """

    shown = ("status", "control", "unbalanced_before", "unbalanced", "stress", "strain", "steps")

    graph: GrainGraph
    law: FrictionalLaw
    boundary: Boundary
    ids: Integers
    status: HoldStatus
    damping: float
    control: HoldControl
    unbalanced_before: float
    unbalanced: float
    stress_before: Floats
    stress: Floats
    strain: Floats
    forces_changed: float
    lost: int
    gained: int
    sliding_before: int
    sliding: int
    steps: int
    other_status: HoldStatus = "at rest"
    spread: float = 0.0
    strain_spread: float = 0.0

    @cached_property
    def scene(self) -> Scene:
        """Return the packing at rest; contacts within a thousandth of their strength slide."""
        limit = SLIDING_SHARE * self.law.strength(contact_state(self.graph))
        slides = np.abs(self.graph.shear_force) >= limit
        regime = np.where(slides, Regime.SLIDING, Regime.ELASTIC).astype(np.int8)
        return Scene(self.graph.replace(regime=regime), self.law, self.boundary, self.ids)

    @property
    def place(self) -> str:
        """Say what was held: the walls, the cell or the stress."""
        cell = "at fixed cell" if self.boundary.kind == "cell" else "between its walls"
        return cell if self.control == "strain" else "at fixed stress"

    def __str__(self) -> str:
        before, after = (np.diag(s) for s in (self.stress_before, self.stress))
        other = "" if self.other_status == self.status else f" (other damping: {self.other_status})"
        strain = ""
        if self.control == "stress":
            size = np.linalg.norm(self.strain)
            strain = f", strain {size:.2g}, spread {100 * self.strain_spread:.2g} %"
        return (
            f"held {self.place}: {self.status} "
            f"with damping {self.damping:g}{other}, unbalanced force "
            f"{self.unbalanced_before:.1e} to {self.unbalanced:.1e}, stress "
            f"({before[0]:.4g}, {before[1]:.4g}) to ({after[0]:.4g}, {after[1]:.4g}), spread "
            f"{100 * self.spread:.2g} %{strain}, "
            f"{counted(self.lost, 'contact')} lost, {self.gained} gained"
        )


@of_scene
def hold(
    scene: Scene,
    control: HoldControl = "strain",
    *,
    unbalanced: float = 1e-6,
    damping: tuple[float, float] = (0.2, 0.4),
    mass: ArrayLike | None = None,
    inertia: ArrayLike | None = None,
    velocity: ArrayLike | None = None,
    spin: ArrayLike | None = None,
    most_steps: int = 200_000,
) -> HeldPacking:
    """Bring a packing to rest by damped equations of motion.

    A state with an unbalanced force above some 5e-4 is on its way: its rates are not those of an
    equilibrium. It is held at fixed cell, or between walls that stand still, or at fixed stress,
    with Cundall's damping until the unbalanced force is below the bound. A second run with the
    other damping tells how far the state at rest depends on the way there; under a held stress a
    third one, with a slower servo, how far its strain does. Theory, equations (11.14) and (11.18).

    Parameters
    ----------
    scene : Scene or Snapshot
        One state, periodic or between walls in any direction: one contact at least with each wall,
        and the volume between them (`boundary_of`); forces of rough walls are no function of the
        positions. Grains that touch a wall later have its mean stiffness over the radius, or its
        mean stiffness where that varies less. A contact with a wall without `mu` does not slide.
        The law is linear, Hertz and Mindlin's, or one of your own; with rolling springs between
        grains, whose moments start from the graph's.
    control : {'strain', 'stress'}
        What is held: the cell or the walls; or the stress of a periodic cell (11, 22 and the mean
        of 12 and 21).
    unbalanced : float
        The bound: mean resultant on a grain over the mean contact force.
    damping : (float, float)
        Cundall's damping of the two runs, each between 0 and 1. The first one is the answer, or
        the second where it alone comes to rest.
    mass, inertia, velocity, spin
        As in `replay`.
    most_steps : int
        Steps after which a run ends although it is not at rest.

    Returns
    -------
    HeldPacking

    Raises
    ------
    InputError
        If the law is another, the packing ends neither at a cell nor at walls or carries nothing,
        stress is to be held between walls, or a number is out of its range.

    Examples
    --------
    >>> import numpy as np
    >>> from loops import GrainGraph, LinearFrictional, Scene
    >>> row = GrainGraph(x=[[0, 0], [1.002, 0]], radii=[0.505] * 2, contacts=[[0, 1], [1, 0]],
    ...     images=[[0, 0], [1, 0]], cell=[[2, 0], [0, 3]], normal_force=[0.008, 0.012])
    >>> held = hold(Scene(row, LinearFrictional(1.0, 0.5, 0.5)))
    >>> held.status, held.graph.normal_force.round(6).tolist()
    ('at rest', [0.01, 0.01])
    """
    check_choice("control", control, get_args(HoldControl))
    number("unbalanced", unbalanced, 0.0, open_low=True)
    for share in finite("damping", damping, 2):
        number("damping", share, 0.0, 1.0, open_low=True, open_high=True)
    whole_number("most_steps", most_steps, 1)
    around = scene.boundary
    if around.kind == "walls" and (control == "stress" or around.volume is None):
        received = "control='stress'" if control == "stress" else "no volume"
        expected = "control='strain' and a volume between walls"
        raise InputError("hold", received, expected, "Hold the walls, and give the area.")
    start = contacts_at_start(scene, still=True)
    masses, inertias = masses_of(scene.graph.radii, mass, inertia)
    dt = step_of(masses, inertias, start)
    if not np.linalg.norm(start.forces[start.closed]) > 0:
        expected, remedy = "contacts that carry force", "Take a state with forces, or overlaps."
        raise InputError("hold", "no contact force", expected, remedy)

    def run(share: float, slower: float = 1.0) -> HeldPacking:
        servo = servo_of(start, masses)
        if control == "stress":
            servo = servo._replace(lag=slower * servo.lag)
            servo = steered(servo, start, HELD_STRESS, NO_ROTATION, np.zeros(4))
            servo = lasting(servo, dt)
        moving = Moving(start, masses, inertias, servo, velocity=velocity, spin=spin)
        before = moving.unbalanced(start)
        end, status, steps = _rest(moving, dt, share, unbalanced, most_steps)
        return HeldPacking(
            **_changes(scene, start, end),
            status=status,
            damping=share,
            control=control,
            unbalanced_before=before,
            unbalanced=moving.unbalanced(end),
            steps=steps,
        )

    # A run at rest comes first.
    held, other = sorted(map(run, damping), key=lambda one: one.status != "at rest")
    ways = [other, run(held.damping, SLOWER)] if control == "stress" else []
    apart = max((float(np.linalg.norm(way.strain - held.strain)) for way in ways), default=0.0)
    size, change = float(np.linalg.norm(held.stress)), np.linalg.norm(other.stress - held.stress)
    return replace(
        held,
        other_status=other.status,
        spread=float(change) / size if size > 0 else np.inf,
        strain_spread=apart / float(np.linalg.norm(held.strain)) if apart > 0 else 0.0,
    )


def _changes(scene: Scene, start: Contacts, end: Contacts) -> dict[str, Any]:
    """Return the packing at the end of a run, and what the run changed, as `HeldPacking`."""
    # Contacts between grains.
    first, last = start.closed & ~start.at_wall, end.closed & ~end.at_wall
    change = end.forces.copy()
    change[: len(first)] -= start.forces
    kept = int(np.count_nonzero(first & last[: len(first)]))
    at_rest, around = end.graph(), dict[str, Any]()
    if scene.boundary.kind == "walls":
        touching = end.closed & end.at_wall
        kn, kt = (k[touching] for k in end.law.stiffnesses(end.overlap))
        grain, mu = end.contacts[touching, 0], end.law.mu[touching]
        walls = PlaneContacts(grain, end.branches[touching], kn, kt, mu, -end.forces[touching])
        around = {"walls": walls, "volume": scene.boundary.volume}
    return {
        "graph": at_rest,
        "law": law_of(scene.law, end.law, last),
        "boundary": boundary_of(at_rest, **around),
        "ids": scene.ids,
        "stress_before": _stress(start),
        "stress": _stress(end),
        "strain": end.strain,
        "forces_changed": float(np.linalg.norm(change) / np.linalg.norm(start.forces)),
        "lost": int(np.count_nonzero(first)) - kept,
        "gained": int(np.count_nonzero(last)) - kept,
        "sliding_before": _sliding(start),
        "sliding": _sliding(end),
    }


def unbalanced_force(graph: GrainGraph, boundary: Boundary) -> float:
    """Return the mean resultant on a grain over the mean contact force, forces as they stand."""
    return start_state(graph, replace(boundary, volume=1.0), still=True).unbalanced


def _stress(state: Contacts) -> Floats:
    """Return the stress of Love and Weber, contacts with walls of any direction included."""
    return np.asarray(state.forces.T @ state.branches / abs(np.linalg.det(state.cell)))


def _rest(
    moving: Moving, dt: float, damping: float, bound: float, most_steps: int
) -> tuple[Contacts, HoldStatus, int]:
    """Return the state where a run ends, why it ended, and its steps."""
    steps = 0
    while True:
        ran = moving.run(LOOK, dt, damping)
        steps += LOOK
        state = moving.state()
        if not ran or not np.isfinite(state.x).all():
            found = f"grains that move {moving.gap:.2g} in one step"
            raise InputError("hold", found, "a stable motion", "Check masses and stiffness.")
        # Without any force left there is nothing to be in balance with.
        if not state.closed.any() or np.linalg.norm(state.strain) > FLOWS:
            return state, "flows", steps
        if moving.unbalanced(state) <= bound:
            return state, "at rest", steps
        if steps >= most_steps:
            return state, "not at rest", steps


def _sliding(state: Contacts) -> int:
    return int(np.count_nonzero(state.at_limit(SLIDING_SHARE) & ~state.at_wall))
