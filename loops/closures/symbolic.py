"""The tangent of a loop in symbols, from the same sum over contacts as in numbers (sympy)."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from loops.assembly import contact_regime
from loops.closures.system import Closure, HasLaw, named_closure, with_law
from loops.errors import library
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
        named = zip(("A", "S", "K", "compliance C = K^-1"), self, strict=False)
        shown = [f"{name}: {M.shape}" for name, M in named if M is not None]
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
    with library("gl.symbolic_tangent", "sympy"):
        import sympy
    graph, law = with_law(graph, law)
    require_one_state(graph)
    require_loop(graph)
    affine = named_closure(closure) == "affine"
    state, d, d0 = contact_state(graph), graph.branches, graph.reference_branches
    D = law.local_stiffness(state, contact_regime(state, law))
    D[..., 1] *= law.shear_kinematics(state)[0][..., None]
    slope = D[:, 1, 0] / np.where(D[:, 0, 0] > 0.0, D[:, 0, 0], 1.0)
    numbers = {"V": np.array([reference_volume(graph)]), "N": state.normal_force}
    numbers |= {"T": state.shear_force, "kn": D[:, 0, 0], "kt": D[:, 1, 1], "m": slope}
    for end, branches in {"": d, "" if np.array_equal(d, d0) else "0": d0}.items():
        numbers |= {f"theta{end}": np.arctan2(*branches.T[::-1]), f"l{end}": np.hypot(*branches.T)}
    symbols, values = dict[str, list[Any]](), dict[Any, float]()
    for name, column in numbers.items():
        alike = np.ptp(column) <= SAME_RTOL * np.abs(column).max()
        names = [name if alike else f"{name}_{c + 1}" for c in range(len(column))]
        symbols[name] = [sympy.Symbol(one, real=True) for one in names]
        values.update(zip(symbols[name], column.tolist(), strict=True))
    f, H = sympy.Matrix(sympy.symbols("f:2")), sympy.Matrix(2, 2, sympy.symbols("H:4"))
    [V], blocks, rows, corner = symbols.pop("V"), [], [], sympy.zeros(2, 1)
    for c, (slides, sticks) in enumerate(D[:, 1] != 0.0):
        N, T, kn, kt, m, theta, length, *reference = (column[c] for column in symbols.values())
        theta0, l0 = reference or (theta, length)
        below = [m * kn * int(slides), kt * int(sticks) - N / length]
        blocks.append(sympy.Matrix([[kn, T / length], below]))
        frame, axes = (sympy.rot_axis3(angle)[:2, :2] for angle in (theta, theta0))
        branch, turned = (l0 * axes[k, :].T for k in range(2))
        # Motions of the contacts per `H`; their forces per `f` and the stress, in the place of `H`.
        rows.append(-frame * H * branch if affine else frame * (f + H * (corner + turned / 2)))
        corner += turned
    A, S = sympy.Matrix.vstack(*rows).jacobian([*H] if affine else [*f, *H]), sympy.diag(*blocks)
    if affine:
        return SymbolicTangent(A, S, A.T * S * A / V, None, values)
    with sympy.matrices.utilities.dotprodsimp(False):  # to simplify sums takes minutes
        F = A.T * sympy.diag(*(block.adjugate() / block.det() for block in blocks)) * A
        relaxed = F[2:, :2] * F[:2, :2].adjugate() * F[:2, 2:] / F[:2, :2].det()
    return SymbolicTangent(A, S, None, (F[2:, 2:] - relaxed) / V, values)
