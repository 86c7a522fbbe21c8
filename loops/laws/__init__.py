"""Contact laws: one law per file, all behind the protocol `ContactLaw`."""

from loops.laws.frictional import FrictionalLaw
from loops.laws.hertz_mindlin import HertzMindlin
from loops.laws.linear_frictional import LinearFrictional
from loops.laws.protocol import ContactLaw, Regime
from loops.laws.rolling_resistance import RollingResistance

__all__ = [
    "ContactLaw",
    "FrictionalLaw",
    "HertzMindlin",
    "LinearFrictional",
    "Regime",
    "RollingResistance",
]
