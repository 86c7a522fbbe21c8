"""One loop at a time or many at once; single or double precision; compiled or plain."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from loops import GrainGraph, macroscopic_tangent
from loops.arrays import Floats
from patterns.hard_cases import hard_case
from stability import restrict, symmetric_spectrum
from stability.loop_stability import loop_stability
from studies.bench.hard_cases import exact_answer
from studies.bench.measure import Rows
from studies.bench.rings import Rings, random_rings

CLOSURES = ("affine", "traction")
SIZES = (1, 10, 100, 1000, 10_000)
OVERLAPS = (1e-1, 1e-3, 1e-5, 1e-7)


def batch_sizes(quick: bool) -> Rows:
    """Time per hexagon over the size of the batch, with the error against 50 digits."""
    rows = Rows("batch or one by one", "50 digits, first loop", quick)
    whole = random_rings(SIZES[-1], 6, seed=9)
    for closure in CLOSURES:
        exact = whole.exact(0, closure)
        for size in SIZES[: 3 if quick else None]:
            call = partial(tangents, whole.first(size), closure)
            gap = np.linalg.norm(call()[0] - exact) / np.linalg.norm(exact)
            rows.add(f"{closure} tangent", f"{size:,} at once", call, gap, size)
    return rows


def precisions(quick: bool) -> Rows:
    """The affine tangent of a stiff sliding hexagon in single and in double precision.

    The error is that of the smallest eigenvalue of Ks over the overlap, the size of what `N/l` adds
    to it: 1 means that nothing is known of it.
    """
    case, copies = hard_case("stiff-sliding-grains"), 100 if quick else 20_000
    rows = Rows("precision", "50 digits", quick)
    for overlap in OVERLAPS:
        scene = case.build(overlap)
        answer = exact_answer(scene, "affine")
        assert answer is not None
        for dtype in (np.float32, np.float64):
            call = partial(plain_kernel, *kernel_inputs(scene.graph, copies, dtype))
            values = plain_kernel(*kernel_inputs(scene.graph, 1, dtype))
            gap = (float(values[0, 0]) - answer.spectrum[0]) / overlap
            named = (np.dtype(dtype).name, f"overlap {overlap:.0e}")
            rows.add(*named, call, gap, copies, dtype is np.float64)
    return rows


def compiled_modes(quick: bool) -> Rows:
    """Eigenvalues, cones and fractions of many tangents; compiled too unless quick."""
    matrices = tangents(random_rings(200 if quick else 20_000, 6, seed=13), "affine")
    exact, count = symmetric_spectrum(restrict(matrices, "symmetric")), len(matrices)
    size = np.abs(exact).max(axis=1, keepdims=True)
    rows = Rows("compiled or plain", "LAPACK", quick)
    for how in ("numpy",) if quick else ("numpy", "compiled"):
        call = partial(loop_stability, matrices, compiled=how == "compiled")
        gap = (call().eigenvalues - exact) / size
        rows.add(f"modes, {how}", f"{count:,} loops", call, gap, count)
    return rows


def tangents(batch: Rings, closure: Any) -> Floats:
    """(L, 4, 4) tangents of a batch."""
    found = macroscopic_tangent(batch.graph, batch.law, closure, regime=batch.regime).matrix
    return found.reshape(-1, 4, 4)


def kernel_inputs(graph: GrainGraph, copies: int, dtype: Any) -> tuple[NDArray[Any], ...]:
    """Branches, reference branches, forces and area, of so many copies, in a precision."""
    i, j = graph.contacts.T
    d, d0 = graph.x[j] - graph.x[i], graph.x0[j] - graph.x0[i]
    a, b = graph.x0[i], graph.x0[j]
    area = 0.5 * (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum()
    arrays = (d, d0, graph.normal_force, graph.shear_force, np.array(area))
    return tuple(np.repeat(v[None], copies, axis=0).astype(dtype) for v in arrays)


def plain_kernel(
    d: NDArray[Any], d0: NDArray[Any], N: NDArray[Any], T: NDArray[Any], area: NDArray[Any]
) -> NDArray[Any]:
    """Eigenvalues of Ks of rings whose contacts all slide, every step in the inputs' precision."""
    length = np.hypot(d[..., 0], d[..., 1])
    n = d / length[..., None]
    t = np.stack([-n[..., 1], n[..., 0]], axis=-1)
    along = n + np.sign(T)[..., None] * d.dtype.type(0.5) * t
    k = along[..., :, None] * n[..., None, :]
    k = k - (N / length)[..., None, None] * (t[..., :, None] * t[..., None, :])
    k = k + (T / length)[..., None, None] * (n[..., :, None] * t[..., None, :])
    pair = d0[..., :, None] * d0[..., None, :]
    A = np.einsum("lcik,lcjm->lijkm", k, pair, optimize=True).reshape(-1, 4, 4)
    A = A / area[:, None, None]
    half = np.sqrt(d.dtype.type(0.5))
    basis = np.array([[1, 0, 0, 0], [0, 0, 0, 1], [0, half, half, 0]], dtype=d.dtype)
    K = basis @ A @ basis.T
    return np.linalg.eigvalsh((K + np.swapaxes(K, -1, -2)) / 2)
