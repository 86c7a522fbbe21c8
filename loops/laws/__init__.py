"""Contact laws: one law per file, all behind the protocol `ContactLaw`."""

from loops.laws.linear_frictional import LinearFrictional
from loops.laws.protocol import ContactLaw, Regime

__all__ = ["ContactLaw", "LinearFrictional", "Regime"]
