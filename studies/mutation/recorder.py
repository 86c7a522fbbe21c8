"""Run pytest and write down how long each test took: `python -m studies.mutation.recorder ...`."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest

from studies.mutation.covering import RECORD


class Recorder:
    """Sums the phases of each test."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Add one phase."""
        self.seconds[report.nodeid] = self.seconds.get(report.nodeid, 0.0) + report.duration


if __name__ == "__main__":
    recorder = Recorder()
    status = pytest.main(sys.argv[1:], plugins=[recorder])
    Path(RECORD).write_text(json.dumps(recorder.seconds))
    sys.exit(status)
