"""What the diamond study is asked: one of the paper's tables, or a diamond of one's own."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np

from loops import InputError
from patterns.diamond import TABLE_1, TABLE_2
from patterns.diamond import DiamondParameters as LoopParameters

Closure = Literal["affine", "traction"]
Sliding = Literal["coulomb", "printed"]
OnTouch = Literal["ignore", "stop", "add"]
Model = Literal["auto", "full"]
TABLES = {1: TABLE_1, 2: TABLE_2}
OWN = ("alpha0_deg", "kappa", "phi_deg", "confine")


@dataclass(frozen=True)
class DiamondParameters:
    """Arguments of the study. Angles in degrees; what is left out is Table 1's.

    Parameters
    ----------
    table : {1, 2}, optional
        One of the paper's sets of parameters, instead of the next four.
    alpha0_deg : float, optional
        Reference angle between branch and axis 1, in (0, 90) degrees.
    kappa : float, optional
        Stiffness ratio `kt/kn`, zero or more.
    phi_deg : float, optional
        Contact friction angle in [0, 90] degrees; 90 means that nothing slides.
    confine : float, optional
        Isotropic strain at the confined state A, in [0, 1).
    closure : {'affine', 'traction'}
        Closure of the generic operator. The diamond's is the same under both.
    sliding : {'coulomb', 'printed'}
        Rule of sliding contacts: `T' = s mu N'` with `s = sign(T)`, or (8c) as printed.
    contact_on_touch : {'ignore', 'stop', 'add'}
        What follows when opposite grains meet: nothing (the paper), the end of the path, or a
        contact between them that starts unloaded.
    model : {'auto', 'full'}
        The paper's diamond, its two freedoms by symmetry; or four grains followed besides, all
        freedoms and contacts by themselves, to check it.

    Raises
    ------
    InputError
        If a value leaves its range, a table is named together with values of one's own, or
        contacts are to be added between grains that overlap from the start.

    Examples
    --------
    >>> from studies.diamond import DiamondParameters
    >>> DiamondParameters(table=2).described()["alpha0_deg"]
    35.0
    """

    table: int | None = None
    alpha0_deg: float | None = None
    kappa: float | None = None
    phi_deg: float | None = None
    confine: float | None = None
    closure: Closure = "affine"
    sliding: Sliding = "coulomb"
    contact_on_touch: OnTouch = "ignore"
    model: Model = "auto"

    def __post_init__(self) -> None:
        _one_of("closure", self.closure, get_args(Closure))
        _one_of("sliding", self.sliding, get_args(Sliding))
        _one_of("contact-on-touch", self.contact_on_touch, get_args(OnTouch))
        _one_of("model", self.model, get_args(Model))
        own = [name for name in OWN if getattr(self, name) is not None]
        if self.table is not None:
            _one_of("table", self.table, tuple(TABLES))
            if own:
                raise InputError(
                    "--table",
                    f"a table and {', '.join(own)}",
                    "one or the other",
                    "Leave --table out to choose parameters of your own.",
                )
        _inside("--alpha0", self.alpha0_deg, lambda a: 0.0 < a < 90.0, "degrees in (0, 90)")
        _inside("--kappa", self.kappa, lambda k: k >= 0.0, "a ratio of zero or more")
        _inside("--phi", self.phi_deg, lambda p: 0.0 <= p <= 90.0, "degrees in [0, 90]")
        _inside("--confine", self.confine, lambda e: 0.0 <= e < 1.0, "a strain in [0, 1)")
        if self.contact_on_touch == "add" and self.alpha0_deg is not None:
            expected = "30 to 60 degrees with --contact-on-touch add: elsewhere opposite grains "
            expected += "overlap from the start"
            _inside("--alpha0", self.alpha0_deg, lambda a: 30.0 <= a <= 60.0, expected)

    def loop(self) -> LoopParameters:
        """Parameters of the diamond itself, in radians.

        Returns
        -------
        patterns.diamond.DiamondParameters
        """
        given = TABLES[self.table or 1]
        return LoopParameters(
            alpha0=given.alpha0 if self.alpha0_deg is None else float(np.radians(self.alpha0_deg)),
            kappa=given.kappa if self.kappa is None else self.kappa,
            phi=given.phi if self.phi_deg is None else float(np.radians(self.phi_deg)),
            confinement=given.confinement if self.confine is None else self.confine,
        )

    def described(self) -> dict[str, Any]:
        """Every value in force, under the names of the command line.

        Returns
        -------
        dict
        """
        loop = self.loop()
        return {
            "table": self.table,
            "alpha0_deg": round(float(np.degrees(loop.alpha0)), 12),
            "kappa": loop.kappa,
            "phi_deg": round(float(np.degrees(loop.phi)), 12),
            "mu": loop.mu,
            "confine": loop.confinement,
            "closure": self.closure,
            "sliding": self.sliding,
            "contact_on_touch": self.contact_on_touch,
            "model": self.model,
        }


def _one_of(name: str, value: Any, choices: tuple[Any, ...]) -> None:
    if value not in choices:
        *others, last = (str(choice) for choice in choices)
        expected = f"{', '.join(others)} or {last}"
        raise InputError(f"--{name}", str(value), expected, "Pick one of these.")


def _inside(name: str, value: float | None, holds: Any, expected: str) -> None:
    if value is not None and not (np.isfinite(value) and holds(value)):
        raise InputError(name, f"{value:.17g}", expected, "Correct it.")
