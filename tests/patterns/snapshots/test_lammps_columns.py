"""LAMMPS dumps of contacts: their columns have no names, and are told from the grains."""

import numpy as np
import pytest

from loops import InputError, branch_vectors
from tests.patterns.dump_writers import Packing, assert_same, lammps_columns, write_lammps
from tests.patterns.snapshots.test_lammps import notes, packing, read


@pytest.mark.parametrize("seed", range(5))
def test_columns_in_any_order_beside_others(tmp_path, seed):
    own = packing(100, seed=seed, tilt=0.2)
    order = list(lammps_columns(own))
    np.random.default_rng(seed).shuffle(order)
    path, _ = write_lammps(tmp_path, own, keep=order)
    assert_same(read(path)[0], own, 1e-13)


def test_normal_force_by_its_size_alone(tmp_path):
    own = packing(100)
    path, _ = write_lammps(tmp_path, own, keep=["patom1", "patom2", "dx", "dy", "force"])
    with pytest.raises(InputError, match=r"none that form a force along the branch.*force=COLUMN"):
        read(path)
    (found,) = read(path, columns={"force": "c_pair[3]"}, mu=0.0)
    assert found.graph.normal_force == pytest.approx(own.graph.normal_force, rel=1e-13)
    assert not found.graph.shear_force.any()
    assert "no tangential force" in " ".join(found.notes)
    geometry = read(path, columns={"fx": "none"})[0]
    assert not geometry.mechanical


def test_a_map_comes_before_the_guess(tmp_path):
    own = packing(100)
    keep = list(lammps_columns(own))
    path, _ = write_lammps(tmp_path, own, keep=[*keep, "p1", "p2"])
    columns = {"p1": "c_pair[11]", "p2": "c_pair[12]"}
    said = notes(path, columns=columns)
    assert "p1=c_pair[11], p2=c_pair[12]" in said and "columns guessed: id1=c_prop[1]" in said
    assert_same(read(path, columns=columns)[0], own, 1e-13)
    # Atoms named the other way round: the same contacts.
    turned = {"id1": "c_prop[2]", "id2": "c_prop[1]"}
    assert_same(read(path, columns=turned)[0], own, 1e-13)


def test_relative_velocities_are_no_forces(tmp_path):
    own = packing(100)
    columns = lammps_columns(own)
    path, contacts = write_lammps(tmp_path, own, keep=[k for k in columns if k != "p4"])
    speed = np.random.default_rng(0).normal(size=own.graph.contact_count)
    n = np.column_stack([columns["dx"], columns["dy"]]) / columns["dist"][:, None]
    text = contacts.read_text().splitlines()
    text[8] += " c_v[1] c_v[2]"
    for k, (a, b) in enumerate((speed[:, None] * n[:, ::-1] * [-1, 1]).tolist()):
        text[9 + k] += f"{a!r} {b!r} "
    contacts.write_text("\n".join(text) + "\n")
    with pytest.raises(InputError, match=r"several that may be p1, p2.*--columns p1=COLUMN"):
        read(path)
    assert_same(read(path, columns={"p1": "c_pair[8]", "p2": "c_pair[9]"})[0], own, 1e-13)


def test_pairs_written_twice_and_neighbours_are_dropped(tmp_path):
    own = packing(100)
    graph = own.graph
    near = Packing(graph.replace(radii=0.8 * graph.radii, normal_force=0 * graph.normal_force,
                                 shear_force=0 * graph.shear_force), own.ids)  # fmt: skip
    path, _ = write_lammps(tmp_path, own, rows=np.repeat(np.arange(graph.contact_count), 2))
    assert_same(read(path)[0], own, 1e-13)
    assert f"{2 * graph.contact_count} rows, {graph.contact_count} contacts" in notes(path)
    path.unlink()
    (tmp_path / "dump.contacts").unlink()
    lone = near.graph.normal_force.copy()
    lone[:30] = 1.0  # held together without overlap: adhesion
    path, _ = write_lammps(tmp_path, Packing(near.graph.replace(normal_force=lone), own.ids))
    reach = near.graph.radii[graph.contacts].sum(axis=1)
    kept = (np.hypot(*branch_vectors(graph).T) < reach) | (lone > 0)
    assert 30 <= kept.sum() < 0.9 * graph.contact_count
    assert f"{np.sum(~kept)} pairs without overlap and force" in notes(path)
    assert read(path)[0].graph.contact_count == kept.sum()


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("adhesion", [False, True])
def test_grain_of_a_force_is_found_by_its_direction(tmp_path, sign, adhesion):
    """Vectors of atom 2 are turned round; the size says that a packing under tension pulls."""
    own = packing(100)
    if adhesion:
        own = Packing(own.graph.replace(normal_force=-own.graph.normal_force), own.ids)
    path, contacts = write_lammps(tmp_path, own)
    rows = contacts.read_text().splitlines()
    turned = [k for k, name in enumerate(lammps_columns(own)) if name in ("dx", "dy", "fx", "fy")]
    turned += [k for k, name in enumerate(lammps_columns(own)) if name in ("p1", "p2")]
    for k, row in enumerate(rows[9:], start=9):
        words = row.split()
        for column in turned:
            words[column] = repr(sign * float(words[column]))
        rows[k] = " ".join(words)
    contacts.write_text("\n".join(rows) + "\n")
    assert_same(read(path, strict=False)[0], own, 1e-13)
    if adhesion:
        with pytest.raises(InputError, match="they pull"):
            read(path)


def test_frictionless_grains_need_no_tangential_force(tmp_path):
    own = packing(100)
    smooth = Packing(own.graph.replace(shear_force=0 * own.graph.shear_force), own.ids)
    keep = ["patom1", "patom2", "dx", "dy", "force", "fx", "fy"]
    path, _ = write_lammps(tmp_path, smooth, keep=keep)
    assert_same(read(path, mu=0.0)[0], smooth, 1e-13)
    assert not read(path)[0].mechanical
