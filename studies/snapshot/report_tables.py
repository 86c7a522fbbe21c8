"""A summary as tables of HTML."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from html import escape
from typing import Any

import numpy as np

# A row of more values is turned into a column.
WIDEST = 9
# Keys that have places of their own.
APART = ("definitions", "notes", "provenance")


def summary_tables(summary: Mapping[str, Any]) -> str:
    """Every key of a summary: plain values in one table, the others in one each.

    Parameters
    ----------
    summary : mapping
        Plain values, arrays and mappings of them; `definitions` explains keys.

    Returns
    -------
    str
        HTML.
    """
    told = summary.get("definitions", {})
    shown = {key: summary[key] for key in sorted(summary) if key not in APART}
    plain = {key: value for key, value in shown.items() if not isinstance(value, Mapping)}
    parts = [plain_table(plain, told)]
    for key, value in shown.items():
        if isinstance(value, Mapping) and value:
            about = f'<p class="about">{escape(told[key])}.</p>' if key in told else ""
            parts.append(f"<h3>{escape(key)}</h3>{about}{mapping_table(value)}")
    return "\n".join(parts)


def mapping_table(values: Mapping[str, Any]) -> str:
    """A table of nested mappings: a row for each innermost one, its path in front.

    Parameters
    ----------
    values : mapping
        Values, or mappings of them to any depth.

    Returns
    -------
    str
        HTML.
    """
    rows = list(_innermost(values, ()))
    if not rows:
        return "<p>–</p>"
    if len(rows) == 1 and not rows[0][0] and len(rows[0][1]) > WIDEST:
        return plain_table(rows[0][1])
    columns = list(dict.fromkeys(name for _, row in rows for name in row))
    depth = max(len(path) for path, _ in rows)
    return _table(depth, rows, columns)


def definitions_list(told: Mapping[str, str]) -> str:
    """Definitions of the keys, as a table.

    Parameters
    ----------
    told : mapping of str to str
        Meaning of each key.

    Returns
    -------
    str
        HTML.
    """
    lines = "".join(
        f'<tr><td>{escape(key)}</td><td class="text">{escape(told[key])}</td></tr>'
        for key in sorted(told)
    )
    return f'<div class="scroll"><table><tbody>{lines}</tbody></table></div>'


def value_text(value: Any) -> str:
    """A value with six digits; a dash for what is not known.

    Parameters
    ----------
    value : any
        Number, text, list, array.

    Returns
    -------
    str
        Plain text.

    Examples
    --------
    >>> from studies.snapshot.report_tables import value_text
    >>> value_text(0.1234567), value_text(True), value_text(None), value_text([[1, 2.5], [0, 1]])
    ('0.123457', 'yes', '–', '[[1, 2.5], [0, 1]]')
    """
    if isinstance(value, np.ndarray):
        value = value.tolist()
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(map(value_text, value)) + "]"
    if value is None or (isinstance(value, (float, np.floating)) and not np.isfinite(value)):
        return "–"
    if isinstance(value, (bool, np.bool_)):
        return "yes" if value else "no"
    if isinstance(value, (float, np.floating)):
        return f"{value:.6g}"
    return str(value)


def plain_table(values: Mapping[str, Any], told: Mapping[str, str] | None = None) -> str:
    """A table with one row a key, and what it means.

    Parameters
    ----------
    values : mapping
        Plain values.
    told : mapping of str to str, optional
        Meanings.

    Returns
    -------
    str
        HTML.
    """
    said = told or {}
    lines = "".join(
        f"<tr><td>{escape(key)}</td><td>{escape(value_text(value))}</td>"
        f'<td class="text">{escape(said.get(key, ""))}</td></tr>'
        for key, value in values.items()
    )
    return f'<div class="scroll"><table><tbody>{lines}</tbody></table></div>'


def _innermost(
    values: Mapping[str, Any], path: tuple[str, ...]
) -> Iterator[tuple[tuple[str, ...], Mapping[str, Any]]]:
    """Mappings without mappings in them, with the keys that lead there."""
    plain = {key: value for key, value in values.items() if not isinstance(value, Mapping)}
    if plain:
        yield path, plain
    for key, value in values.items():
        if isinstance(value, Mapping):
            yield from _innermost(value, (*path, str(key)))


def _table(
    depth: int,
    rows: list[tuple[tuple[str, ...], Mapping[str, Any]]],
    columns: list[str],
) -> str:
    head = "".join(f"<th>{escape(str(name))}</th>" for name in [*([""] * depth), *columns])
    lines = []
    for path, row in rows:
        front = [*path, *([""] * (depth - len(path)))]
        cells = [escape(name) for name in front]
        cells += [escape(value_text(row[name])) if name in row else "" for name in columns]
        lines.append("<tr>" + "".join(f"<td>{cell}</td>" for cell in cells) + "</tr>")
    return (
        f'<div class="scroll"><table><thead><tr>{head}</tr></thead>'
        f"<tbody>{''.join(lines)}</tbody></table></div>"
    )
