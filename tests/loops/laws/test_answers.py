"""What laws answer to those who read tables, check forces or compile steps."""

import numpy as np
import pytest

from loops import (
    CohesiveFrictional,
    FrictionalLaw,
    GrainGraph,
    HertzMindlin,
    LinearFrictional,
    contact_state,
)
from loops import RollingResistance as Rolling
from loops.laws.frictional import of_tables
from loops.laws.kinds import linear_springs

LINEAR, HERTZ = LinearFrictional(2.0, 0.5, 0.4), HertzMindlin(3.0, 0.2, 0.4)
ATTRACTS = CohesiveFrictional(2.0, 0.5, 0.4, adhesion=0.1)
BOND = CohesiveFrictional(2.0, 0.5, 0.4, adhesion=0.1, bonded=True)
OWN = FrictionalLaw(kn=2.0, kt=0.5)


class Stiffer(LinearFrictional):
    """Springs of one's own, derived from linear ones."""

    def closed_force(self, state):
        return self.kn * state.overlap**2


@pytest.mark.parametrize(
    ("law", "words", "power", "cohesive", "attraction"),
    [
        (LINEAR, {}, 1.0, False, 0.0),
        (HERTZ, {"law": "hertz", "shear_history": "force"}, 1.5, False, 0.0),
        (ATTRACTS, {"law": "cohesive"}, 1.0, True, 0.1),
        (BOND, {"law": "bonded"}, 1.0, True, 0.0),
        (OWN, None, None, False, 0.0),
    ],
)
def test_answers(law, words, power, cohesive, attraction):
    assert law.table_words == words and law.overlap_power == power
    assert law.cohesive == cohesive and law.attraction == attraction
    assert of_tables(law) == (words is not None)
    assert linear_springs(law) == (law is LINEAR)


def test_other_laws_are_none_of_tables():
    assert not of_tables(Rolling(LINEAR, 0.1)) and not linear_springs(Rolling(LINEAR, 0.1))
    assert not linear_springs(Stiffer(2.0, 0.5, 0.4)) and not of_tables(None)


class Power(FrictionalLaw):
    """A power of the overlap, whose slope nobody has written."""

    def closed_force(self, state):
        return self.k * state.overlap**self.m


@pytest.mark.parametrize("power", [1.0, 1.5, 2.0])
def test_slopes_of_a_force_do_not_lose_digits_with_the_overlap(power):
    """Overlaps of stiff grains are small beside the lengths that they are differences of."""
    overlap = np.array([1e-2, 1e-4, 1e-6, 1e-8, 1e-10])
    x = np.zeros((10, 2))
    x[::2, 0], x[1::2, 0], x[1::2, 1] = -0.3, 0.7 - overlap, 1e-7
    state = contact_state(GrainGraph(x, [0.4, 0.6] * 5, np.arange(10).reshape(5, 2)))
    found = Power(k=3.0, m=power, kt=1.0).stiffnesses(state)[0]
    true = 3.0 * power * state.overlap ** (power - 1.0)
    # Places at which the slope is taken are off by half a unit in the last place of the length.
    assert (abs(found / true - 1.0) <= 1e-12 + 1e-16 / overlap).all()
