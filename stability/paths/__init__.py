"""Paths of loops: the rate equations integrated under loading programmes, with exact events."""

from loops.lazy import old_names

OLD = {name: f"stability.{name}" for name in ("Event", "Path", "follow", "rates_at")}
__getattr__ = old_names(__name__, OLD | {"EventKind": "stability.path.EventKind"})
