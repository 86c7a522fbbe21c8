"""The rate problem of a packing, and what it makes every loop do."""

from stability.packing.equations_of_motion import Replay, replay
from stability.packing.loop_rates import LoopRates, loop_changes, loop_rates
from stability.packing.probe import Probe, probe
from stability.packing.response import PackingRates, PackingResponse, packing_response
from stability.packing.state import PackingState

__all__ = [
    "LoopRates",
    "PackingRates",
    "PackingResponse",
    "PackingState",
    "Probe",
    "Replay",
    "loop_changes",
    "loop_rates",
    "packing_response",
    "probe",
    "replay",
]
