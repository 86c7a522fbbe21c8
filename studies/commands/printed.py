"""Printed answers: the templates of `lines.toml`, filled with the values of a summary."""

from __future__ import annotations

import re
from collections.abc import Mapping
from string import Formatter
from typing import Any

from loops.lazy import named

# Conditions of a part of a line: a value holds, is unknown, does not hold throughout.
CONDITIONS = {
    "?": bool,
    "!": lambda value: value is None,
    "~": lambda value: not (all(value) if isinstance(value, list) else value),
}
CONDITION = re.compile(r"([?!~])([\w\[\] ]+):")
# Counts by name, what stands between them, and words behind each count.
COUNTS_AS = {"counts": ("{1}{2} {0}", ", "), "counted": ("{0}: {1}{2}", ", "),
             "spaced": ("{0}: {1}{2}", "  "), "met": ("{0} on {1}{2}", ", ")}  # fmt: skip
COUNTS = re.compile("|".join(COUNTS_AS))
# A zero with a minus: a number that is rounded to zero from below.
MINUS_ZERO = re.compile(r"(?<![\w.)-])-(?=0(?:\.0+)?(?:e[+-]\d+)?(?!\.?\w))")
# Digits and width of a number that may be unknown: '3' or '3>7'.
DIGITS = re.compile(r"(\d)([<>]\d+)?")


def _words(part: str) -> dict[str, Any]:
    """Part of `lines.toml`, which is read only where something is printed."""
    found: dict[str, Any] = named("studies.output.words")("lines")[part]
    return found


class Filling(Formatter):
    """Format strings over a summary, with formats of their own (see `lines.toml`)."""

    def get_field(self, field_name: str, args: Any, kwargs: Any) -> Any:
        """Value of a name such as `replay[end]`; None where there is none."""
        try:
            return super().get_field(field_name, args, kwargs)
        except (KeyError, TypeError):
            return None, field_name

    def value(self, name: str, row: Mapping[str, Any]) -> Any:
        """Value of a name in a row."""
        return self.get_field(name, (), row)[0]

    def format_field(self, value: Any, spec: str) -> str:
        """A value in one of the formats of printed lines, else in Python's."""
        kind, _, table = spec.partition("/")
        known = _words("words").get(table, {})
        if kind == "word":
            return str(known.get(value, value))
        if kind.startswith("#"):
            return str(named("loops.shown.counted")(value, kind[1:], table))
        if counting := COUNTS.match(kind):
            template, between = COUNTS_AS[counting[0]]
            counts = ((known.get(name, name), count) for name, count in value.items())
            words = (template.format(*count, kind[counting.end() :]) for count in counts)
            return between.join(words) or "none"
        if kind == "values":
            numbers = {n: "-" if number is None else f"{number:.6g}" for n, number in value.items()}
            return "  ".join(f"{name} = {number}" for name, number in numbers.items())
        if kind == "spread":
            return f" (spread {100 * value:.3g} %)"
        if kind == "axes":
            return str(value[1:])
        if kind.startswith("%"):
            return format(100 * value, kind[1:])
        if isinstance(value, tuple):
            return ", ".join(format(one, spec) for one in value)
        if digits := DIGITS.fullmatch(kind):
            number = "-" if value is None else f"{value:.{digits[1]}f}"
            return format(number, digits[2] or "")
        return str(format(value, spec))

    def filled(self, template: str, row: Mapping[str, Any]) -> str | None:
        """Text of a template; None where its first part is left out."""
        parts = [self._part(part, row) for part in template.split("|")]
        return None if parts[0] is None else MINUS_ZERO.sub("", "".join(p or "" for p in parts))

    def _part(self, part: str, row: Mapping[str, Any]) -> str | None:
        """Text of a part of a line; None where its condition fails or a value is unknown."""
        if condition := CONDITION.match(part):
            sign, name = condition.groups()
            if not CONDITIONS[sign](self.value(name, row)):
                return None
            part = part[condition.end() :]
        for _, name, spec, _ in self.parse(part):
            if name and self.value(name, row) is None and not DIGITS.fullmatch(spec or ""):
                return None
        return self.vformat(part, (), row)


def shown(value: float | None) -> str:
    """A number with three digits, a dash for none."""
    return Filling().format_field(value, "3")


def printed(command: str, summary: Mapping[str, Any], **more: Any) -> list[str]:
    """Printed lines of a command: its templates over the keys of the summary, and `more` values.

    A template in a pair with the name of a mapping, or of a list, has a line for each of its items.
    """
    whole, lines = {**summary, **more}, list[str]()
    for line in _words("lines")[command]:
        each, template = ("", line) if isinstance(line, str) else line
        rows = _rows(whole, each) if each else [whole]
        told = (Filling().filled(template, row) for row in rows)
        lines += [text for text in told if text is not None]
    return lines


def driven_line(summary: Mapping[str, Any]) -> str:
    """Line that names the driven axis and that of the major stress at the start."""
    axial = not summary["programme"].startswith("isotropic")
    major = summary["axis"] == summary["major_axis"]
    kinds = {"axial": axial, "along": axial and major, "across": axial and not major}
    return printed("driven", summary, **kinds)[0]


def _rows(whole: Mapping[str, Any], each: str) -> list[dict[str, Any]]:
    """Values of each item: its own, its `name` in a mapping, and those of the whole."""
    items = whole.get(each) or ()
    if isinstance(items, Mapping):
        items = [_item(value) | {"name": name} for name, value in items.items()]
    return [{**whole, **_item(value)} for value in items]


def _item(value: Any) -> dict[str, Any]:
    """Keys of an item; one that has none is the `value`."""
    return dict(value) if isinstance(value, Mapping) else {"value": value}
