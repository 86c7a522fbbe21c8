"""Which laws paths of packings, motions and materials take, and why others are refused."""

from __future__ import annotations

import numpy as np

from loops.errors import InputError
from loops.graph import ContactState
from loops.laws.frictional import FrictionalLaw, LinearFrictional, Regime, linear_springs
from loops.laws.hertz_mindlin import HERTZ, HERTZ_BAND, HertzMindlin
from loops.laws.of_pairs import AT_TOUCH, MovableLaw, PairLaw
from loops.laws.rolling_resistance import RollingResistance

# Share of the contacts that tell whose forces they are.
MOSTLY = 0.9
# Methods that a law of one's own may not change.
LEFT = ("shear_kinematics", "rolling_stiffness", "regime")


def require_movable(law: object, state: ContactState) -> MovableLaw:
    """The law of paths, motions and materials; refuse others, and packings without contacts.

    The normal force is one of the overlap; where the grains part it vanishes, or pulls.
    """
    if not len(state.length):
        raise InputError("packing", "no contacts", "a packing that carries", "Compress it first.")
    sheared = law.law if isinstance(law, RollingResistance) else law
    if not isinstance(sheared, FrictionalLaw):
        expected = "a law derived from gl.FrictionalLaw, and at most one spring for rolling"
        remedy = "Give another, or compute tangents alone."
        raise InputError("law", type(sheared).__name__, expected, remedy)
    require_linear_forces(sheared, state)
    if not linear_springs(sheared) and type(sheared) is not HertzMindlin:
        _require_formulae(sheared, state)
    return law if isinstance(law, RollingResistance) else sheared


def require_linear_forces(law: object, state: ContactState) -> None:
    """Raise `InputError` where linear springs have the tangents of Hertz's law; others pass."""
    if not linear_springs(law):
        return
    closed = (state.normal_force != 0) & (state.overlap > 0)
    hertz = HERTZ * (law.kn * state.overlap)[closed]
    as_hertz = np.abs(state.normal_force[closed] - hertz) < HERTZ_BAND * hertz
    if np.count_nonzero(as_hertz) > MOSTLY * len(as_hertz):
        received = "normal forces of 2/3 of kn times the overlap, as Hertz's tangents give them"
        expected = "linear springs, of which N is kn times the overlap"
        remedy = "Give law='hertz' (--law hertz), or study rates."
        raise InputError("law", received, expected, remedy)


def require_unlimited_rolling(law: object) -> None:
    """Raise `InputError` for springs against rolling that yield, which paths of loops lack."""
    if isinstance(law, RollingResistance) and np.isfinite(law.mu_r).any():
        expected = "springs for rolling without a limit, mu_r=inf, in paths of loops"
        raise InputError("law", "a finite mu_r", expected, "Follow the packing, or leave it out.")


def require_linear_springs(law: object, where: str, remedy: str) -> LinearFrictional:
    """Return linear springs with friction; raise `InputError` for another law."""
    if not linear_springs(law):
        raise InputError(where, type(law).__name__, "linear springs", remedy)
    return law


def _require_formulae(law: FrictionalLaw, state: ContactState) -> None:
    """Raise `InputError` unless a law gives what pairs ask of it."""
    name, kind, loops_alone = type(law).__name__, type(law), "Use the law for single loops."

    def refuse(received: str, expected: str, remedy: str = loops_alone) -> InputError:
        return InputError("law", received, expected, remedy)

    changed = [m for m in LEFT if getattr(kind, m) is not getattr(FrictionalLaw, m)]
    changed += [] if law.keeps_strength else ["keeps_strength"]
    if changed:
        expected = "a law that leaves these to gl.FrictionalLaw"
        remedy = "Leave them out, or use the law for single loops."
        raise refuse(f"{name} with {', '.join(changed)}", expected, remedy)
    radii = np.array([state.radii_i, state.radii_j])
    try:
        own = PairLaw.made(law, radii, np.full(radii.shape[1], -1))
        _, pressed = own.contacts(state.overlap)
        D = own.local_stiffness(pressed, Regime.ELASTIC)
    except NotImplementedError as lacks:
        remedy = "Add it to the class."
        expected = "closed_force, and kt or stiffnesses"
        raise refuse(f"{name} without {lacks}", expected, remedy) from None
    parting = own.parting
    rise = law.gap(pressed) - law.gap(parting)
    if np.any(own.reach < 0) or not np.allclose(rise, pressed.length - parting.length):
        expected = "a gap of the branch less its length where the contact opens, at touch or beyond"
        raise refuse(f"{name} with gap", expected)
    if np.any(parting.normal_force > 0) or np.any(D[:, 0, 1] != 0):
        raise refuse(name, "a normal force of the overlap alone that vanishes or pulls at touch")
    least = np.where(np.isfinite(law.mu), law.strength(parting), 0.0)
    if np.any(least < -AT_TOUCH * np.abs(parting.normal_force)):
        expected = "a strength that is not negative where the contact pulls"
        remedy = "Give the class a strength such as mu (N + adhesion)."
        raise refuse(f"{name} with a strength of {least.min():.2g}", expected, remedy)
