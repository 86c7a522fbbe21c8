"""The rate problem of a packing, and what it makes every loop do."""

from stability.packing.response import PackingRates, PackingResponse, packing_response

__all__ = ["PackingRates", "PackingResponse", "packing_response"]
