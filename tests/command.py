"""The command line, run in this process."""

import pytest

from studies.cli import main


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
