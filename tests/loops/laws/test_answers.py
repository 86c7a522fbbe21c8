"""What laws answer to those who read tables, check forces or compile steps."""

import pytest

from loops import CohesiveFrictional, FrictionalLaw, HertzMindlin, LinearFrictional
from loops import RollingResistance as Rolling
from loops.laws.frictional import linear_springs, of_tables

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
