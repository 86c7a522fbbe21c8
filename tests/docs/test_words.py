"""One word for one thing: what `docs/notation.md` calls otherwise stands nowhere."""

import re
from pathlib import Path

import pytest

from tests.docs.pages import page

ROOT = Path(__file__).parents[2]
ROOMS = ("grainloops", "loops", "patterns", "stability", "studies")
FORBIDDEN = ("foretell", "foretold", "foresee", "foreseen", "at its cone", "at their cone")
# Phrases that a reader of mechanics did not understand at first; each names nothing.
PHRASES = (
    "hold each", "without it nothing", "resist every strain", "held against", "silent in",
    "else rates alone", "pieces met", "laid over as", "regimes don't agree", "turns shear by",
    "two freedoms", "says nothing of", "keeps its row", "stands in neither", "holds there alone",
    "rooms where", "no grain feels", "no answer to", "disagree on the way", "share is unknown",
    "held from turning", "stand around the loop", "is finished is kept", "goes on without",
    "are not answered", "as each direction asks", "long: as large", "way past",
    "no way on",
)  # fmt: skip
TEXTS = [
    *(ROOT / "docs").rglob("*.md"),
    ROOT / "README.md",
    *(
        path
        for room in ROOMS
        for ending in ("py", "toml", "js", "html")
        for path in (ROOT / room).rglob(f"*.{ending}")
    ),
]


@pytest.mark.parametrize("word", (*FORBIDDEN, *PHRASES))
def test_words_that_the_notation_replaces_are_used_nowhere(word):
    pattern = re.compile(rf"\b{word}s?\b", re.IGNORECASE)
    found = []
    for path in TEXTS:
        if "gallery" in path.parts:
            continue
        text = path.read_text(encoding="utf-8")
        if path.name == "notation.md":
            text = text.partition("## Words")[0]
        lines = text.split("\n")
        found += [
            f"{path.relative_to(ROOT)}:{k}"
            for k, line in enumerate(lines, 1)
            if pattern.search(line)
        ]
    assert found == []


def test_the_notation_says_which_words_these_are():
    words = page("notation").partition("## Words")[2]
    for word in ("snapshot", "opposite contact", "regime", "at yield", "residual", "predict"):
        assert f"| {word} |" in words
    assert "foretell, foresee" in words and "at its cone" in words


@pytest.mark.parametrize("name", [
    "patterns/snapshots/findings.toml", "studies/lines.toml", "studies/captions.toml"
])  # fmt: skip
def test_counts_of_templates_have_a_singular(name):
    """`{n:#force}` is written "1 force", "2 forces"; `{n} forces` would be "1 forces"."""
    nouns = (
        "forces|contacts|grains|loops|rows|walls|pairs|snapshots|steps|directions|intervals|ways"
    )
    plain = re.compile(rf"\{{[^}}#]*\}} (?:unstable )?(?:{nouns})\b")
    assert plain.findall((ROOT / name).read_text()) == []
    assert plain.search("{n} unstable contacts") and not plain.search("{n:#pair}")
