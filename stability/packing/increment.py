"""A packing over a whole increment of strain, in one solve.

In the rate problem a yield band says beforehand which contacts stand at their strength. Here each
keeps its distance to it: with `w` the distance that a contact has left at the end and `z` what slip
has taken off its shear force,

    w = (strength - |T|) + q + M z,  w >= 0,  z >= 0,  w z = 0,

`q` and `M` those of the rate problem, `q` times the increment. The load is raised from zero, where
nothing slips, and its solution is followed. Where that would turn back to smaller loads the packing
snaps: the contact that softens is kept from sliding, as in a path past an instability, and counted.
Theory, equation (11.24).
"""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
from numpy.typing import ArrayLike

from loops.arrays import Flags, Floats
from loops.assembly import contact_kinematics
from loops.errors import number
from loops.graph import ContactState
from loops.laws.frictional import ContactLaw, Regime, edge_rates
from loops.scene import Scene, of_scene
from loops.system import balancing_forces, relative_motion
from stability.complementarity import positive_definite, raise_load
from stability.packing.response import (
    CONDENSED,
    TRUSTED,
    PackingRates,
    PackingResponse,
    ResponseStatus,
    response_of,
)
from stability.packing.yielding import (
    MixedControl,
    YieldResponse,
    component_control,
    forces_with_slip,
    yield_response,
)

# Share of its strength from which a contact is a candidate for sliding.
CANDIDATES = 0.7
# Over its strength: a contact this far beyond it disagrees.
BEYOND_STRENGTH = 1e-6


class PackingIncrements:
    """The increments of one state, prepared for any number of them."""

    def __init__(self, yielding: YieldResponse) -> None:
        self.rates = PackingRates(nearest_candidates(yielding))
        self.yielding = self.rates.yielding

    def response(self, strain: ArrayLike, stress: ArrayLike | None = None) -> PackingResponse:
        """Answer one increment, see `packing_increment`."""
        return self.solved(component_control(strain, stress))

    def solved(self, control: MixedControl) -> PackingResponse:
        """Answer one control; strain and stress are whole increments."""
        q, M = self.rates.problem(control)
        raised = raise_load(self.yielding.distance, q, M)
        slip = raised.slip
        yielding, elastic, system = self.yielding, self.rates.elastic, self.yielding.system
        stress_of_slip = self.rates.whole.stress_of_slip @ slip
        h = control.strains(elastic.stress, stress_of_slip)
        H = h.reshape(2, 2)
        motion = elastic.motion @ h + self.rates.slips @ slip
        relative = relative_motion(system, motion, H)
        forces = forces_with_slip(yielding, relative, slip)
        size = float(np.linalg.norm(elastic.loads @ h)) or 1.0
        residual = float(np.linalg.norm(balancing_forces(system, forces))) / size
        status: ResponseStatus = "nearest" if raised.held.any() else "one found"
        if status == "one found" and positive_definite(M):
            status = "unique"
        return response_of(
            yielding,
            (H, motion, relative, forces),
            slip > 0,
            status=status if residual <= TRUSTED else "not converged",
            proof="positive definite" if status == "unique" else "",
            residual=residual,
            disagreeing=int(np.count_nonzero(raised.held)),
            stress_rate=(elastic.stress @ h + stress_of_slip).reshape(2, 2),
            settled=yielding.settled,
            solutions=int(status != "nearest"),
            reached=raised.first,
            beyond=int(np.count_nonzero(self._beyond(relative))),
        )

    def _beyond(self, relative: Floats) -> Flags:
        """Return contacts, no candidates, that end beyond their strength (E,)."""
        system = self.yielding.system
        motion = np.zeros((len(system.rows.ends), 4))
        motion[system.kept] = relative / np.array([1.0, 1.0, system.length, system.length])
        (beyond,) = system.rows.each(_beyond_strength, motion)
        beyond = beyond[system.kept] & (system.regime == Regime.ELASTIC)
        beyond[self.yielding.rows] = False
        return np.asarray(beyond)


def _beyond_strength(law: ContactLaw, state: ContactState, motion: Floats) -> tuple[Flags]:
    """Return contacts (C,) that end beyond their strength under motions `r` (C, 4)."""
    un, ut = np.einsum("cij,cj->ic", contact_kinematics(state, law), motion)
    _, shear, grown = edge_rates(law, state, np.sign(state.shear_force), un, ut)
    strength = law.strength(state)
    with np.errstate(invalid="ignore"):
        most = (strength + grown) + BEYOND_STRENGTH * strength
        return (np.abs(state.shear_force + shear) > most,)


def nearest_candidates(yielding: YieldResponse) -> YieldResponse:
    """Return the candidates that one matrix holds; of too many those of smallest distance."""
    count = len(yielding.rows)
    if count <= CONDENSED:
        return yielding
    kept = np.sort(np.argsort(yielding.distance, kind="stable")[:CONDENSED])
    arrays = {
        one.name: getattr(yielding, one.name)[kept]
        for one in fields(yielding)
        if np.shape(getattr(yielding, one.name))[:1] == (count,)
    }
    return replace(yielding, **arrays)


@of_scene
def packing_increment(
    scene: Scene,
    strain: ArrayLike,
    *,
    stress: ArrayLike | None = None,
    candidates: float = CANDIDATES,
) -> PackingResponse:
    """Return the motion of a packing over an increment of strain, in one solve.

    Geometry and stiffness are those of the start. Each contact slides from where it reaches its
    strength, at the cost of one linear complementarity problem. Theory, equation (11.24).

    Parameters
    ----------
    scene : Scene or Snapshot
        The packing, in one state; contacts whose regime says that they slide may slide as well.
    strain : (2, 2) array
        Increment of `H`, compression positive; not a number where the stress is controlled instead.
    stress : (2, 2) array, optional
        Increment of the nominal stress `P` of these components; zero if left out.
    candidates : float
        Contacts with `|T|` of at least this share of their strength may come to slide, 0 to 1.

    Returns
    -------
    PackingResponse
        Increments in place of rates. `status` is 'unique', 'one found' or, where solutions end
        before the whole increment, 'nearest': `disagreeing` contacts that soften, the first one at
        the share `reached`, are kept from sliding and end beyond their strength. `beyond` are
        contacts that end beyond their strength and were no candidates.

    Raises
    ------
    InputError
        If the packing floats, a control is not a number, or the boundary has no volume.

    Examples
    --------
    >>> import numpy as np
    >>> from loops import GrainGraph, LinearFrictional, Scene
    >>> lattice = GrainGraph(x=[[0, 0], [1, 0], [0, 1], [1, 1]], radii=[0.5] * 4,
    ...     contacts=[[0, 1], [1, 0], [2, 3], [3, 2], [0, 2], [2, 0], [1, 3], [3, 1]],
    ...     images=[[0, 0], [1, 0], [0, 0], [1, 0], [0, 0], [0, 1], [0, 0], [0, 1]],
    ...     cell=2 * np.eye(2), normal_force=np.full(8, 0.01))
    >>> scene = Scene(lattice, LinearFrictional(1.0, 0.5, 0.5))
    >>> found = packing_increment(scene, [[1e-3, 0], [0, 0]])
    >>> found.status, found.stress_rate.round(9).tolist()
    ('unique', [[0.001, 0.0], [0.0, 0.0]])
    """
    control = component_control(strain, stress)
    number("candidates", candidates, 0.0, 1.0, open_low=True)
    return PackingIncrements(yield_response(scene, yield_band=candidates)).solved(control)
