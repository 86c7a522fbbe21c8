"""Geometry and forces of contacts, as a contact law needs them."""

from __future__ import annotations

from dataclasses import dataclass

from loops.arrays import Floats, Regimes
from loops.graph import GrainGraph, contact_frame


@dataclass(frozen=True, eq=False)
class ContactState:
    """Geometry and forces of the contacts of a graph, batch axes `...` first.

    Attributes
    ----------
    length : (..., C) array
        Branch length `l` (length).
    n, t : (..., C, 2) array
        Unit normal from grain i to grain j, and the tangent, `n` turned counter-clockwise.
    normal_force, shear_force : (..., C) array
        `N` (compression positive) and `T` (force of grain i on grain j along `t`).
    radii_i, radii_j : (..., C) array
        Radii of the two grains (length).
    regime : (..., C) array of Regime, or None
        Regime of the contacts where the source told it.
    """

    length: Floats
    n: Floats
    t: Floats
    normal_force: Floats
    shear_force: Floats
    radii_i: Floats
    radii_j: Floats
    regime: Regimes | None = None

    @property
    def touching_length(self) -> Floats:
        """(..., C) `r_i + r_j`, the branch length at which the contact opens."""
        return self.radii_i + self.radii_j

    @property
    def overlap(self) -> Floats:
        """(..., C) `r_i + r_j - l`, negative for a gap."""
        return self.touching_length - self.length

    @property
    def arm_i(self) -> Floats:
        """(..., C) lever arm `a_i = r_i - overlap/2` of the contact force about grain i.

        The overlap is shared equally, as Yade, LAMMPS and LIGGGHTS place the contact point;
        `a_i + a_j = l`, and both arms grow at half the rate of `l`.
        """
        return 0.5 * (self.length + self.radii_i - self.radii_j)

    @property
    def arm_j(self) -> Floats:
        """(..., C) lever arm `a_j` of the contact force about grain j, see `arm_i`."""
        return 0.5 * (self.length + self.radii_j - self.radii_i)


def contact_state(graph: GrainGraph) -> ContactState:
    """Contacts of a graph as the contact law sees them.

    Parameters
    ----------
    graph : GrainGraph
        Grain graph, batch axes `...` allowed.

    Returns
    -------
    ContactState
        Lengths, frames, forces and radii, (..., C).

    Examples
    --------
    >>> from loops import GrainGraph, contact_state
    >>> pair = GrainGraph(x=[[0, 0], [0.9, 0]], radii=[0.5, 0.5], contacts=[[0, 1]])
    >>> state = contact_state(pair)
    >>> state.length.tolist(), state.arm_i.round(12).tolist(), state.touching_length.tolist()
    ([0.9], [0.45], [1.0])
    """
    length, n, t = contact_frame(graph)
    i, j = graph.contacts.T
    return ContactState(
        length=length,
        n=n,
        t=t,
        normal_force=graph.normal_force,
        shear_force=graph.shear_force,
        radii_i=graph.radii[..., i],
        radii_j=graph.radii[..., j],
        regime=graph.regime,
    )
