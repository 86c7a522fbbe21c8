"""A set of loops as a material point: one step of strain, its stress and its tangent."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from loops.arrays import Flags, Floats
from loops.errors import InputError, check_choice, counted, whole_number
from loops.graph import GrainGraph
from loops.laws.frictional import ContactLaw
from loops.shown import Shown
from loops.validation import finite, nonnegative
from stability.material.blocks import BLOCK_CONTACTS, CLOSURES, MaterialState, blocks_of
from stability.material.kernels import A11, P11, SHEAR, STUCK, SUMS, nominal_response
from stability.material.loop_set import LoopSet, loop_set

MaterialClosure = Literal["affine", "traction", "cell"]
# Share of the loops, by weight, that may be without a solution.
MOST_FAILED = 0.5


@dataclass(frozen=True, eq=False, repr=False)
class MaterialResponse(Shown):
    """Answer of Q material points to one step.

    Attributes
    ----------
    stress : (Q, 2, 2) array
        Nominal stress `P` (force per length, compression positive).
    tangent : (Q, 2, 2, 2, 2) array
        `dP/dH` with `H = 1 - F`: `P' = A H'` (force per length).
    state : MaterialState
        State at the end of the step.
    regimes : (Q, 3) array
        Shares of the contacts that stick, slide and are open.
    failed : (Q, L) array of bool
        Loops without a solution; the mean is over the others.
    """

    stress: Floats
    tangent: Floats
    state: MaterialState
    regimes: Floats
    failed: Flags

    def to_tension_positive(self) -> MaterialResponse:
        """Return the stress positive in tension, and its tangent `d(-P)/dF`, as in finite elements.

        The tangent is the same array: two signs cancel, `d(-P)/dF = dP/dH`.
        """
        return replace(self, stress=-self.stress)


class LoopMaterial(Shown):
    """Loops as a material point: their mean stress and tangent at the end of a step of strain.

    With `F = R U` the grains turn with `R`, spins blocked in the frame of `U`. Contacts go from
    their branch `d_n` to `d` on a straight line, where the law is integrated: the normal force is
    that of the geometry, the shear force `T_n - kt (d_n x d) Int ds/|d_n + s (d - d_n)|`, cut to
    the strength. Theory, equations (12.1), (12.2), (12.9).

    - affine: `d = U d0`; exact for any length of step while no contact sticks again, opens or
      turns back within it;
    - traction: each loop is in balance under a uniform stress of its own, its centres relax;
    - cell: the closure of the H-model (Nicot and Darve 2011), hexagons alone.

    Loops start as they stand, with their forces: `F = 1` is the configuration given. It is a mean
    over loops that know nothing of one another: no grain rolls, no new contact forms.

    Parameters
    ----------
    loops : LoopSet, GrainGraph or sequence of GrainGraph
        Loops, from `oriented` or `loops_of`, or graphs of loops.
    weights : (L,) array, optional
        Weights in the mean, not negative; those of the set if left out.
    law : ContactLaw, optional
        Law of the contacts; that of the packing if the loops come from one. Linear, cohesive and
        Hertz's laws are compiled; numpy is asked for one of your own.
    closure : {'affine', 'traction', 'cell'}
        How the strain drives the loops.
    threads : int
        Threads that share the points.

    Raises
    ------
    InputError
        If the loops are none, the law cannot be stepped (a bond that breaks, a coupling of normal
        and shear while it sticks), or weights are negative or do not sum to something positive.

    Examples
    --------
    >>> import numpy as np
    >>> from loops import LinearFrictional
    >>> from patterns import regular_polygon
    >>> from stability.material import LoopMaterial, oriented
    >>> law = LinearFrictional(kn=1.0, kt=0.5, mu=np.tan(np.radians(30)))
    >>> material = LoopMaterial(oriented(regular_polygon(6), 36), None, law, closure="affine")
    >>> state = material.start(1)
    >>> response = material.update(np.diag([0.98, 0.99])[None], state)
    >>> (response.stress.round(6) + 0.0).tolist()
    [[[0.021618, 0.0], [0.0, 0.013023]]]
    """

    def __init__(
        self,
        loops: LoopSet | GrainGraph | Sequence[GrainGraph],
        weights: ArrayLike | None = None,
        law: ContactLaw | None = None,
        closure: MaterialClosure = "traction",
        *,
        threads: int = 1,
    ) -> None:
        check_choice("closure", closure, get_args(MaterialClosure))
        whole_number("threads", threads, 1)
        self.loops, self.closure, self.threads = loop_set(loops), closure, threads
        given = self.loops.law if law is None else law
        if given is None:
            raise InputError("law of the material", "none", "a contact law", "Give law=...")
        own = self.loops.weights
        shares = nonnegative("weights", own if weights is None else weights, len(own))
        if not shares.sum() > 0.0:
            raise InputError("weights", "zeros", "a sum above zero", "Correct them.")
        self.weights = shares / shares.sum()
        self.law: ContactLaw = given
        self._blocks = blocks_of(self.loops, self.weights, given, closure)

    def facts(self) -> dict[str, object]:
        """Return the facts that the prompt and a notebook show."""
        law = type(self.law).__name__
        return {**self.loops.facts(), "closure": self.closure, "law": law}

    def start(self, points: int = 1) -> MaterialState:
        """Return the state of so many points at `F = 1`: the loops as they were given.

        Raises
        ------
        InputError
            If the number of points is no positive whole number.
        """
        whole_number("points", points, 1)
        kept = [] if self.closure == "affine" else self._blocks
        branches = np.concatenate([np.empty((0, 2)), *(block.branches for block in kept)])
        stress = np.concatenate([np.empty((0, 4)), *(block.balance[0] for block in kept)])

        def each(value: Floats) -> Floats:
            return np.broadcast_to(value, (points, *value.shape)).copy()

        shear = np.concatenate([block.answer[SHEAR] for block in self._blocks])
        failed = np.zeros((points, len(self.weights)), dtype=bool)
        arrays = each(np.eye(2)), each(shear), each(branches), each(stress)
        return MaterialState(*arrays, failed).freeze()

    def update(self, F: ArrayLike, state: MaterialState) -> MaterialResponse:
        """Take one step of every point to the deformation gradient at its end.

        Parameters
        ----------
        F : (Q, 2, 2) array
            Deformation gradients over the configuration of the start, `x = F x0`.
        state : MaterialState
            State at the start of the step; it stays valid.

        Returns
        -------
        MaterialResponse
            Stress, tangent, new state, shares of the regimes, loops without a solution.

        Raises
        ------
        InputError
            If a gradient is not finite or turns the plane over, its number is not that of the
            state's points, or more than half of the loops of a point have no solution.
        """
        F = _gradients(F, state, len(self.weights))
        R, U = polar(F)
        points, closure = len(F), CLOSURES[self.closure]
        new = MaterialState(U, *(np.empty_like(a) for a in list(vars(state).values())[1:]))
        new.failed[:] = state.failed
        sums = np.zeros((len(self._blocks), points, SUMS))

        def work(task: tuple[int, slice]) -> None:
            number, part = task
            block = self._blocks[number]
            old = state.part(part, block)
            sums[number, part] = closure(block, U[part], old, new.part(part, block))

        tasks = [
            (number, slice(begin, begin + size))
            for number, block in enumerate(self._blocks)
            for size in [max(1, BLOCK_CONTACTS // len(block.branches))]
            for begin in range(0, points, size)
        ]
        if self.threads == 1:
            for task in tasks:
                work(task)
        else:
            with ThreadPoolExecutor(self.threads) as pool:
                list(pool.map(work, tasks))
        return self._mean(R, U, sums.sum(axis=0), new)

    def _mean(self, R: Floats, U: Floats, sums: Floats, new: MaterialState) -> MaterialResponse:
        """Return the means over the loops that have a solution, turned into the frame of `F`."""
        answered = sums[:, STUCK:].sum(axis=1)
        lost = 1.0 - answered
        if (lost > MOST_FAILED).any():
            point = int(lost.argmax())
            received = f"{lost[point]:.0%} of the loops of point {point} without a solution"
            expected = f"at most {MOST_FAILED:.0%}"
            remedy = "Take smaller steps from the state before, or end the path there."
            raise InputError("step of the material", received, expected, remedy)
        mean = sums / answered[:, None]
        B = mean[:, P11:A11].reshape(-1, 2, 2)
        A = mean[:, A11:STUCK].reshape(-1, 2, 2, 2, 2)
        stress, tangent = nominal_response(R, U, B, A)
        return MaterialResponse(stress, tangent, new.freeze(), mean[:, STUCK:], new.failed)


def _gradients(F: ArrayLike, state: MaterialState, loops: int) -> Floats:
    """Return deformation gradients (Q, 2, 2), or raise `InputError`."""
    points, own = state.failed.shape
    if own != loops:
        received, remedy = counted(own, "loop"), "Take material.start(points)."
        raise InputError("state of the material", received, counted(loops, "loop"), remedy)
    gradients = finite("F", F, points, 2, 2)
    det = gradients[:, 0, 0] * gradients[:, 1, 1] - gradients[:, 0, 1] * gradients[:, 1, 0]
    if (det <= 0.0).any():
        point = int(np.argmax(det <= 0.0))
        received, remedy = f"det F = {det[point]:.6g}", "Take a smaller step."
        raise InputError(f"F of point {point}", received, "det F > 0", remedy)
    return gradients


def polar(F: Floats) -> tuple[Floats, Floats]:
    """Return the rotation `R` and the stretch `U`, (Q, 2, 2), of `F = R U`."""
    angle = np.arctan2(F[:, 1, 0] - F[:, 0, 1], F[:, 0, 0] + F[:, 1, 1])
    cos, sin = np.cos(angle), np.sin(angle)
    R = np.stack([cos, -sin, sin, cos], axis=-1).reshape(-1, 2, 2)
    U = np.swapaxes(R, 1, 2) @ F
    return R, 0.5 * (U + np.swapaxes(U, 1, 2))
