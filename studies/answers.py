"""The answer of the front door to `check`."""

from __future__ import annotations

from dataclasses import dataclass

import pandas as pd

from loops.scene import Subject
from loops.shown import Shown
from patterns import Snapshot
from patterns.snapshots.findings import SEVERITIES, Finding, crossings, worst_severity
from patterns.snapshots.snapshot import snapshot_of


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
