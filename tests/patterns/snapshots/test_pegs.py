"""PeGS2's tracked positions and adjacency list: geometry, forces, and what they can't carry.

Files are written by the descriptions in PeGS2's `particleTrack` and `adjacencyMatrix`: numbers
between commas, no header, y downwards in pixels, a row for each of the two grains of a contact.
"""

import numpy as np
import pytest

from grainloops import loop_table
from loops import InputError
from patterns import count_frames, read_frames, read_snapshot, sample_path
from tests.command import run

PIXELS = 2000.0  # per unit of length
NOISE = 0.5
WALLS = 59  # grains that touch a wall


def write(folder, noise=0.0, frames=(1,), one_sided=0, seed=0):
    """The sample as PeGS2 writes it, forces of each side with errors of `noise` mean forces."""
    snapshot, rng = read_snapshot(sample_path()), np.random.default_rng(seed)
    graph, ids = snapshot.graph, snapshot.ids + 1
    forces = np.stack([graph.shear_force, graph.normal_force], axis=1)
    mean = np.hypot(*forces.T).mean()
    sides = [forces + noise * mean * rng.normal(size=forces.shape) for _ in range(2)]
    one, two = ids[graph.contacts].T
    # One column of the matrix stands for all walls: a grain in a corner has one contact with them.
    touching = np.unique(ids[snapshot.walls.grain])
    walls = np.stack([touching, np.full(WALLS, -1)], axis=1)
    positions, contacts = [], []
    for frame in frames:
        x = np.column_stack([graph.x[:, 0], 1.0 - graph.x[:, 1], graph.radii]) * PIXELS
        edge = np.zeros(len(ids))
        positions.append(np.column_stack([np.full(len(ids), frame), ids, x, edge]))
        for pair, side in zip((np.stack([one, two], 1), np.stack([two, one], 1)), sides,
                              strict=True):  # fmt: skip
            rows = slice(one_sided if pair is not None and side is sides[1] else 0, None)
            own = np.column_stack([np.full(len(one), frame), pair, side])
            contacts.append(own[rows])
        contacts.append(
            np.column_stack([np.full(WALLS, frame), walls, np.zeros(WALLS), np.ones(WALLS)])
        )
    path = folder / "particle_positions.txt"
    np.savetxt(path, np.concatenate(positions), "%.15g", ",")
    np.savetxt(folder / "Adjacency_list.txt", np.concatenate(contacts), "%.15g", ",")
    return path, snapshot, sides


def by_ids(snapshot, shift=0):
    """Forces by the ids of the two grains, lower first; N and T don't change when they turn."""
    ids = np.sort(snapshot.ids[snapshot.graph.contacts] + shift, axis=1)
    order = np.lexsort(ids.T)
    return ids[order], snapshot.graph.normal_force[order], snapshot.graph.shear_force[order]


def test_an_exact_list_is_the_packing_upright(tmp_path):
    path, own, _ = write(tmp_path)
    found = read_snapshot(path)
    assert found.graph.grain_count == 600 and found.wall_contacts == WALLS
    for mine, yours in zip(by_ids(found), by_ids(own, 1), strict=True):
        np.testing.assert_allclose(mine, yours, rtol=1e-12)
    ours, theirs = loop_table(own), loop_table(found)
    assert sorted(ours["order"]) == sorted(theirs["order"])
    np.testing.assert_allclose(
        np.sort(theirs["area"]), np.sort(ours["area"]) * PIXELS**2, rtol=1e-10
    )
    # Rows of both grains agree, and the grains are in balance: a law is taken if it is given.
    assert any("differ by 0 mean forces from it" in note for note in found.notes)
    assert any("of the mean contact force" in note for note in found.notes)
    assert found.lacks == ("kn", "kt")
    law, regime = read_snapshot(path, kn=1.0, kt=0.5, mu=0.5).mechanics()
    assert (law.kn == 1.0).all() and len(regime) == 819


def test_measured_forces_are_means_and_their_imbalance_refuses_mechanics(tmp_path):
    path, own, sides = write(tmp_path, NOISE)
    found = read_snapshot(path, kn=1.0, kt=0.5, mu=0.5)
    mean = 0.5 * (sides[0] + sides[1])
    order = np.lexsort(np.sort(own.ids[own.graph.contacts], axis=1).T)
    _, normal, shear = by_ids(found)
    np.testing.assert_allclose(normal, mean[order, 1], rtol=1e-12)
    np.testing.assert_allclose(shear, mean[order, 0], rtol=0, atol=1e-12 * np.abs(mean).max())
    apart = np.sqrt(np.mean(np.sum((sides[0] - mean) ** 2, axis=1))) / np.hypot(*mean.T).mean()
    assert any(f"differ by {apart:.2g} mean forces from it" in note for note in found.notes)
    (balance,) = [one for one in found.findings if one.check == "balance"]
    assert balance.severity == "doubt" and balance.number > 0.5
    assert found.has_forces and found.lacks == ("balance",) and found.graph.regime is None
    with pytest.raises(InputError) as caught:
        found.mechanics()
    assert caught.value.received == "no balance"
    assert f"on a grain is {balance.number:.2g} of the mean contact force" in str(caught.value)
    assert len(loop_table(found)) == len(loop_table(own))


def test_contacts_solved_on_one_grain_alone_are_counted(tmp_path):
    path, own, sides = write(tmp_path, NOISE, one_sided=7)
    found = read_snapshot(path)
    assert any("7 contacts were solved on one grain alone" in note for note in found.notes)
    assert found.graph.contact_count == 819
    order = np.lexsort(np.sort(own.ids[own.graph.contacts], axis=1).T)
    expected = np.where(np.arange(819) < 7, sides[0][:, 1], 0.5 * (sides[0] + sides[1])[:, 1])
    np.testing.assert_allclose(by_ids(found)[1], expected[order], rtol=1e-12)


def test_frames_are_those_with_contacts(tmp_path):
    path, *_ = write(tmp_path, frames=(3, 5))
    assert count_frames(path) == 2
    assert [one.step for one in read_frames(path)] == [3.0, 5.0]
    with pytest.raises(InputError, match="2 snapshots"):
        read_snapshot(path)


def test_what_is_none_of_it_is_told(tmp_path):
    path, *_ = write(tmp_path)
    with pytest.raises(InputError, match="leave --columns out"):
        read_snapshot(path, columns={"x": "y"})
    adjacency = tmp_path / "Adjacency_list.txt"
    rows = adjacency.read_text()
    adjacency.write_text(rows.replace(",", ",1,", 1).splitlines()[0] + "\n")
    with pytest.raises(InputError, match="6 columns, expected 5: frame, id1, id2, tangential"):
        read_snapshot(path)
    adjacency.write_text(rows[: len(rows) // 2 - 3] + "x\n")
    with pytest.raises(InputError, match=r"Adjacency_list\.txt"):
        read_snapshot(path)
    adjacency.unlink()
    with pytest.raises(InputError, match="no list of contacts beside it"):
        read_snapshot(path)


@pytest.mark.parametrize(
    ("command", "status"), [("check", 0), ("snapshot", 0), ("probe", 2)], ids=str
)
def test_commands_take_it_or_name_the_imbalance(command, status, tmp_path, capsys):
    path, *_ = write(tmp_path, 0.2)
    options = [] if command == "check" else ["--no-figures"]
    options += ["--out", str(tmp_path / "out"), "--kn", "1", "--kt", "0.5"]
    assert run(command, path, *options) == status
    said = capsys.readouterr()
    assert "of the mean contact force" in said.out + said.err


def test_periodic_without_a_period_is_refused(tmp_path):
    path, _, _ = write(tmp_path)
    with pytest.raises(InputError, match=r"--periodic: got no cell"):
        read_snapshot(path, periodic="x")
