"""Diamonds followed once and asked by many tests."""

import functools

from studies.paths.diamond import FollowedDiamond, follow_diamond
from studies.paths.options import DiamondOptions

# Nobody writes into these: a test that spoils a path follows one of its own.


@functools.cache
def followed(**options) -> FollowedDiamond:
    return follow_diamond(DiamondOptions(**options))


@functools.cache
def summary_of(**options):
    return followed(**options).summary()
