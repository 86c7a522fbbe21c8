"""Paths of loops: the rate equations integrated under loading programmes, with exact events."""
