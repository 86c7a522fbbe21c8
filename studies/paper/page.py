"""The page: equations, tables, figures and departures, written from the numbers of a run."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from typing import Any

from studies.paper.numbers import POINT_B, STATE_VALUES
from studies.paper.prose import beside_figures, departures, rounding, verdict
from studies.paper.text import EQUATIONS, FIGURES, GIVEN, HEAD, READINGS


def page(numbers: dict[str, Any]) -> str:
    """The page in Markdown.

    Parameters
    ----------
    numbers : dict
        From `collect`.

    Returns
    -------
    str
    """
    sections = [
        HEAD,
        f"## In short\n\n{wrapped(verdict(numbers))}",
        _equations(numbers["equations"]),
        *(_table(table, numbers["tables"][table]) for table in POINT_B),
        _figures(numbers),
        "## Departures\n\n" + "\n".join(wrapped(text) for text in departures(numbers)),
    ]
    return "\n".join(sections)


def figure_file(table: int, name: str) -> str:
    """File of a figure within `figures`.

    Parameters
    ----------
    table : {1, 2}
        The paper's table.
    name : str
        The study's name of the figure.

    Returns
    -------
    str

    Examples
    --------
    >>> from studies.paper.page import figure_file
    >>> figure_file(2, "axial_stress")
    'paper-table2-axial-stress.png'
    """
    return f"paper-table{table}-{name.replace('_', '-')}.png"


def markdown_table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table in Markdown.

    Parameters
    ----------
    head : sequence of str
        Titles of the columns.
    rows : sequence of sequences of str
        Cells.

    Returns
    -------
    str

    Examples
    --------
    >>> from studies.paper.page import markdown_table
    >>> print(markdown_table(["a", "b"], [["1", "2"]]))
    | a | b |
    |---|---|
    | 1 | 2 |
    """
    first, *others = ["| " + " | ".join(line) + " |" for line in (head, *rows)]
    return "\n".join([first, "|" + "---|" * len(head), *others])


def wrapped(text: str) -> str:
    """A paragraph of lines up to 100 characters.

    Parameters
    ----------
    text : str
        Its words; line breaks between them do not matter.

    Returns
    -------
    str
        Ends with a line break.

    Examples
    --------
    >>> from studies.paper.page import wrapped
    >>> print(wrapped("one   paragraph"), end="")
    one paragraph
    """
    words = " ".join(text.split())
    return textwrap.fill(words, 100, break_long_words=False, break_on_hyphens=False) + "\n"


def _equations(residuals: dict[str, float]) -> str:
    rows = [[number, said, held, rounding(residuals[key])] for number, said, held, key in EQUATIONS]
    table = markdown_table(["equation", "what", "held against", "largest difference"], rows)
    return f"## Equations\n\n{table}\n\n{READINGS}\n"


def _table(table: int, found: dict[str, Any]) -> str:
    events = ", ".join(f"`{kind}` {_value(E1)}" for kind, E1 in found["events"])
    return (
        f"## Table {table}: {GIVEN[table]}\n\n"
        f"{_states(found)}\n\n"
        f"{wrapped(f'Events in order, with E1: {events}.')}\n"
        f"{_checks(found)}\n"
    )


def _states(found: dict[str, Any]) -> str:
    states, beyond = found["states"], found["beyond"]
    rows = [
        [f"`{key}`", *(_value(states[k][key]) for k in ("I", "A", "B"))] for key in STATE_VALUES
    ]
    rows += [[f"`{key}`, sliding", "", "", _value(beyond[key])] for key in ("det_K", "det_Ks")]
    return markdown_table(["", "I", "A", "B"], rows)


def _checks(found: dict[str, Any]) -> str:
    checks, slopes = found["verification"], found["slopes"]
    differences = {
        "point B against 20 digits (E1, E2, s1)": found["point_B_difference"],
        "I, (41), against a root of the generic operator": checks["det_K_zero_by_root_difference"],
        "(33) at A against differences of the exact path": slopes["at_A_difference"],
        "(26) against the generic operator on the path": checks[
            "generic_vs_closed_form_max_relative"
        ],
        "det K, (35) and (36), against (26)": checks["det_K_max_difference"],
        "energy: work less stored less heat, over the work": checks["energy_balance_max_relative"],
    }
    rows = [[said, rounding(value)] for said, value in differences.items()]
    rows.append(["slope `det K/K22` at A (33)", _value(slopes["at_A"])])
    return markdown_table(["check", "measured"], rows)


def _figures(numbers: dict[str, Any]) -> str:
    said, parts = beside_figures(numbers), ["## Figures\n"]
    for number, table, name, caption in FIGURES:
        image = f"![{caption}](figures/{figure_file(table, name)})"
        parts.append(f"### {number}\n\n{image}\n\n{wrapped(f'{caption} {said[number, table]}')}")
    return "\n".join(parts)


def _value(value: float) -> str:
    """Ten significant digits; round-off about zero is zero."""
    return "0" if abs(value) < 1e-14 else f"{value:.10g}"
