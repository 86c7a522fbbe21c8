"""Answers of the checks of a snapshot, and how numbers of a file are recognised."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Literal, NamedTuple, get_args

import numpy as np

from loops import GrainGraph, find_crossings
from loops.arrays import Floats
from loops.shown import counted

Severity = Literal["ok", "doubt", "error"]
SEVERITIES: tuple[Severity, ...] = get_args(Severity)
# Pairs of crossing branches that are counted.
MOST_CROSSINGS = 1_000_000
# Powers of ten and ratios of 1 are recognised within this.
NEAR_ROUND = 0.05


class Finding(NamedTuple):
    """Result of one check: its number, a sentence with the likely cause, and the remedy."""

    check: str
    number: float
    says: str
    severity: Severity = "ok"
    remedy: str = ""

    def __str__(self) -> str:
        return f"{self.says}. {self.remedy}"

    def doubt(self, cause: str, remedy: str, holds: bool = True) -> Finding:
        """The finding as a doubt with its likely cause, if `holds`."""
        said = self._replace(says=f"{self.says}{cause}", severity="doubt", remedy=remedy)
        return said if holds else self

    def error(self, cause: str, remedy: str) -> Finding:
        """The finding as an error, after which no result means anything."""
        return self._replace(says=f"{self.says}{cause}", severity="error", remedy=remedy)


def crossings(graph: GrainGraph) -> Finding:
    """Finding on branches that cross: loops need a plane network."""
    count = len(find_crossings(graph, MOST_CROSSINGS))
    found = Finding(
        "crossings",
        float(count),
        counted(count, "pair of branches crosses", "pairs of branches cross"),
    )
    if not count:
        return found
    return found.error(
        ": opposite grains of a loop overlap, or the cell is wrong",
        "Give the right cell, or leave out one of each pair by --drop-crossings.",
    )


def worst_severity(findings: Sequence[Finding]) -> Severity:
    """Worst severity of the findings."""
    return max((one.severity for one in findings), key=SEVERITIES.index, default="ok")


def rounding(values: Floats) -> float:
    """Half the last digit that numbers show: of single precision, of text of 6 to 9 digits."""
    flat = values.ravel()
    shown = flat[:: max(1, len(flat) // 100)]
    size = float(np.abs(shown).max(initial=0.0))
    if (shown.astype(np.float32) == shown).all():
        return size * 2.0**-24
    for digits in (6, 7, 8, 9):
        if all(float(f"{value:.{digits}g}") == value for value in shown.tolist()):
            return 0.5 * size * 10.0 ** (1 - digits)
    return 1e-15 * size


def few(items: Any, text: Callable[[Any], str] = str, most: int = 3, mark: str = ", ") -> str:
    """The first of some items, an array or a list, for a message."""
    return mark.join(text(one) for one in items[:most]) + f"{mark}..." * (len(items) > most)


def power_of_ten(ratio: float) -> str:
    """The power of ten that a ratio is, as text, or nothing."""
    power = round(np.log10(ratio)) if ratio > 0 else 0
    near = power != 0 and abs(np.log10(ratio) - power) < NEAR_ROUND
    return f"10^{power}" if near else ""
