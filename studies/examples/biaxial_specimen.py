"""Does a specimen of averaged hexagons localise, and does Newton's method keep up?

A rectangle of finite elements (scikit-fem), each integration point the mean of 36 hexagons under
the closure traction, is compressed between smooth plates at constant lateral stress. One element is
weak. The consistent tangent gives quadratic convergence as long as no contact changes its regime
in the last steps of Newton's method.

The material has no length of its own, so the band is as wide as an element: it follows the mesh.
And a loop by itself is not the packing: no grain rolls, no contact forms.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import skfem
from matplotlib.figure import Figure

from loops import InputError, LinearFrictional
from loops.arrays import Floats
from patterns import regular_polygon
from stability import Stage
from stability.material import LoopMaterial, march, oriented
from studies.examples import run_example, save
from studies.style import BLUE, SEQUENTIAL, new_panels, styled

WIDTH, HEIGHT = 1.0, 1.6
# Confining pressure, over kn.
CONFINING = 1e-2
# Centre and side of the weak square: one element of the default mesh.
WEAK, WEAK_SIZE = (0.3, 0.9), 0.2
# Share of a step to which it is halved where there is no equilibrium.
SHORTEST = 1.0 / 16.0
# Residual over the first one of a step at which it is solved, and one that is rounding, over kn.
NEWTON_SOLVED, NEWTON_ROUNDING = 1e-9, 1e-13
# Newton steps of a step, at most.
MOST_NEWTON = 12
STIFFNESS = "...ijkl,kl...,ij..."
END, STEP = 0.068, 1e-3


def law(phi: float) -> LinearFrictional:
    """Return the contact law of a friction angle (degrees)."""
    return LinearFrictional(1.0, 0.5, np.tan(np.radians(phi)))


class Specimen:
    """The mesh, its two materials and the state of their points."""

    def __init__(self, columns: int = 5, rows: int = 8, orientations: int = 36) -> None:
        sides = np.linspace(0.0, WIDTH, columns + 1), np.linspace(0.0, HEIGHT, rows + 1)
        mesh = skfem.MeshQuad.init_tensor(*sides)
        element = skfem.ElementVector(skfem.ElementQuad1())
        self.basis = basis = skfem.Basis(mesh, element, intorder=2)
        # A nominal stress, constant on the sides as they were.
        load = skfem.LinearForm(lambda v, w: -CONFINING * w.n[0] * v[0])
        upright = mesh.facets_satisfying(lambda x: np.isin(x[0], (0.0, WIDTH)))
        self.load = load.assemble(skfem.FacetBasis(mesh, element, facets=upright, intorder=2))
        # Elements with their centre in the weak square, or the nearest one.
        away = np.abs(mesh.p[:, mesh.t].mean(axis=1) - np.array(WEAK)[:, None]).max(axis=0)
        self.weak = away < max(0.5 * WEAK_SIZE, (1.0 + 1e-9) * away.min())
        loops = oriented(regular_polygon(6), orientations)
        angles = (30.0, ~self.weak), (28.0, self.weak)
        self.parts = [(LoopMaterial(loops, None, law(phi)), part) for phi, part in angles]
        self.states = [material.start(basis.dx[part].size) for material, part in self.parts]
        confining = Stage("isotropic_stress", "P11", CONFINING)
        self.rest = march(self.parts[0][0], confining, 10).H[-1, 0]
        self.u = basis.zeros()
        self.u[basis.nodal_dofs] = -self.rest * mesh.p
        self.above = basis.nodal_dofs[1, mesh.p[1] == HEIGHT]
        below = basis.nodal_dofs[:, mesh.p[1] == 0.0]
        self.free = basis.complement_dofs(np.array([*self.above, *below[1], below[0, 0]]))

    def respond(self, u: Floats) -> tuple[Any, Floats, list[Any]]:
        """Return tangent matrix, internal forces and new states at the displacements `u`."""
        grad = np.moveaxis(np.asarray(self.basis.interpolate(u).grad), (0, 1), (2, 3))
        P, A, states = np.empty(grad.shape), np.empty((*grad.shape, 2, 2)), list[Any]()
        for (material, part), state in zip(self.parts, self.states, strict=True):
            F = (np.eye(2) + grad[part]).reshape(-1, 2, 2)
            response = material.update(F, state).to_tension_positive()
            P[part] = response.stress.reshape(P[part].shape)
            A[part] = response.tangent.reshape(A[part].shape)
            states.append(response.state)
        inner = skfem.LinearForm(lambda v, w: np.einsum("...ij,ij...", P, v.grad))
        stiff = skfem.BilinearForm(lambda d, v, w: np.einsum(STIFFNESS, A, d.grad, v.grad))
        return stiff.assemble(self.basis), inner.assemble(self.basis), states

    def compress(self, strain: float) -> tuple[float, list[float]]:
        """Compress to an axial strain; return the stress ratio and the residuals of Newton."""
        u, free, residuals = self.u.copy(), self.free, list[float]()
        step = np.zeros_like(u)
        step[self.above] = -(self.rest + strain) * HEIGHT - u[self.above]
        for _ in range(MOST_NEWTON):
            K, inner, states = self.respond(u)
            right = (self.load - inner)[free] - K[free] @ step
            residuals.append(float(np.linalg.norm(right)))
            if residuals[-1] <= max(NEWTON_SOLVED * residuals[0], NEWTON_ROUNDING):
                self.u, self.states = u, states
                return -float(inner[self.above].sum()) / WIDTH / CONFINING, residuals
            step = skfem.solve(*skfem.condense(K, self.load - inner, x=step, I=free))
            u, step = u + step, np.zeros_like(u)
        raise ArithmeticError(f"no equilibrium after {MOST_NEWTON} steps")

    def shear_strain(self) -> Floats:
        """Return the largest shear strain of each element, the mean over its points."""
        H = -np.asarray(self.basis.interpolate(self.u).grad)
        return np.hypot(H[0, 0] - H[1, 1], H[0, 1] + H[1, 0]).mean(axis=-1)


def compressed(specimen: Specimen, step: float, end: float) -> Iterator[tuple[Any, ...]]:
    """Compress by steps of axial strain; yield strain, stress ratio and residuals of each.

    A step without an equilibrium is halved; the shortest one ends the compression.
    """
    reached, target, shortest = 0.0, 0.0, SHORTEST * step
    while step >= shortest and reached < (1.0 - 1e-12) * end:
        try:
            ratio, residuals = specimen.compress(target)
        except (ArithmeticError, InputError):
            step *= 0.5
        else:
            reached = target
            yield reached, ratio, residuals
        target = min(reached + step, end)


def band(specimen: Specimen) -> tuple[float, float]:
    """Return the shear strain of the weak square over the median, and the band's share of the area.

    The band is where the shear strain is above the lower decile by more than half the most.
    """
    shear = specimen.shear_strain()
    excess = shear - np.quantile(shear, 0.1)
    weak = shear[specimen.weak].mean() / np.median(shear)
    return float(weak), float(np.mean(excess > 0.5 * excess.max()))


@styled()
def draw(table: pd.DataFrame, residuals: Sequence[list[float]], specimen: Specimen) -> Figure:
    """Draw the stress ratio, the residuals of three steps, and the band."""
    figure, ((curve, newton, mesh),) = new_panels(1, 3, 2.9)
    curve.plot(100.0 * table["strain"], table["stress_ratio"], color=BLUE)
    curve.set(xlabel="axial strain (%)", ylabel="stress ratio (–)")
    for k in (1, len(residuals) // 2, len(residuals) - 1):
        share = np.array(residuals[k]) / residuals[k][0]
        newton.semilogy(share, "o-", label=f"step {k}", markersize=3)
    newton.set(xlabel="step of Newton's method", ylabel="residual over the first (–)")
    newton.legend()
    flat, dofs = specimen.basis.mesh, specimen.basis.nodal_dofs
    bent = skfem.MeshQuad(flat.p + specimen.u[dofs], flat.t)
    bent.plot(100.0 * specimen.shear_strain(), ax=mesh, cmap=SEQUENTIAL)
    figure.colorbar(mesh.collections[0], ax=mesh, label="largest shear strain (%)")
    mesh.set(aspect="equal", xlabel="$x_1$ (width)", ylabel="$x_2$ (width)")
    return figure


def main(out: Path) -> dict[str, Any]:
    """Compress the specimen, write its curve and its figure, return its peak and its band."""
    specimen = Specimen()
    strain, ratio, residuals = zip(*compressed(specimen, STEP, END), strict=True)
    steps = [len(each) - 1 for each in residuals]
    table = pd.DataFrame({"strain": strain, "stress_ratio": ratio, "newton_steps": steps})
    peak = int(np.argmax(ratio))
    numbers = {"end_strain": strain[-1], "peak_ratio": ratio[peak], "peak_strain": strain[peak]}
    numbers |= {"weak_over_median_and_share_of_band": band(specimen)}
    return save(out, "biaxial_specimen", draw(table, residuals, specimen), numbers, table)


if __name__ == "__main__":
    run_example(main)
