"""A packing: its rate problem, its path by events, its replay, and what they make loops do."""

from loops.contacts import Contacts as Contacts
from stability.packing.equations_of_motion import replay as replay
from stability.packing.hold import HeldPacking as HeldPacking
from stability.packing.hold import hold as hold
from stability.packing.loop_quantities import LoopRates as LoopRates
from stability.packing.loop_quantities import indicators as indicators
from stability.packing.loop_quantities import loop_changes as loop_changes
from stability.packing.loop_quantities import loop_rates as loop_rates
from stability.packing.loop_regimes import LoopsAtYield as LoopsAtYield
from stability.packing.loop_regimes import loops_at_yield as loops_at_yield
from stability.packing.probe import Probe as Probe
from stability.packing.probe import probe as probe
from stability.packing.response import PackingRates as PackingRates
from stability.packing.response import PackingResponse as PackingResponse
from stability.packing.response import packing_increment as packing_increment
from stability.packing.response import rate_problem as rate_problem
from stability.packing.sustain import Sustained as Sustained
from stability.packing.sustain import sustain as sustain
from stability.path import Motion as Motion
