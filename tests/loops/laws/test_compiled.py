"""A law compiled as it stands beside numpy: the same numbers, and the reason where it cannot be."""

import numpy as np
import pytest

from loops import (
    CohesiveFrictional,
    GrainGraph,
    HertzMindlin,
    LinearFrictional,
    contact_state,
)
from loops.laws.compiled import answer_of, compiled
from loops.laws.of_pairs import PairLaw
from tests.laws import ByDisplacement, Glue, Springs, Stiffening

COUNT = 40
NO_WALLS = np.zeros((4, COUNT))
DRAW = np.random.default_rng(5)
RADII = DRAW.uniform(0.5, 2.0, (2, COUNT))
# As the branch length tells them: numpy's state keeps the length, the kernel the overlap.
OVERLAP = RADII.sum(axis=0) - (RADII.sum(axis=0) - DRAW.uniform(1e-3, 0.1, COUNT))
BEFORE = OVERLAP * DRAW.uniform(0.9, 1.1, COUNT)
SHEAR = np.where(np.arange(COUNT) % 7 == 0, 0.0, DRAW.uniform(-0.1, 0.1, COUNT))
MODULI = DRAW.uniform(1.0, 3.0, COUNT)


class Sliding(Springs):
    """A law that never slides, written with a friction that is infinite at some contacts."""


LAWS = [
    Springs(k=MODULI, kt=0.5, mu=0.5),
    Springs(k=1.0, kt=0.5),
    Sliding(k=2.0, kt=MODULI, mu=np.where(MODULI > 2, np.inf, 0.3)),
    Glue(k=1.5, kt=0.5, mu=0.3, pull=0.01 * MODULI),
    ByDisplacement(modulus=MODULI, ratio=0.8, mu=0.5),
    Stiffening(k=MODULI, b=2.0, kt=0.7, mu=0.4, c=0.5),
]


def filled(function, constants):
    out = np.empty((4, COUNT))
    function(np.ascontiguousarray(constants), RADII, OVERLAP, BEFORE, SHEAR, out)
    return out


def within_a_rounding(one, other):
    """Equal to one unit in the last place of each column's size; infinite where the other is."""
    assert (np.isinf(one) == np.isinf(other)).all()
    finite = np.isfinite(other)
    np.testing.assert_array_max_ulp(one[finite], other[finite], maxulp=1)


@pytest.mark.parametrize(
    "law",
    [pytest.param(law, marks=[pytest.mark.slow] * (k != 3)) for k, law in enumerate(LAWS)],
    ids=lambda law: type(law).__name__,
)
def test_a_compiled_law_is_that_of_numpy(law):
    made = compiled(law, RADII, NO_WALLS)
    assert not isinstance(made, str), made
    other = answer_of(law, RADII, OVERLAP, BEFORE, SHEAR)
    within_a_rounding(filled(made.pointer.function, made.constants), other)
    assert (other[3, SHEAR == 0] == 0).all()
    # Compiled once for all laws of a kind.
    assert compiled(law.take([1]), RADII[:, [1]], NO_WALLS[:, [1]]).pointer is made.pointer


@pytest.mark.parametrize("kind", ["linear", "attraction", "bond", "force", "displacement"])
def test_kernels_of_known_laws_are_these_laws(kind):
    """By displacement `T` goes with `kt`."""
    mu = np.where(MODULI > 2.5, np.inf, 0.4)
    law = {
        "linear": LinearFrictional(MODULI, 0.5, mu),
        "attraction": CohesiveFrictional(MODULI, 0.5, mu, 0.02),
        "bond": CohesiveFrictional(MODULI, 0.5, mu, 0.02, bonded=True),
    }.get(kind) or HertzMindlin(MODULI, 0.2, mu, shear_history=kind)
    filling = PairLaw.made(law, RADII, np.full(COUNT, -1)).filling(False)
    found = filled(filling.pointer.function, filling.constants)
    wanted = answer_of(law, RADII, OVERLAP, BEFORE, SHEAR)
    if kind == "displacement":
        wanted[3] = SHEAR * np.sqrt(OVERLAP / BEFORE)
    np.testing.assert_allclose(found, wanted, rtol=1e-14 if "Hertz" not in repr(law) else 4e-15)
    if kind == "linear":
        assert np.array_equal(found, wanted)


@pytest.mark.parametrize("kind", ["linear", "attraction", "force", "displacement"])
def test_slopes_of_known_laws_are_those_of_what_they_fill_in(kind):
    """By differences of the fourth order over a thousandth of the overlaps."""
    mu = np.where(MODULI > 2.5, np.inf, 0.4)
    law = {
        "linear": LinearFrictional(MODULI, 0.5, mu),
        "attraction": CohesiveFrictional(MODULI, 0.5, mu, 0.02),
    }.get(kind) or HertzMindlin(MODULI, 0.2, mu, shear_history=kind)
    pointer, constants = PairLaw.made(law, RADII, np.full(COUNT, -1)).filling(False)

    def at(share, rows=4):
        out = np.empty((rows, COUNT))
        pointer.function(constants, RADII, (1 + share) * OVERLAP, BEFORE, SHEAR, out)
        return out

    h, found = 1e-3, at(0.0, 8)
    with np.errstate(invalid="ignore"):
        steps = 8 * (at(h) - at(-h)) - (at(2 * h) - at(-2 * h))
        wanted, finite = steps / (12 * h * OVERLAP), np.isfinite(steps)
    assert np.array_equal(found[:4], at(0.0)) and finite[[0, 1, 3]].all()
    np.testing.assert_allclose(found[4:][finite], wanted[finite], rtol=1e-10, atol=1e-11)


class Branching(Springs):
    """Asks for the truth of a number, which numba takes for an array."""

    def closed_force(self, state):
        return self.k * state.overlap if self.k > 1 else 0.0 * state.overlap


class Integral(Springs):
    """Asks whether a number is whole, which as a row of numbers none is."""

    def closed_force(self, state):
        return self.k * state.overlap * (1.0 if isinstance(self.m, int) else 2.0)


class Changed(Springs):
    def local_stiffness(self, state, regime):
        return super().local_stiffness(state, regime)


class Framed(Springs):
    """Asks for more than the overlap and the forces."""

    def closed_force(self, state):
        return self.k * state.overlap * np.abs(state.n[:, 0])


@pytest.mark.parametrize(
    ("law", "reason"),
    [(Branching(k=0.5, kt=0.5), "truth value of an array"),
     (Changed(k=2.0, kt=0.5), "it changes local_stiffness"),
     (Framed(k=2.0, kt=0.5), "'n'"), (Integral(k=2.0, kt=0.5, m=3), "other numbers than in numpy")],
)  # fmt: skip
def test_a_law_that_cannot_be_compiled_says_why(law, reason):
    found = compiled(law, RADII, NO_WALLS)
    assert isinstance(found, str) and reason in found and "\n" not in found


@pytest.mark.parametrize("law", LAWS[3:], ids=lambda law: type(law).__name__)
def test_stiffnesses_are_slopes_of_the_formulae(law):
    """`strength_slope` and `coupling` stand in `local_stiffness`, by their sign and regime."""
    distance = (RADII.sum(axis=0) - OVERLAP)[:, None] * [1.0, 0.0]
    pairs = np.arange(2 * COUNT).reshape(-1, 2)
    x = np.stack([0 * distance, distance], axis=1).reshape(-1, 2)
    graph = GrainGraph(x=x, radii=RADII.T.ravel(), contacts=pairs, shear_force=SHEAR)
    graph = graph.replace(normal_force=law.normal_force(contact_state(graph)))
    state, size = contact_state(graph), 1e-6

    def at(shift):
        from dataclasses import replace

        moved = replace(state, length=state.length - shift)
        return replace(moved, normal_force=law.closed_force(moved))

    more, less = at(size), at(-size)
    slides = law.local_stiffness(state, np.full(COUNT, 2, dtype=np.int8))
    rise = (law.strength(more) - law.strength(less)) / (2 * size)
    np.testing.assert_allclose(slides[:, 1, 0], np.sign(SHEAR) * rise, rtol=1e-5, atol=1e-9)
    sticks = law.local_stiffness(state, np.ones(COUNT, dtype=np.int8))
    np.testing.assert_allclose(sticks[:, 1, 0], np.broadcast_to(law.coupling(state), COUNT))
