"""Closures: how the surrounding medium drives a loop, one per file, and the spin rules."""

from loops.closures.affine import affine_tangent
from loops.closures.macro_tangent import Closure, MacroTangent, Spins
from loops.closures.traction import macroscopic_tangent, traction_tangent

__all__ = [
    "Closure",
    "MacroTangent",
    "Spins",
    "affine_tangent",
    "macroscopic_tangent",
    "traction_tangent",
]
