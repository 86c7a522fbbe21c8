"""Run pytest and write down how long each test took."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest

from tests.tools.mutation.covering import RECORD


class Recorder:
    """Sums the phases of each test that passes."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self.failed: set[str] = set()

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Add one phase."""
        self.seconds[report.nodeid] = self.seconds.get(report.nodeid, 0.0) + report.duration
        if report.failed:
            self.failed.add(report.nodeid)


if __name__ == "__main__":
    recorder = Recorder()
    status = pytest.main(sys.argv[1:], plugins=[recorder])
    passed = {test: s for test, s in recorder.seconds.items() if test not in recorder.failed}
    Path(RECORD).write_text(json.dumps(passed))
    # 1: some failed, and are left out.
    sys.exit(0 if status in (0, 1) and len(passed) > 10 * len(recorder.failed) else 1)
