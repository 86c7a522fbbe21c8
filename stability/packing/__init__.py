"""The rate problem of a packing, and what it makes every loop do."""

from stability.packing.loop_rates import LoopRates, loop_rates
from stability.packing.response import PackingRates, PackingResponse, packing_response

__all__ = ["LoopRates", "PackingRates", "PackingResponse", "loop_rates", "packing_response"]
