"""Hard cases, each with a name: scenes that every method must face, and what must come out."""

from patterns.hard_cases.case import LETTERS, HardCase, Scene
from patterns.hard_cases.registry import HARD_CASES, hard_case

__all__ = ["HARD_CASES", "LETTERS", "HardCase", "Scene", "hard_case"]
