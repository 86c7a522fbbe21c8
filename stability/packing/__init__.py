"""A packing: its rate problem, its path by events, its replay, and what they make loops do."""

from stability.packing.equations_of_motion import Replay, replay
from stability.packing.loop_rates import LoopRates, loop_changes, loop_rates
from stability.packing.path import PackingPath, follow_packing
from stability.packing.probe import Probe, probe
from stability.packing.response import PackingRates, PackingResponse, packing_response
from stability.packing.state import PackingState

__all__ = [
    "LoopRates",
    "PackingPath",
    "PackingRates",
    "PackingResponse",
    "PackingState",
    "Probe",
    "Replay",
    "follow_packing",
    "loop_changes",
    "loop_rates",
    "packing_response",
    "probe",
    "replay",
]
