"""Arrays of a packing for the kernels, and the tangents of its loops by the kernels."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from loops.arrays import ROUNDING, Flags, Floats, Integers, Regimes, frobenius
from loops.assembly import local_blocks
from loops.closures.macro_tangent import Closure, MacroTangent, Spins, solved
from loops.compiled import given
from loops.compiled.tangents import loop_shapes, tangents_of_faces
from loops.faces import Faces
from loops.graph import ContactState, GrainGraph, branches_between
from loops.laws.protocol import ContactLaw

TANGENTS: tuple[tuple[Closure, Spins], ...] = (
    ("affine", "blocked"),
    ("traction", "blocked"),
    ("traction", "free"),
)
CONTACTS_AT_ONCE = 2**14  # contacts at a time: their temporary arrays stay in the cache


@dataclass(frozen=True, eq=False)
class CompiledPacking:
    """Arrays shared by the kernels, contiguous and read-only.

    `rows` (C, 8): branch vector, tangent block in the frame (n, t) row by row (zero without a law),
    N and T; `shear` (C,) the shear stiffness; `regime` (C,). `by_radii`: whether spins shear by the
    radii (or by the arms to the contact point); None for a law that does neither, which the kernel
    does not treat. `faces`: offsets, grains, contacts and forward of `Faces`.
    """

    graph: GrainGraph
    law: ContactLaw | None
    by_radii: bool | None
    rows: Floats
    shear: Floats
    regime: Regimes
    x: Floats
    radii: Floats
    faces: tuple[Integers, Integers, Integers, Flags]

    def shapes(self, loops: Integers) -> Floats:
        """(L, 11) shape and stress of faces, columns as in `loop_shapes`."""
        return np.asarray(loop_shapes(self.rows, self.x, self.regime, *self.faces, loops))

    def tangents(self, loops: Integers) -> tuple[list[MacroTangent], Flags]:
        """Affine and traction tangents with spins blocked, traction with spins free; poor loops.

        Conditions are estimates, the rest is as by `macroscopic_tangent`. In the poor loops (L,)
        rounding could turn a sign by these conditions: use `macroscopic_tangent` for them.
        """
        matrices, conditions, smallest, sensitivity, area = tangents_of_faces(
            self.rows, self.shear, self.radii, *self.faces, loops, self.by_radii is True
        )
        if self.by_radii is None:
            conditions[2] = np.inf
        rounding = ROUNDING * conditions * frobenius(matrices)
        poor = ~(np.abs(smallest) > rounding)
        # An eigenvalue that the choice of spin arms can turn has no sign, however exact.
        poor[2] &= ~((np.abs(smallest[2]) <= sensitivity) & np.isfinite(conditions[2]))
        change = (0.0, 0.0, sensitivity)
        tangents = [
            solved(matrices[k], *TANGENTS[k], area, conditions[k], sensitivity=change[k])
            for k in range(3)
        ]
        return tangents, poor[1] | poor[2]


def compiled_packing(
    graph: GrainGraph,
    faces: Faces,
    law: ContactLaw | None = None,
    regime: Regimes | None = None,
    threads: int = 1,
) -> CompiledPacking:
    """Prepare a packing, one state, for the kernels; without a law for shapes alone.

    Regimes are the graph's, or read from the state by the law, if left out.
    """
    count = graph.contact_count
    regime = graph.regime if regime is None else regime
    rows, shear = np.zeros((count, 8)), np.zeros(count)
    regimes = np.zeros(count, dtype=np.int8)

    def fill(start: int) -> tuple[bool, bool]:
        part = slice(start, min(start + CONTACTS_AT_ONCE, count))
        images = None if graph.images is None else graph.images[part]
        d = branches_between(graph.x, graph.contacts[part], images, graph.cell)
        rows[part, :2] = d
        if law is None:
            return True, True
        i, j = graph.contacts[part].T
        length = np.hypot(d[:, 0], d[:, 1])
        n = d / length[:, None]
        state = ContactState(
            length=length,
            n=n,
            t=np.column_stack([-n[:, 1], n[:, 0]]),
            normal_force=graph.normal_force[part],
            shear_force=graph.shear_force[part],
            radii_i=graph.radii[i],
            radii_j=graph.radii[j],
        )
        own = law.take(np.arange(part.start, part.stop))
        regimes[part] = own.regime(state) if regime is None else regime[part]
        rows[part, 2:6] = local_blocks(state, own, regimes[part]).reshape(-1, 4)
        rows[part, 6], rows[part, 7] = state.normal_force, state.shear_force
        stiffness = own.local_stiffness(state, regimes[part])
        shear[part] = stiffness[:, 1, 1]
        if np.any(stiffness[:, 0, 1]) or np.any(own.rolling_stiffness(state, regimes[part])):
            return False, False
        _, arm, _ = own.shear_kinematics(state)
        return np.array_equal(arm, state.radii_i), np.array_equal(arm, state.arm_i)

    with ThreadPoolExecutor(threads) as pool:
        ways = np.array(list(pool.map(fill, range(0, count, CONTACTS_AT_ONCE)))).reshape(-1, 2)
    by_radii, by_arms = bool(ways[:, 0].all()), bool(ways[:, 1].all())
    return CompiledPacking(
        graph=graph,
        law=law,
        by_radii=by_radii if by_radii or by_arms else None,
        rows=given(rows, np.float64),
        shear=given(shear, np.float64),
        regime=given(regimes, np.int8),
        x=given(graph.x, np.float64),
        radii=given(graph.radii, np.float64),
        faces=(
            given(faces.offsets, np.int64),
            given(faces.grains, np.int64),
            given(faces.contacts, np.int64),
            given(faces.forward, np.bool_),
        ),
    )
