"""The command line, run in this process, and the functions that commands call."""

import pytest

from studies.cli import main
from studies.evolve import run_evolve as run_evolve
from studies.probe import run_probe as run_probe
from studies.series.run import run_series as run_series
from studies.snapshot import run_snapshot as run_snapshot
from studies.sustain import run_sustain as run_sustain


def run(*words):
    """Exit status of `grainloops` with these words."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("sys.argv", ["grainloops", *map(str, words)])
        with pytest.raises(SystemExit) as left:
            main()
    return left.value.code or 0


def refusal(capsys, *words):
    """The one line with which the command refuses these words."""
    capsys.readouterr()
    assert run(*words) == 2
    (line,) = capsys.readouterr().err.splitlines()
    return line
