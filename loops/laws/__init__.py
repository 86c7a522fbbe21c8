"""Contact laws behind the protocol `ContactLaw`: linear, cohesive, Hertz, rolling."""

from loops.laws.cohesive import CohesiveFrictional as CohesiveFrictional
from loops.laws.frictional import ContactLaw as ContactLaw
from loops.laws.frictional import FrictionalLaw as FrictionalLaw
from loops.laws.frictional import LinearFrictional as LinearFrictional
from loops.laws.frictional import Regime as Regime
from loops.laws.hertz_mindlin import HertzMindlin as HertzMindlin
from loops.laws.rolling_resistance import RollingResistance as RollingResistance
