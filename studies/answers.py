"""Answers of the front door about a sample: `check` and `loop`."""

from __future__ import annotations

from dataclasses import dataclass

import pandas as pd

from loops.scene import Subject
from loops.shown import Shown
from patterns import Snapshot, loop_of_snapshot
from patterns.snapshots.findings import SEVERITIES, Finding, crossings, worst_severity
from patterns.snapshots.snapshot import SnapshotLoop, snapshot_of


@dataclass(frozen=True, eq=False, repr=False)
class Check(Shown):
    """Findings of `check`: the worst of `SEVERITIES`, and a finding for each check."""

    verdict: str
    findings: tuple[Finding, ...]

    def facts(self) -> dict[str, object]:
        """Facts that the prompt and a notebook show."""
        wrong = [one for one in self.findings if one.severity != "ok"]
        counts: dict[str, object] = {
            str(name): sum(one.severity == name for one in self.findings) for name in SEVERITIES
        }
        said = {one.check: f"{one.severity}: {one.says}" for one in wrong}
        return {"verdict": self.verdict, **counts, **said}

    def rows(self) -> pd.DataFrame:
        """A row a check."""
        return pd.DataFrame([one._asdict() for one in self.findings])


def check(snapshot: Snapshot | Subject) -> Check:
    """Check a snapshot for consistency, as `grainloops check` does: signs, units, balance.

    Parameters
    ----------
    snapshot : Snapshot or Scene
        A file that fails is read with `read_snapshot(path, strict=False)`; of a scene only the
        crossings of its branches are checked.

    Returns
    -------
    Check
        `verdict` is 'ok', 'doubt' or 'error'; `.table()` has a row a check with what to do.

    Examples
    --------
    >>> from patterns import read_snapshot, sample_path
    >>> check(read_snapshot(sample_path())).verdict
    'ok'
    """
    snapshot = snapshot_of(snapshot)
    findings = (*snapshot.findings, crossings(snapshot.graph))
    return Check(worst_severity(findings), findings)


def loop(snapshot: Snapshot | Subject, number: int) -> SnapshotLoop:
    """Take one loop out of a snapshot; every question about a scene takes it.

    Parameters
    ----------
    snapshot : Snapshot or Scene
        With a law.
    number : int
        Of the loop in the column `loop` of `loop_table`.

    Returns
    -------
    SnapshotLoop
        `graph`, `law`, `regime`, `ids` of its grains, `scene`.

    Raises
    ------
    InputError
        If there is no loop of that number.

    Examples
    --------
    >>> from patterns import read_snapshot, sample_path
    >>> one = loop(read_snapshot(sample_path()), 62)
    >>> one.graph.grain_count == len(one.ids), one.scene.boundary.kind
    (True, 'free')
    """
    return loop_of_snapshot(snapshot_of(snapshot), number)
