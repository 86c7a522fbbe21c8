"""A law with a pull that is named asks for the pull: it is not taken as zero."""

import pytest

from loops import InputError
from patterns import read_snapshot, sample_path
from tests.command import refusal


@pytest.mark.parametrize("law", ["bonded", "cohesive"])
@pytest.mark.parametrize("command", ["snapshot", "probe", "check"])
def test_a_law_with_a_pull_asks_for_it(command, law, tmp_path, capsys):
    out = [] if command == "check" else ["--out", str(tmp_path / "out")]
    assert "Give --adhesion" in refusal(capsys, command, sample_path(), "--law", law, *out)
    assert not (tmp_path / "out").exists()


def test_with_the_pull_it_is_read():
    with pytest.raises(InputError, match="adhesion: got none"):
        read_snapshot(sample_path(), law="bonded", kn=1e6, kt=5e5, mu=0.5)
    given = {"law": "bonded", "kn": 1e6, "kt": 5e5, "mu": 0.5}
    assert read_snapshot(sample_path(), **given, adhesion=0.0).law.bonded
