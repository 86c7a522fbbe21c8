"""Forces without a stiffness: geometry, balance and a note; all that is missing at once."""

import numpy as np
import pandas as pd
import pytest

from grainloops import chain_table, loop_table
from loops import InputError
from patterns import read_snapshot, sample_path, snapshot_from_tables
from tests.command import refusal, run

DUMPS = {"LAMMPS": "lammps/dump.atoms.0.gz", "LIGGGHTS": "liggghts/atoms.0.dump.gz"}


def of_tables():
    """The sample, its stiffness left out."""
    tables = read_snapshot(sample_path()).tables()
    tables["contacts"] = {n: v for n, v in tables["contacts"].items() if n not in ("kn", "ks")}
    return snapshot_from_tables(**tables)


@pytest.mark.parametrize("name", DUMPS)
def test_a_dump_is_read_with_its_forces_and_a_note(name):
    path = sample_path(DUMPS[name])
    bare, known = read_snapshot(path), read_snapshot(path, kn=1e6, kt=5e5, mu=0.3)
    assert not bare.mechanical and bare.has_forces and bare.lacks == ("kn", "kt")
    for field in ("normal_force", "shear_force", "x", "contacts"):
        np.testing.assert_array_equal(getattr(bare.graph, field), getattr(known.graph, field))
    assert "give --kn and --kt" in bare.notes[-1]
    # Both runs have kn = 1e6; positions of nine digits leave that much of the overlaps.
    (needed,) = [one.number for one in bare.findings if one.check == "stiffness"]
    assert needed == pytest.approx(1e6, rel=1e-5)
    # What needs no stiffness is checked alike.
    checked = {one.check: one for one in known.findings}
    for one in bare.findings:
        assert one.check == "stiffness" or one == checked[one.check]
    assert {"balance", "directions", "pulling"} <= {one.check for one in bare.findings}


def test_geometry_and_chains_need_no_stiffness():
    known, bare = read_snapshot(sample_path()), of_tables()
    own, theirs = loop_table(bare), loop_table(known)
    pd.testing.assert_frame_equal(own, theirs[list(own)], check_exact=True)
    chains = [chain_table(one) for one in (bare, known)]
    np.testing.assert_array_equal(chains[0]["chain"], chains[1]["chain"])
    # Both divide the same forces into N and T, to rounding.
    np.testing.assert_allclose(chains[0]["major"], chains[1]["major"], rtol=1e-12)
    again = snapshot_from_tables(**bare.tables())
    assert again.lacks == ("kn", "kt")
    assert np.abs(again.graph.normal_force - bare.graph.normal_force).max() < 1e-11


@pytest.mark.parametrize(
    ("dropped", "given", "received", "remedy"),
    [
        (("kn", "ks"), {}, "no kn, no kt", "Give --kn and --kt or such columns; forces and"),
        (("ks",), {}, "no kt", "Give --kt or such columns"),
        (("kn", "ks"), {"kn": 1e6}, "no kt", "Give --kt or such columns"),
        (
            ("kn", "ks", "fx_on_2", "fy_on_2"),
            {},
            "no forces, no kn, no kt",
            "Export the contact forces; give --kn and --kt or such columns",
        ),
        (("fx_on_2", "fy_on_2"), {}, "no forces", "Export the contact forces."),
    ],
)
def test_mechanics_names_all_that_is_missing(dropped, given, received, remedy):
    tables = read_snapshot(sample_path()).tables()
    tables["contacts"] = {n: v for n, v in tables["contacts"].items() if n not in dropped}
    snapshot = snapshot_from_tables(**tables, **given)
    with pytest.raises(InputError) as caught:
        snapshot.mechanics()
    assert caught.value.received == received
    assert caught.value.remedy.startswith(remedy)


def test_columns_of_both_tables_are_named_at_once():
    with pytest.raises(InputError) as caught:
        snapshot_from_tables({"id": [1], "x": [0.0]}, {"id1": [1], "fn": [1.0]})
    assert str(caught.value) == (
        "columns 'y', 'radius' of grains and 'id2' of contacts: got columns id, x; columns id1, "
        "fn, expected columns 'y', 'radius', 'id2'. Add them, or name those that hold them: "
        "--columns y=COLUMN,radius=COLUMN,id2=COLUMN."
    )


@pytest.mark.parametrize("name", DUMPS)
def test_commands_run_or_name_what_is_missing(name, tmp_path, capsys):
    path = str(sample_path(DUMPS[name]))

    assert run("check", path) == 0
    assert "forces and overlaps need kn = 1e+06" in capsys.readouterr().out
    assert run("snapshot", path, "--out", tmp_path / "geometry", "--no-figures") == 0
    assert "forces without kn and kt: no stability of the loops" in capsys.readouterr().out
    told = refusal(capsys, "probe", path, "--out", tmp_path / "probe", "--no-figures")
    assert "got no kn, no kt" in told and "need kn = 1e+06" in told
    assert not (tmp_path / "probe").exists()
