"""Reading the documentation's pages: their tables, and the numbers that they quote."""

import re
from pathlib import Path

DOCS = Path(__file__).parents[2] / "docs"
NUMBER = re.compile(r"(?<![\w.])-?\d+(?:\.\d+)?(?:e[+-]?\d+)?(?![\w.]*\w)")


def page(name):
    return (DOCS / f"{name}.md").read_text()


def section(text, title):
    """What stands under a heading, up to the next one of its level or above."""
    level = len(title) - len(title.lstrip("#"))
    rest = text.split(f"\n{title}", 1)[1].split("\n", 1)[1]
    return re.split(rf"\n#{{1,{level}}} ", rest)[0]


def sections(text):
    """Titles and texts of what stands under the headings of the second level."""
    return [part.split("\n", 1) for part in text.split("\n## ")[1:]]


def tables(text):
    """Every table: a list of rows, each a dict by the column's title."""
    found = []
    for block in re.findall(r"(?:^\|.*\|\n?)+", text, re.MULTILINE):
        head, _, *rows = [
            [cell.strip() for cell in line.strip().strip("|").split("|")]
            for line in block.strip().splitlines()
        ]
        found.append([dict(zip(head, row, strict=False)) for row in rows])
    return found


def digits(token):
    """Significant digits of a number as it is written."""
    return len(re.sub(r"e.*|[-.]", "", token).lstrip("0"))


def says(token, value):
    """Whether a number as written is a value, rounded to its last place."""
    exponent = re.search(r"e([+-]?\d+)", token)
    mantissa = re.sub(r"e.*", "", token)
    places = len(mantissa.partition(".")[2])
    place = 10.0 ** ((int(exponent[1]) if exponent else 0) - places)
    return abs(float(token) - value) <= 0.5000001 * place


def unsaid(text, values, least=4):
    """Numbers of at least so many digits on a page that are none of the values."""
    tokens = {token for token in NUMBER.findall(text) if digits(token) >= least}
    return sorted(token for token in tokens if not any(says(token, value) for value in values))


def of_size(found, quoted, floor=1e-15):
    """Whether an error is of the quoted size or smaller: rounding differs between machines."""
    return found <= 10.0 * max(quoted, floor)
