"""Contact laws derived from `FrictionalLaw`: linear, cohesive, Hertz, rolling."""

from loops.laws.frictional import ContactLaw as ContactLaw
from loops.laws.frictional import FrictionalLaw as FrictionalLaw
from loops.laws.frictional import Regime as Regime
from loops.laws.kinds import CohesiveFrictional as CohesiveFrictional
from loops.laws.kinds import HertzMindlin as HertzMindlin
from loops.laws.kinds import LinearFrictional as LinearFrictional
from loops.laws.kinds import RollingResistance as RollingResistance
