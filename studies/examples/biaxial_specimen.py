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
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.sparse.linalg import spsolve

from loops import InputError, LinearFrictional
from loops.arrays import Floats
from patterns import regular_polygon
from stability import Stage
from stability.material import LoopMaterial, march, oriented
from studies.examples import run_example, save
from studies.style import BLUE, GREY, SEQUENTIAL, new_panels, styled

# Elements of the mesh, columns and rows, and size of the specimen.
MESH = 5, 8
WIDTH, HEIGHT = 1.0, 1.6
# Confining pressure, over kn.
CONFINING = 1e-2
# Centre and side of the weak square: one element of the default mesh.
WEAK, WEAK_SIZE = (0.3, 0.9), 0.2
# Axial strain at the end, and steps up to it.
END_STRAIN, STRAIN_STEPS = 0.068, 68
# Share of a step to which it is halved where there is no equilibrium.
SHORTEST = 1.0 / 16.0
# Residual over the first one of a step at which it is solved, and one that is rounding, over kn.
NEWTON_SOLVED, NEWTON_ROUNDING = 1e-9, 1e-13
# Newton steps of a step, at most.
MOST_NEWTON = 12


def law(phi: float) -> LinearFrictional:
    """Return the contact law of a friction angle (degrees)."""
    return LinearFrictional(1.0, 0.5, np.tan(np.radians(phi)))


def weak_elements(mesh: skfem.MeshQuad) -> NDArray[np.intp]:
    """Return the elements with their centre in the weak square, or the nearest one."""
    away = np.abs(mesh.p[:, mesh.t].mean(axis=1) - np.array(WEAK)[:, None]).max(axis=0)
    return np.flatnonzero(away < max(0.5 * WEAK_SIZE, (1.0 + 1e-9) * away.min()))


class Specimen:
    """The mesh, its two materials and the state of their points."""

    def __init__(self, columns: int = MESH[0], rows: int = MESH[1], orientations: int = 36) -> None:
        sides = (
            np.linspace(0.0, end, count + 1) for end, count in ((WIDTH, columns), (HEIGHT, rows))
        )
        mesh = skfem.MeshQuad.init_tensor(*sides)
        element = skfem.ElementVector(skfem.ElementQuad1())
        self.basis = basis = skfem.Basis(mesh, element, intorder=2)
        upright = mesh.facets_satisfying(lambda x: np.abs(x[0] - 0.5 * WIDTH) > 0.4999 * WIDTH)
        # A nominal stress, constant on the sides as they were.
        load = skfem.LinearForm(lambda v, w: -CONFINING * (w.n[0] * v[0] + w.n[1] * v[1]))
        self.load = load.assemble(skfem.FacetBasis(mesh, element, facets=upright, intorder=2))
        self.weak = weak_elements(mesh)
        weak = np.zeros(basis.dx.shape, dtype=bool)
        weak[self.weak] = True
        loops = oriented(regular_polygon(6), orientations)
        self.rows = [np.flatnonzero(weak.ravel() == is_weak) for is_weak in (False, True)]
        self.materials = [LoopMaterial(loops, None, law(phi)) for phi in (30.0, 28.0)]
        pairs = zip(self.materials, self.rows, strict=True)
        self.states = [material.start(len(rows)) for material, rows in pairs]
        self.u = basis.zeros()
        above = mesh.p[1] > HEIGHT - 1e-9
        self.plates = [basis.nodal_dofs[1, mesh.p[1] < 1e-9], basis.nodal_dofs[1, above]]
        fixed = np.concatenate([*self.plates, basis.nodal_dofs[0, mesh.p[1] < 1e-9][:1]])
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
        stiff = skfem.BilinearForm(
            lambda d, v, w: np.einsum("ijkl...,kl...,ij...", A, d.grad, v.grad)
        )
        return stiff.assemble(self.basis), inner.assemble(self.basis), states

    def compress(self, top: float) -> list[float]:
        """Move the upper plate to the displacement `-top`; return the residuals of Newton."""
        u, free, residuals = self.u.copy(), self.free, list[float]()
        step = np.zeros_like(u)
        step[self.plates[1]] = -top - u[self.plates[1]]
        for _ in range(MOST_NEWTON):
            K, inner, states = self.respond(u)
            right = (self.load - inner)[free] - K[free] @ step
            residuals.append(float(np.linalg.norm(right)))
            done = residuals[-1] <= max(NEWTON_SOLVED * residuals[0], NEWTON_ROUNDING)
            if done and len(residuals) > 1:
                self.u, self.states = u, states
                return residuals
            step[free] = spsolve(K[free][:, free].tocsc(), right)
            u, step = u + step, np.zeros_like(u)
        raise ArithmeticError(f"no equilibrium after {MOST_NEWTON} steps")

    def axial(self) -> float:
        """Return the nominal stress of the upper plate, compression positive."""
        return -float(self.respond(self.u)[1][self.plates[1]].sum()) / WIDTH

    def shear_strain(self) -> Floats:
        """Return the largest shear strain of each element, the mean over its points."""
        H = -np.asarray(self.basis.interpolate(self.u).grad)
        shear = np.hypot(0.5 * (H[0, 0] - H[1, 1]), 0.5 * (H[0, 1] + H[1, 0]))
        return np.asarray(2.0 * shear.mean(axis=-1))


def compute(
    end: float = END_STRAIN, steps: int = STRAIN_STEPS, until: float = 0.0, **mesh: Any
) -> dict[str, Any]:
    """Compress a specimen; return its curve, the residuals of its steps and its last state.

    It ends early where the stress ratio is below the share `until` of its largest.
    """
    specimen = Specimen(**mesh)
    confining = Stage("isotropic_stress", "P11", CONFINING)
    rest = march(specimen.materials[0], confining, 10).H[-1, 0]
    specimen.u[specimen.basis.nodal_dofs] = -rest * specimen.basis.mesh.p
    strain, ratio, residuals, why = list[float](), list[float](), list[list[float]](), "finished"
    now, width = -end / steps, end / steps
    while now < (1.0 - 1e-12) * end:
        target = min(now + width, end)
        try:
            residuals.append(specimen.compress((rest + target) * HEIGHT))
        except (ArithmeticError, InputError) as error:
            width *= 0.5
            if width < SHORTEST * end / steps:
                why = f"at strain {target:.4f}: {error}"
                break
            continue
        now = target
        strain.append(now)
        ratio.append(specimen.axial() / CONFINING)
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
    mesh = specimen.basis.mesh
    x = mesh.p + specimen.u[specimen.basis.nodal_dofs]
    shown = three.tripcolor(
        *x, triangles=np.concatenate([mesh.t[[0, 1, 2]].T, mesh.t[[0, 2, 3]].T]),
        facecolors=np.tile(100.0 * specimen.shear_strain(), 2), cmap=SEQUENTIAL,
    )  # fmt: skip
    three.set(aspect="equal", xlabel="$x_1$ (width)", ylabel="$x_2$ (width)")
    figure.colorbar(shown, ax=three, label="largest shear strain (%)")
    return figure


def main(out: Path) -> dict[str, Any]:
    """Compress the specimen, write its curve and its figure, return what it tells."""
    found = compute()
    shear, strain, ratio = found["specimen"].shear_strain(), found["strain"], found["ratio"]
    table = pd.DataFrame({
        "strain": strain,
        "stress_ratio": ratio,
        "newton_steps": [len(residuals) - 1 for residuals in found["residuals"]],
    })  # fmt: skip
    numbers = {
        "status": found["why"],
        "end_strain": float(strain[-1]),
        "peak_ratio": float(ratio.max()),
        "peak_strain": float(strain[ratio.argmax()]),
        "residuals_of_step_10": [float(f"{r:.3g}") for r in found["residuals"][10]],
        "weak_over_median_and_share_of_band": band(found["specimen"]),
        "shear_strain_median": float(np.median(shear)),
        "shear_strain_largest": float(shear.max()),
        "note": "no internal length: the band follows the mesh; a loop alone is not the packing",
    }
    return save(out, "biaxial_specimen", draw(found), numbers, table)


if __name__ == "__main__":
    run_example(main)
