"""Paths: the rate equations of a graph integrated under loading programmes, with exact events."""

from stability.paths.follow import follow, rates_at
from stability.paths.path import Event, Path

__all__ = ["Event", "Path", "follow", "rates_at"]
