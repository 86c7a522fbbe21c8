"""Closures: how the surrounding medium drives a loop, and its macroscopic tangent."""

from loops.closures.system import Closure as Closure
from loops.closures.system import Spins as Spins
from loops.closures.tangents import MacroTangent as MacroTangent
from loops.closures.tangents import affine_tangent as affine_tangent
from loops.closures.tangents import macroscopic_tangent as macroscopic_tangent
from loops.closures.tangents import traction_tangent as traction_tangent
