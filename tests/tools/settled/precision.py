"""Single or double precision: the affine tangent of a stiff hexagon."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from loops import GrainGraph
from tests.benchmarks.hard_cases import exact_answer
from tests.benchmarks.methods import Rows
from tests.oracles.hard_cases import hard_case

OVERLAPS = (1e-1, 1e-3, 1e-5, 1e-7)


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
