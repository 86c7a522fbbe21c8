"""Paths: the rate equations of a graph integrated under loading programmes, with exact events."""

from stability.paths.follow import follow as follow
from stability.paths.follow import rates_at as rates_at
from stability.paths.path import Event as Event
from stability.paths.path import EventKind as EventKind
from stability.paths.path import Path as Path
