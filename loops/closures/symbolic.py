"""The tangent of a loop in symbols, from the same sum over contacts as in numbers (sympy)."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from loops.arrays import Floats
from loops.assembly import contact_regime
from loops.closures.system import Closure, HasLaw, named_closure, with_law
from loops.errors import InputError
from loops.geometry import reference_volume, require_loop
from loops.graph import GrainGraph, contact_state, require_one_state
from loops.laws.frictional import ContactLaw

# Numbers of the contacts that agree so well share one symbol.
SAME_RTOL = 1e-12


class SymbolicTangent(NamedTuple):
    """A tangent in symbols, `P' = K H'`, or its compliance, `H' = C P'`; spins blocked.

    Attributes
    ----------
    A : sympy.Matrix
        Geometry, two rows a contact (along its normal and its tangent). Affine, (2n, 4): motion of
        the contacts per component of `H` in the order (11, 12, 21, 22). Traction, (2n, 6): their
        forces per component of `f^` and of `P`.
    S : sympy.Matrix
        Stiffness of the contacts, (2n, 2n), a block `[[kn, T/l], [m kn, kt - N/l]]` each, with
        `kt` for one that sticks and `m = mu sign T` for one that slides.
    K : sympy.Matrix or None
        The tangent under the affine closure, `A^T S A/V`; None under the traction closure.
    C : sympy.Matrix or None
        Compliance under the traction closure, `C = K^-1`: with `F = A^T S^-1 A` it is
        `(F_PP - F_Pf F_ff^-1 F_fP)/V`. None under the affine closure.
    values : dict
        Number of each symbol in the loop.
    """

    A: Any
    S: Any
    K: Any
    C: Any
    values: dict[Any, float]

    def __repr__(self) -> str:
        named = {"A": self.A, "S": self.S, "K": self.K, "compliance C = K^-1": self.C}
        shown = [f"{name}: {M.shape}" for name, M in named.items() if M is not None]
        return f"SymbolicTangent({', '.join(shown)}, symbols: {len(self.values)})"


def symbolic_tangent(
    graph: GrainGraph | HasLaw, law: ContactLaw | None = None, closure: Closure = "affine"
) -> SymbolicTangent:
    """Tangent of a loop in symbols, with spins blocked.

    Symbols are the direction `theta` and length `l` of a contact's branch, those of the reference
    (`theta0`, `l0`) if it is another, `N`, `T`, `kn`, `kt` and `m`, with the number of the contact
    where contacts differ, and the reference area `V`. Needs sympy (extra `symbolic`). Theory,
    equations (4.4) and (4.11).

    Parameters
    ----------
    graph : GrainGraph, or loop or scene
        A loop, one state.
    law : ContactLaw, optional
        Contact law; that of the loop or scene if left out.
    closure : {'affine', 'traction'}
        How the surrounding medium drives the grains.

    Returns
    -------
    SymbolicTangent
        `A`, `S`, `K` or `C`, and the `values` of the symbols.

    Raises
    ------
    InputError
        If the graph is no loop, or sympy is not installed.

    Examples
    --------
    >>> from loops import GrainGraph, LinearFrictional
    >>> x = [[0, 0], [1, 0], [1, 1], [0, 1]]
    >>> square = GrainGraph(x=x, radii=[0.5] * 4, contacts=[[0, 1], [1, 2], [2, 3], [3, 0]])
    >>> found = symbolic_tangent(square, LinearFrictional(kn=1.0, kt=0.5))
    >>> found
    SymbolicTangent(A: (8, 4), S: (8, 8), K: (4, 4), symbols: 11)
    >>> found.S[:2, :2]
    Matrix([
    [kn,       T/l],
    [ 0, -N/l + kt]])
    """
    try:
        import sympy
        from sympy.matrices.utilities import dotprodsimp
    except ImportError:
        remedy = "Install it: pip install sympy."
        raise InputError("gl.symbolic_tangent", "no sympy", "sympy", remedy) from None
    graph, law = with_law(graph, law)
    require_one_state(graph)
    require_loop(graph)
    named_closure(closure)
    state, values = contact_state(graph), dict[Any, float]()

    def symbols(name: str, numbers: Any) -> list[Any]:
        numbers = np.broadcast_to(numbers, graph.contact_count)
        alike = np.ptp(numbers) <= SAME_RTOL * np.abs(numbers).max()
        numbered = [name if alike else f"{name}_{c + 1}" for c in range(len(numbers))]
        found = [sympy.Symbol(one, real=True) for one in numbered]
        values.update(zip(found, numbers.tolist(), strict=True))
        return found

    def polar(end: str, branches: Floats) -> tuple[list[Any], list[Any]]:
        angles = symbols(f"theta{end}", np.arctan2(branches[:, 1], branches[:, 0]))
        normals = [sympy.Matrix([sympy.cos(angle), sympy.sin(angle)]) for angle in angles]
        return symbols(f"l{end}", np.hypot(*branches.T)), normals

    own = polar("", graph.branches)
    reference = own if np.array_equal(graph.x0, graph.x) else polar("0", graph.reference_branches)
    D, g = law.local_stiffness(state, contact_regime(state, law)), law.shear_kinematics(state)[0]
    kn, kt = symbols("kn", D[:, 0, 0]), symbols("kt", g * D[:, 1, 1])
    slope = symbols("m", D[:, 1, 0] / np.where(D[:, 0, 0] > 0.0, D[:, 0, 0], 1.0))
    N, T = symbols("N", state.normal_force), symbols("T", state.shear_force)
    blocks, rows, corner, eye = [], [], sympy.zeros(2, 1), sympy.eye(2)
    for c, (length, n, l0, n0) in enumerate(zip(*own, *reference, strict=True)):
        # A contact that sticks has no friction in its block, one that slides no shear stiffness.
        k, m = (one[c] * int(values[one[c]] != 0.0) for one in (kt, slope))
        blocks.append(sympy.Matrix([[kn[c], T[c] / length], [m * kn[c], k - N[c] / length]]))
        frame, d = sympy.Matrix([[n[0], n[1]], [-n[1], n[0]]]), l0 * n0
        middle, corner = corner + d / 2, corner + d
        if closure == "affine":
            rows.append(-frame * sympy.kronecker_product(eye, d.T))
        else:
            lever = sympy.Matrix([[middle[1], -middle[0]]])
            rows.append(frame.row_join(-frame * sympy.kronecker_product(eye, lever)))
    A, S, V = sympy.Matrix.vstack(*rows), sympy.diag(*blocks), sympy.Symbol("V", real=True)
    values[V] = float(reference_volume(graph))
    # Sums stay as they are: to simplify them takes minutes.
    with dotprodsimp(False):
        if closure == "affine":
            return SymbolicTangent(A, S, A.T * S * A / V, None, values)
        F = A.T * sympy.diag(*(block.adjugate() / block.det() for block in blocks)) * A
        f = F[:2, :2].adjugate() / F[:2, :2].det()
        C = (F[2:, 2:] - F[2:, :2] * f * F[:2, 2:]) / V
    return SymbolicTangent(A, S, None, C, values)
