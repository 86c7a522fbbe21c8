"""Hard cases, each with a name: scenes that every method must face, and what must come out."""

from patterns.hard_cases.case import LETTERS as LETTERS
from patterns.hard_cases.case import HardCase as HardCase
from patterns.hard_cases.case import Scene as Scene
from patterns.hard_cases.registry import HARD_CASES as HARD_CASES
from patterns.hard_cases.registry import hard_case as hard_case
