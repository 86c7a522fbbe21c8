"""Paths of loops: the rate equations integrated under loading programmes, with exact events."""

from loops.lazy import old_names
from stability.paths.of_graph import rates_at as rates_at

OLD = {name: f"stability.{name}" for name in ("Event", "Path", "follow")}
__getattr__ = old_names(__name__, OLD | {"EventKind": "stability.path.EventKind"})
