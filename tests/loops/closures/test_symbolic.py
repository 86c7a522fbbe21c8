"""The tangent in symbols: the diamond's (26) as an expression, numbers as in numpy."""

import sys

import mpmath
import numpy as np
import pytest
import sympy as sp

import grainloops as gl
from tests.packings import LAW

CLOSURES = {"affine": gl.affine_tangent, "traction": gl.traction_tangent}


def in_numbers(found):
    """The tangent at the values of the symbols, in 30 digits: the inverse of C adds no error."""
    matrix = found.C if found.K is None else found.K
    with mpmath.workdps(30):
        values = map(mpmath.mpf, found.values.values())
        known = sp.lambdify(list(found.values), matrix, "mpmath", cse=True)(*values)
        known = mpmath.inverse(known) if found.K is None else known
    return np.array(known.tolist(), dtype=float)


@pytest.mark.parametrize("closure", CLOSURES)
@pytest.mark.parametrize(("order", "law"), [
    (3, LAW),
    (4, gl.HertzMindlin(young=10.0, poisson=0.3, mu=0.5)),
    (5, gl.LinearFrictional(1.0, 0.3, 0.5, shear_increment="radii")),
])  # fmt: skip
def test_numbers_in_the_place_of_symbols_give_the_tangent(order, law, closure):
    graph = gl.random_loop(order, order, polydispersity=0.2, strain=0.02)
    regime = [2] + [1] * (order - 1)
    graph = graph.replace(regime=regime)
    known = CLOSURES[closure](graph, law).matrix
    found = in_numbers(gl.symbolic_tangent(graph, law, closure))
    assert np.abs(found - known).max() <= 1e-14 * np.abs(known).max()


@pytest.mark.slow
@pytest.mark.parametrize("sliding", [False, True])
def test_the_diamond_has_equation_26(sliding):
    a, a0, length, l0, N, T, kn, kt, m = sp.symbols("a a0 l l0 N T kn kt m", positive=True)
    graph = gl.diamond(0.7, E1=0.1, E2=0.05, T=0.01).replace(regime=[2 if sliding else 1] * 4)
    found = gl.symbolic_tangent(graph, gl.LinearFrictional(1.0, 0.3, 0.5))
    plain = {
        "l": length,
        "l0": l0,
        "N": N,
        "kn": kn,
        "kt": kt,
        "V": 4 * l0**2 * sp.sin(a0) * sp.cos(a0),
    }
    signed = {"theta": a, "theta0": a0, "T": T, "m": m}
    named = {}
    for symbol, value in found.values.items():
        name = symbol.name.split("_")[0]
        named[symbol] = plain.get(name) or np.sign(value).astype(int) * signed[name]
        if name in ("theta", "theta0") and abs(value) > np.pi / 2:
            named[symbol] = int(np.sign(value)) * (sp.pi - signed[name])
    K = (found.K.subs(named) / kn).extract([0, 3], [0, 3])

    F1, F2 = 2 * (N * sp.cos(a) + T * sp.sin(a)), 2 * (N * sp.sin(a) - T * sp.cos(a))
    s1, s2 = F1 / (2 * l0 * sp.sin(a0) * kn), F2 / (2 * l0 * sp.cos(a0) * kn)
    left1 = length * sp.cos(a) / (l0 * sp.cos(a0))
    left2 = length * sp.sin(a) / (l0 * sp.sin(a0))
    t, t0 = sp.tan(a), sp.tan(a0)
    L1, L2 = (m / t, -m * t) if sliding else (kt / kn, kt / kn)
    of_paper = sp.cos(a) ** 2 * sp.Matrix([
        [(1 + L1 * t**2 - t * s2 / left1) / t0, (1 - L2) * t + s2 / left1],
        [(1 - L1) * t + t**2 * s1 / left2, (t**2 + L2 - t * s1 / left2) * t0],
    ])  # fmt: skip
    assert (K - of_paper).applyfunc(sp.simplify) == sp.zeros(2, 2)
    wrong = (K.subs(T, -T) - of_paper).applyfunc(sp.simplify)
    assert wrong != sp.zeros(2, 2)


def test_without_sympy_the_remedy_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "sympy", None)
    with pytest.raises(gl.InputError, match=r"no sympy.*pip install sympy"):
        gl.symbolic_tangent(gl.regular_polygon(5), LAW)


def test_what_is_no_loop_has_no_symbols():
    with pytest.raises(gl.InputError, match="closure: got 'packing'"):
        gl.symbolic_tangent(gl.regular_polygon(5), LAW, "packing")
    with pytest.raises(gl.InputError, match="one state"):
        gl.symbolic_tangent(gl.regular_polygon(5, strain=[0.0, 0.1]), LAW)
