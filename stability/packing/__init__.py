"""The rate problem of a packing, and what it makes every loop do."""

from stability.packing.loop_rates import LoopRates, loop_rates
from stability.packing.probe import Probe, probe
from stability.packing.response import PackingRates, PackingResponse, packing_response

__all__ = [
    "LoopRates",
    "PackingRates",
    "PackingResponse",
    "Probe",
    "loop_rates",
    "packing_response",
    "probe",
]
