"""Paths: the rate equations of a graph integrated under loading programmes, with exact events."""

from stability.path import Event as Event
from stability.path import EventKind as EventKind
from stability.path import Path as Path
from stability.paths.follow import follow as follow
from stability.paths.follow import rates_at as rates_at
