"""Answers of the checks of a snapshot, and how numbers of a file are recognised."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from typing import Any, Literal, NamedTuple, get_args

import numpy as np

from loops import GrainGraph, find_crossings
from loops.arrays import Floats
from loops.errors import Counting

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


@cache
def sentences() -> dict[str, Any]:
    """Sentences of the checks and of their cases, see findings.toml."""
    return tomllib.loads((Path(__file__).parent / "findings.toml").read_text(encoding="utf-8"))


def finding(check: str, number: float, case: str = "ok", **values: object) -> Finding:
    """Finding of a check in a case of findings.toml, whose sentences show the values."""
    common = sentences()[check]
    own = {} if case == "ok" else common[case]
    severity: Severity = "error" if "error" in own else "doubt" if "doubt" in own else "ok"
    says = own.get("says", common.get("says")) + own.get(severity, "")
    values["number"] = number
    says, remedy = (Counting().format(words, **values) for words in (says, own.get("remedy", "")))
    return Finding(check, number, says, severity, remedy)


def crossings(graph: GrainGraph) -> Finding:
    """Finding on branches that cross: loops need a plane network."""
    count = len(find_crossings(graph, MOST_CROSSINGS))
    return finding("crossings", float(count), "some" if count else "ok")


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
