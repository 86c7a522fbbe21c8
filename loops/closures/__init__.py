"""Closures: how the surrounding medium drives a loop, one per file, and the spin rules."""

from loops.closures.affine import affine_tangent as affine_tangent
from loops.closures.macro_tangent import Closure as Closure
from loops.closures.macro_tangent import MacroTangent as MacroTangent
from loops.closures.macro_tangent import Spins as Spins
from loops.closures.traction import macroscopic_tangent as macroscopic_tangent
from loops.closures.traction import traction_tangent as traction_tangent
