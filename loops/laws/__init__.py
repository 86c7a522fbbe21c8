"""Contact laws: one law per file, all behind the protocol `ContactLaw`."""

from loops.laws.frictional import ContactLaw as ContactLaw
from loops.laws.frictional import FrictionalLaw as FrictionalLaw
from loops.laws.frictional import Regime as Regime
from loops.laws.hertz_mindlin import HertzMindlin as HertzMindlin
from loops.laws.linear_frictional import LinearFrictional as LinearFrictional
from loops.laws.rolling_resistance import RollingResistance as RollingResistance
