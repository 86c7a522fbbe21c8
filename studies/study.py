"""The frame of every study: one folder with its tables, summary, figures and report."""

from __future__ import annotations

import tomllib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from loops.errors import InputError
from studies.output import provenance, result_folder, write_summary, write_table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from studies.snapshot.polygons import LoopsForMap


@dataclass(frozen=True)
class Results:
    """Files of one study in `folder`; each keeps the provenance `source`."""

    folder: Path
    source: dict[str, Any]
    csv: bool = False

    def write_tables(self, tables: Mapping[str, Any]) -> None:
        """Write tables by name as Parquet (and CSV if `csv`): data frames, or arrays by column."""
        for name, table in tables.items():
            write_table(self.folder, name, table, self.source, csv=self.csv)

    def write_summary(self, summary: Mapping[str, Any]) -> dict[str, Any]:
        """Write `summary.json`; return the summary with its provenance."""
        whole = {**summary, "provenance": self.source}
        write_summary(self.folder, whole)
        return whole

    def save_figures(self, figures: Iterable[tuple[str, Figure]]) -> list[Path]:
        """Save each figure as PNG and SVG when it has been drawn; return the PNG files.

        A generator keeps one figure in memory at a time.
        """
        # matplotlib is loaded only if something is drawn.
        from studies.style import save_figure

        saved = []
        for name, figure in figures:
            save_figure(figure, self.folder, name, self.source)
            saved.append(self.folder / f"{name}.png")
        return saved

    def write_report(
        self,
        title: str,
        summary: Mapping[str, Any],
        pictures: Sequence[Path],
        maps: Sequence[LoopsForMap],
        largest: int | None = None,
    ) -> None:
        """Write `report.html` with the pictures under their captions, and the maps of loops.

        `largest` is the number of loops of the largest snapshot, by default `summary["loops"]`.
        """
        from studies.report import write_report

        told = captions(self.source["command"].split()[1])
        figures = []
        for picture in pictures:
            name, caption = told[picture.stem]
            figures.append((name, caption.format(**summary), picture))
        write_report(self.folder, title, summary, figures, maps, self.source, largest)


@contextmanager
def study(
    command: str,
    out: Path,
    configuration: Mapping[str, Any],
    units: str,
    *,
    force: bool = False,
    csv: bool = False,
) -> Iterator[Results]:
    """Open the results of a study; the folder `out` appears when the block has ended without error.

    A study reads its input, computes, writes tables and summary and, if figures are asked for,
    saves figures and writes the report, from top to bottom of the block.
    """
    with result_folder(out, force=force) as folder:
        yield Results(folder, provenance(command, configuration, units), csv)


def captions(command: str) -> dict[str, tuple[str, str]]:
    """Title and caption of each figure of a command, from `captions.toml`.

    A caption is a format string whose fields are keys of the study's summary.
    """
    text = (Path(__file__).parent / "captions.toml").read_text(encoding="utf-8")
    return {name: (title, said) for name, (title, said) in tomllib.loads(text)[command].items()}


def one_of(name: str, value: Any, choices: tuple[Any, ...]) -> None:
    """Raise `InputError` for a word that is none of the choices."""
    if value not in choices:
        *others, last = (str(choice) for choice in choices)
        expected = f"{', '.join(others)} or {last}"
        raise InputError(name, repr(value), expected, "Pick one of these.")
