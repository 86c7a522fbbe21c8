"""The study of one loop: its closures, its path and its domain on one page."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes

from loops import InputError
from loops.closures import Closure
from loops.errors import check_type, counted, path_of
from loops.errors import number as checked_number
from loops.scene import Scene, Subject
from loops.shown import Shown
from patterns import Snapshot, loop_of_snapshot
from patterns.snapshots.snapshot import snapshot_of
from stability import Path as LoopPath
from studies.clock import of_parts
from studies.domain import LoopDomain, loop_domain, loop_domain_figure
from studies.output import Summary, readable
from studies.paths.figures import polygon_figures
from studies.paths.followed import Followed, follow_loop
from studies.paths.options import ProgrammeName, loop_options
from studies.snapshot.in_packing import add_in_packing
from studies.snapshot.summary import JUDGE_TITLES
from studies.snapshot.table import CLOSURES, EIGENVALUES, FREE, PLACE, STABILITY, loop_columns
from studies.study import Drawings
from studies.study import study as results_in
from studies.style import BLUE, GREEN, GREY, VERMILION, outer_legend, panel


@dataclass(frozen=True, eq=False, repr=False)
class LoopStudy(Shown):
    """One loop under its closures, along a programme, and in all directions.

    Attributes
    ----------
    closures : pandas.DataFrame
        A row a closure (affine, traction, traction with free spins, in its packing): `verdict`,
        the eigenvalues of Ks over the mean kn in the symmetric subspace, `unstable_fraction`,
        `cone_opening` and `soft_angle` (degrees), and the bound `error` on the tangent over the
        mean kn, in the packing over its norm. An eigenvalue without a certain sign is no number.
    path : Path or None
        The programme from the state of the snapshot on, lengths over two mean radii of the loop,
        forces over the mean kn of its contacts. None where it has no answer, as of contacts that
        are no linear springs.
    domain : LoopDomain or None
        Ends of straight programmes in all directions, in the same units; without a path in those of
        the snapshot.
    summary : dict
        What `summary.json` has; `notes` say why there is no path, domain or packing.
    """

    closures: pd.DataFrame
    path: LoopPath | None
    domain: LoopDomain | None
    summary: Summary
    found: Followed | None

    def facts(self) -> dict[str, object]:
        """Facts that the prompt and a notebook show."""
        verdicts = dict(zip(self.closures["closure"], self.closures["verdict"], strict=True))
        if self.path is not None:
            events = counted(len(self.summary["events"]), "event")
            verdicts["path"] = f"{self.summary['status']}, {events}"
        return verdicts | ({} if self.domain is None else self.domain.facts())

    def figures(self) -> Drawings:
        """Figures of the page with their names."""
        yield "closures", lambda: draw_closures(self)
        if self.found is not None:
            yield from polygon_figures(self.found)
        if self.domain is not None:
            domains = {"present state": self.domain}
            yield "domain-strain", lambda: loop_domain_figure(domains, "strain")
            yield "domain", lambda: loop_domain_figure(domains, "stress")


def study(
    source: Snapshot | Subject,
    number: int | None = None,
    out: Path | str | None = None,
    *,
    closure: Closure = "traction",
    programme: ProgrammeName = "drained",
    end: float | None = None,
    in_packing: bool = True,
    named: str = "a snapshot",
    progress: Callable[..., object] = lambda *_: None,
    **how: Any,
) -> LoopStudy:
    """Study one loop, as `grainloops loop` does: closures, cone, path and domain.

    What can't be answered of this loop, or under its law, is left out, and a note says why.

    Parameters
    ----------
    source : Snapshot, or loop or scene
        A snapshot with `number`; or one loop, which has no packing.
    number : int, optional
        Of the loop in the column `loop` of `loop_table`.
    out : path, optional
        Folder for the report, tables and figures; nothing is written if left out.
    closure : {'affine', 'traction'}
        How the surrounding medium drives the grains along the path and in the domain.
    programme : str
        What is followed, a name of `grainloops polygon --programme`.
    end : float, optional
        E1 at its end, five mean overlaps if left out.
    in_packing : bool
        Judge the loop in its packing too.
    named : str
        Name of the snapshot in the report.
    progress : callable, optional
        Called with what is looked at.
    **how
        `force`, `csv` and `figures` of the folder.

    Returns
    -------
    LoopStudy
        `.closures`, `.path`, `.domain`; `.table()` and `.plot()` show the closures.

    Raises
    ------
    InputError
        If there is no loop of that number, or the snapshot has no forces.

    Examples
    --------
    >>> from patterns import read_snapshot, sample_path
    >>> found = study(read_snapshot(sample_path()), 62, in_packing=False)
    >>> found.closures["verdict"].tolist(), found.path.status
    (['stable', 'stable', 'unstable'], 'finished')
    """
    folder = None if out is None else path_of("out", out, "Name a folder.")
    end = None if end is None else checked_number("end", end)
    check_type("named", named, str, "Give a name, or leave it out.")
    check_type("progress", progress, Callable, "Give a function, or leave it out.")
    words: Any = {"closure": closure, "programme": programme, "end": end}
    snapshot = snapshot_of(source)
    options = loop_options(snapshot, number, named, **words)
    notes = list[str]()

    def tried(what: str, question: Callable[[], Any]) -> Any:
        progress(f"its {what}")
        try:
            return question()
        except InputError as error:
            notes.append(f"no {what} of this loop: {error}")

    progress("its closures")
    snapshot.mechanics()
    table = loop_columns(snapshot)
    if in_packing and isinstance(source, Snapshot):
        place = tried("closures in the packing", lambda: add_in_packing(snapshot, table, "auto"))
        notes += [] if place is None else place[1]
    closures = closure_table(table, options.loop)
    known = closures.astype(object).where(closures.notna(), None)
    configuration: dict[str, Any] = {"snapshot": options.source, "loop": options.loop}
    summary: Summary = {"notes": list(snapshot.notes)}
    subject: Subject = loop_of_snapshot(snapshot, options.loop)
    tables, unit = {"closures": closures}, "force/length"
    path = tried("path", lambda: follow_loop(options))
    if path is not None:
        configuration, summary = options.described(), path.summary()
        subject, unit = Scene(options.graph(), options.law()), "over $k_n$"
        tables |= path.tables()
    of_domain = of_parts(lambda text, *long: progress(f"its domain: {text}", *long), "programmes")
    domain = tried("domain", lambda: loop_domain(subject, options.closure, progress=of_domain))
    summary |= {"closures": known.to_dict("records"), "notes": summary["notes"] + notes}
    if domain is not None:
        domain = replace(domain, stress_unit=unit)
        ends = domain.rows["kind"].value_counts().to_dict()
        summary["domain"] = {"present_state": domain.status, "ended_by": ends}
        tables["boundary"] = domain.rows
    found = LoopStudy(closures, path and path.path, domain, summary, path)
    if folder is None:
        return found
    with results_in("loop", folder, configuration, **how) as results:
        title = f"Loop {options.loop} of {readable(named)}"
        summary = results.write_results(tables, summary, found.figures(), title)
    return replace(found, summary=summary)


def closure_table(table: Mapping[str, Any], loop: int) -> pd.DataFrame:
    """Columns of one loop in the table of loops, a row a closure."""
    rows = []
    for closure in (*CLOSURES, FREE, PLACE):
        if f"{closure}_{EIGENVALUES[0]}" in table:
            names = ((name, f"{closure}_{name}") for name in (*STABILITY, "error"))
            numbers = {name: float(table[own][loop]) for name, own in names if own in table}
            smallest = numbers[EIGENVALUES[0]]
            verdict = "stable" if smallest > 0.0 else "unstable"
            verdict = "undetermined" if np.isnan(smallest) else verdict
            rows.append({"closure": closure, "verdict": verdict, **numbers})
    return pd.DataFrame(rows)


@panel(height=2.2)
def draw_closures(found: LoopStudy, ax: Axes) -> None:
    """Eigenvalues of Ks under each closure, with the bound on their error."""
    closures = found.closures
    ax.axvline(0.0, color=GREY, linewidth=0.6)
    labels = ("smallest", "second", "largest")
    looks = zip(EIGENVALUES, labels, "osD", (VERMILION, BLUE, GREEN), strict=True)
    for name, label, marker, colour in looks:
        # In the packing the stated error is a share of the operator's norm.
        error = closures["error"].where(closures["closure"] != PLACE, 0.0)
        look: Any = {"fmt": marker, "color": colour, "label": label, "capsize": 2.0}
        ax.errorbar(closures[name], closures["closure"].map(JUDGE_TITLES), xerr=error, **look)
    ax.set(xlabel="eigenvalues of $K_s$ over the mean $k_n$ (–)", ylim=(len(closures) - 0.5, -0.5))
    outer_legend(ax, "upper center", (0.5, 0.0), 4.5, ncols=3, columnspacing=1.0)
