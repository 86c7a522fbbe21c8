"""What the polygon study is asked: a regular loop, its contacts, and how it is loaded."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np

from loops import GrainGraph, InputError, LinearFrictional
from patterns import regular_polygon
from stability import Programme, Stage, programmes

Orientation = Literal["vertex", "edge"]
Closure = Literal["affine", "traction"]
Spins = Literal["blocked", "affine", "free"]
ProgrammeName = Literal["drained", "isotropic", "isotropic-stress", "oedometric", "undrained"]
Model = Literal["auto", "full"]
SUBSPACES = ("diagonal", "symmetric", "full")
PROGRAMMES: dict[str, Callable[[], Programme]] = {
    "drained": programmes.drained_biaxial,
    "isotropic": programmes.isotropic_strain,
    "isotropic-stress": programmes.isotropic_stress,
    "oedometric": programmes.oedometric,
    "undrained": programmes.undrained,
}
# Share of the length left at A that the second stage takes up, if nobody says where it ends.
WAY = 0.4
LONGEST = 1000


@dataclass(frozen=True)
class PolygonParameters:
    """Arguments of the study. Angles in degrees; grains of diameter 1, `kn = 1`.

    Parameters
    ----------
    order : int
        Number of grains n, 3 to 1000.
    orientation : {'vertex', 'edge'}
        A corner on axis 1, or an edge across it.
    kappa : float
        Stiffness ratio `kt/kn`, zero or more.
    phi_deg : float
        Contact friction angle in [0, 90] degrees; 90 means that nothing slides.
    closure : {'affine', 'traction'}
        How the surrounding medium drives the grains.
    spins : {'blocked', 'affine', 'free'}
        What the grains' spins do.
    confine : float
        Isotropic strain at the confined state A, in [0, 1).
    programme : str
        What follows A: 'drained' (H11 driven, P22 held), 'isotropic' (strain), 'isotropic-stress',
        'oedometric', 'undrained' (constant area); `H12 = H21 = 0` in all.
    end : float, optional
        E1 where it ends, above `confine` and below 1; `confine + 0.4 (1 - confine)` if left out.
    model : {'auto', 'full'}
        The smallest model that the loop's symmetry leaves, or all freedoms and contacts.

    Raises
    ------
    InputError
        If a value leaves its range or a word is unknown.

    Examples
    --------
    >>> from studies.polygon import PolygonParameters
    >>> PolygonParameters(6, confine=0.1).last_strain
    0.46
    """

    order: int
    orientation: Orientation = "vertex"
    kappa: float = 0.2
    phi_deg: float = 5.0
    closure: Closure = "affine"
    spins: Spins = "blocked"
    confine: float = 0.1
    programme: ProgrammeName = "drained"
    end: float | None = None
    model: Model = "auto"

    def __post_init__(self) -> None:
        if not (int(self.order) == self.order and 3 <= self.order <= LONGEST):
            raise InputError(
                "--order", str(self.order), f"a whole number from 3 to {LONGEST}", "Correct it."
            )
        one_of("--orientation", self.orientation, get_args(Orientation))
        one_of("--closure", self.closure, get_args(Closure))
        one_of("--spins", self.spins, get_args(Spins))
        one_of("--model", self.model, get_args(Model))
        one_of("--programme", self.programme, get_args(ProgrammeName))
        inside("--kappa", self.kappa, self.kappa >= 0.0, "a ratio of zero or more")
        inside("--phi", self.phi_deg, 0.0 <= self.phi_deg <= 90.0, "degrees in [0, 90]")
        inside("--confine", self.confine, 0.0 <= self.confine < 1.0, "a strain in [0, 1)")
        if self.end is not None:
            expected = f"a strain above that of A, {self.confine:g}, and below 1"
            inside("--end", self.end, self.confine < self.end < 1.0, expected)

    @property
    def last_strain(self) -> float:
        """E1 at the end of the programme."""
        if self.end is not None:
            return self.end
        return round(self.confine + WAY * (1.0 - self.confine), 12)

    @property
    def mu(self) -> float:
        """Friction coefficient, infinite when nothing slides."""
        return float(np.tan(np.radians(self.phi_deg))) if self.phi_deg < 90.0 else float("inf")

    def loop(self) -> GrainGraph:
        """The barely touching loop.

        Returns
        -------
        GrainGraph
        """
        return regular_polygon(self.order, orientation=self.orientation)

    def law(self) -> LinearFrictional:
        """The law of its contacts.

        Returns
        -------
        LinearFrictional
        """
        return LinearFrictional(kn=1.0, kt=self.kappa, mu=self.mu)

    def stages(self) -> list[Stage]:
        """The confinement, left out where there is none, and the programme.

        Returns
        -------
        list of Stage
        """
        confinement = Stage(programmes.isotropic_strain(), "H11", self.confine)
        loading = Stage(PROGRAMMES[self.programme](), "H11", self.last_strain)
        return [confinement, loading] if self.confine > 0.0 else [loading]

    def described(self) -> dict[str, Any]:
        """Every value in force, under the names of the command line.

        Returns
        -------
        dict
        """
        return {
            "order": self.order,
            "orientation": self.orientation,
            "kappa": self.kappa,
            "phi_deg": self.phi_deg,
            "mu": self.mu,
            "closure": self.closure,
            "spins": self.spins,
            "confine": self.confine,
            "programme": self.programme,
            "end": self.last_strain,
            "model": self.model,
        }


def one_of(name: str, value: Any, choices: tuple[Any, ...]) -> None:
    """Refuse a word that is none of the choices.

    Parameters
    ----------
    name : str
        Of the option.
    value : object
        What was given.
    choices : tuple
        What is known.

    Raises
    ------
    InputError
        If the value is none of them.
    """
    if value not in choices:
        *others, last = (str(choice) for choice in choices)
        expected = f"{', '.join(others)} or {last}"
        raise InputError(name, repr(value), expected, "Pick one of these.")


def inside(name: str, value: float, holds: bool, expected: str) -> None:
    """Refuse a number out of its range.

    Parameters
    ----------
    name : str
        Of the option.
    value : float
        What was given.
    holds : bool
        Whether it lies in its range.
    expected : str
        The range in words.

    Raises
    ------
    InputError
        If it doesn't hold, or the value is not finite.
    """
    if not (np.isfinite(value) and holds):
        raise InputError(name, f"{value:.17g}", expected, "Correct it.")
