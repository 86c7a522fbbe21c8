"""Does a specimen of averaged hexagons localise, and does Newton's method keep up?

A rectangle of finite elements (scikit-fem), each integration point the mean of 36 hexagons under
the closure traction, is compressed between smooth plates at constant lateral stress. One element is
weak. The consistent tangent gives quadratic convergence as long as no contact changes its regime
in the last steps of Newton's method.

The material has no length of its own, so the band is as wide as an element: it follows the mesh.
And a loop by itself is not the packing: no grain rolls, no contact forms.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import skfem
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from scipy.sparse.linalg import spsolve

from loops import InputError, LinearFrictional
from loops.arrays import Floats
from patterns import regular_polygon
from stability import Stage
from stability.material import LoopMaterial, march, oriented
from studies.examples import run_example, save
from studies.style import BLUE, GREY, SEQUENTIAL, new_panels, styled

WIDTH, HEIGHT = 1.0, 1.6
# Confining pressure, over kn.
CONFINING = 1e-2
# Centre and side of the weak square: one element of the default mesh.
WEAK, WEAK_SIZE = (0.3, 0.9), 0.2
# Share of a step to which it is halved where there is no equilibrium.
SHORTEST = 1.0 / 16.0
# Residual over the first one of a step at which it is solved, and one that is rounding, over kn.
NEWTON_SOLVED, NEWTON_ROUNDING = 1e-9, 1e-13
STIFFNESS = "ijkl...,kl...,ij..."
# Newton steps of a step, at most.
MOST_NEWTON = 12


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
        self.weak = np.flatnonzero(away < max(0.5 * WEAK_SIZE, (1.0 + 1e-9) * away.min()))
        points = np.arange(basis.dx.size).reshape(basis.dx.shape)
        self.rows = [np.delete(points, self.weak, axis=0).ravel(), points[self.weak].ravel()]
        loops = oriented(regular_polygon(6), orientations)
        self.materials = [LoopMaterial(loops, None, law(phi)) for phi in (30.0, 28.0)]
        pairs = zip(self.materials, self.rows, strict=True)
        self.states = [material.start(len(rows)) for material, rows in pairs]
        self.u = basis.zeros()
        below, above = (mesh.p[1] == end for end in (0.0, HEIGHT))
        self.above = basis.nodal_dofs[1, above]
        fixed = [*self.above, *basis.nodal_dofs[1, below], basis.nodal_dofs[0, below][0]]
        self.free = np.setdiff1d(np.arange(len(self.u)), fixed)

    def respond(self, u: Floats) -> tuple[Any, Floats, list[Any]]:
        """Return tangent matrix, internal forces and new states at the displacements `u`."""
        grad = np.asarray(self.basis.interpolate(u).grad)
        F = np.eye(2)[:, :, None, None] + grad
        flat = np.moveaxis(F.reshape(2, 2, -1), -1, 0)
        P, A = np.empty((len(flat), 2, 2)), np.empty((len(flat), 2, 2, 2, 2))
        states = []
        for material, rows, state in zip(self.materials, self.rows, self.states, strict=True):
            response = material.update(flat[rows], state).to_tension_positive()
            P[rows], A[rows] = response.stress, response.tangent
            states.append(response.state)
        P = np.moveaxis(P, 0, -1).reshape(F.shape)
        A = np.moveaxis(A, 0, -1).reshape(2, 2, 2, 2, *F.shape[2:])
        inner = skfem.LinearForm(lambda v, w: np.einsum("ij...,ij...", P, v.grad))
        stiff = skfem.BilinearForm(lambda d, v, w: np.einsum(STIFFNESS, A, d.grad, v.grad))
        return stiff.assemble(self.basis), inner.assemble(self.basis), states

    def compress(self, top: float) -> list[float]:
        """Move the upper plate to the displacement `-top`; return the residuals of Newton."""
        u, free, residuals = self.u.copy(), self.free, list[float]()
        step = np.zeros_like(u)
        step[self.above] = -top - u[self.above]
        for _ in range(MOST_NEWTON):
            K, inner, states = self.respond(u)
            right = (self.load - inner)[free] - K[free] @ step
            residuals.append(float(np.linalg.norm(right)))
            done = residuals[-1] <= max(NEWTON_SOLVED * residuals[0], NEWTON_ROUNDING)
            if done and len(residuals) > 1:
                self.u, self.states, self.push = u, states, -float(inner[self.above].sum())
                return residuals
            step[free] = spsolve(K[free][:, free].tocsc(), right)
            u, step = u + step, np.zeros_like(u)
        raise ArithmeticError(f"no equilibrium after {MOST_NEWTON} steps")

    def shear_strain(self) -> Floats:
        """Return the largest shear strain of each element, the mean over its points."""
        H = -np.asarray(self.basis.interpolate(self.u).grad)
        shear = np.hypot(0.5 * (H[0, 0] - H[1, 1]), 0.5 * (H[0, 1] + H[1, 0]))
        return np.asarray(2.0 * shear.mean(axis=-1))


def compute(end: float = 0.068, steps: int = 68, until: float = 0.0, **mesh: int) -> dict[str, Any]:
    """Compress a specimen to an axial strain; return its curve, residuals and last state.

    It ends early where the stress ratio is below the share `until` of its largest.
    """
    specimen = Specimen(**mesh)
    confining = Stage("isotropic_stress", "P11", CONFINING)
    rest = march(specimen.materials[0], confining, 10).H[-1, 0]
    specimen.u[specimen.basis.nodal_dofs] = -rest * specimen.basis.mesh.p
    strain, ratio, residuals, why = list[float](), list[float](), list[list[float]](), "finished"
    width, target = end / steps, 0.0
    while not strain or strain[-1] < (1.0 - 1e-12) * end:
        try:
            residuals.append(specimen.compress((rest + target) * HEIGHT))
            strain.append(target)
        except (ArithmeticError, InputError) as error:
            width *= 0.5
            if width < SHORTEST * end / steps:
                why = f"at strain {target:.4f}: {error}"
                break
            target = strain[-1] + width
            continue
        target = min(target + width, end)
        ratio.append(specimen.push / WIDTH / CONFINING)
        if ratio[-1] < until * max(ratio):
            why = f"at {until:g} of the peak"
            break
    return {"specimen": specimen, "strain": np.array(strain), "ratio": np.array(ratio),
            "residuals": residuals, "why": why}  # fmt: skip


def band(specimen: Specimen) -> tuple[float, float]:
    """Return the shear strain of the weak square over the median, and the band's share of the area.

    The band is where the shear strain is above the lower decile by more than half the most.
    """
    shear = specimen.shear_strain()
    excess = shear - np.quantile(shear, 0.1)
    share = float(np.mean(excess > 0.5 * excess.max()))
    return float(shear[specimen.weak].mean() / np.median(shear)), share


@styled()
def draw(found: dict[str, Any]) -> Figure:
    """Draw the stress ratio, the residuals of three steps, and the band."""
    figure, ((one, two, three),) = new_panels(1, 3, 2.9)
    one.plot(100.0 * found["strain"], found["ratio"], color=BLUE)
    one.set(xlabel="axial strain (%)", ylabel="stress ratio (–)")
    for k in (1, len(found["residuals"]) // 2, len(found["residuals"]) - 1):
        residuals = np.array(found["residuals"][k])
        two.semilogy(residuals / residuals[0], "o-", label=f"step {k}", markersize=3)
    two.axhline(NEWTON_SOLVED, color=GREY, linewidth=0.6)
    two.set(xlabel="step of Newton's method", ylabel="residual over the first (–)")
    two.legend()
    specimen = found["specimen"]
    mesh, dofs = specimen.basis.mesh, specimen.basis.nodal_dofs
    corners = (mesh.p + specimen.u[dofs])[:, mesh.t].T
    shear = 100.0 * specimen.shear_strain()
    shown = three.add_collection(PolyCollection(corners, array=shear, cmap=SEQUENTIAL))
    three.autoscale()
    three.set(aspect="equal", xlabel="$x_1$ (width)", ylabel="$x_2$ (width)")
    figure.colorbar(shown, ax=three, label="largest shear strain (%)")
    return figure


def main(out: Path) -> dict[str, Any]:
    """Compress the specimen, write its curve and its figure, return what it tells."""
    found = compute()
    shear, strain, ratio = found["specimen"].shear_strain(), found["strain"], found["ratio"]
    steps = [len(residuals) - 1 for residuals in found["residuals"]]
    table = pd.DataFrame({"strain": strain, "stress_ratio": ratio, "newton_steps": steps})
    numbers = {
        "status": found["why"],
        "end_strain": float(strain[-1]),
        "peak_ratio": float(ratio.max()),
        "peak_strain": float(strain[ratio.argmax()]),
        "weak_over_median_and_share_of_band": band(found["specimen"]),
        "shear_strain_median": float(np.median(shear)),
        "shear_strain_largest": float(shear.max()),
    }
    return save(out, "biaxial_specimen", draw(found), numbers, table)


if __name__ == "__main__":
    run_example(main)
