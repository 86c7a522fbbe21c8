"""The search for flutter: its samples, closed forms, 50-digit eigenvalues, and what it writes."""

import json

import mpmath
import numpy as np
import pandas as pd
import pytest
import typer

from loops import InputError, LinearFrictional, affine_tangent, assemble_tangent
from loops.geometry import boundary_vectors
from loops.stress import contact_forces, love_weber_stress
from patterns import regular_polygon
from stability import flutter_pairs, restrict, spectrum, symmetric_spectrum
from studies.fifty_digits import traction_tangent_50
from studies.flutter.__main__ import main
from studies.flutter.run import FlutterSearch, run_flutter
from studies.flutter.sample import Ranges, draw_loops, loaded, random_levels, repeated
from studies.flutter.search import OPERATORS, UNCERTAINTY, flutter_map, flutter_of, operators_of

FAMILIES = [
    (shape, forces, contacts)
    for shape in ("regular", "irregular")
    for forces in ("assigned", "balanced")
    for contacts in ("elastic", "sliding")
]


def drawn(order, shape, forces, contacts, count=60, seed=4):
    rng = np.random.default_rng(seed)
    loops = draw_loops(rng, count, order, shape, forces, contacts, Ranges())
    return loaded(loops, *random_levels(rng, count, Ranges()))


@pytest.mark.parametrize("order", [3, 6])
@pytest.mark.parametrize("family", FAMILIES)
def test_samples_hold_what_they_promise(order, family):
    sample = drawn(order, *family)
    N, T = sample.graph.normal_force, sample.graph.shear_force
    assert (N > 0).all()
    some = sample.reached
    assert some.mean() > (0.2 if family[:2] == ("irregular", "balanced") else 0.95)
    np.testing.assert_allclose((np.abs(T) / N).max(axis=1)[some], sample.friction[some], rtol=1e-9)
    sides = np.roll(sample.graph.x, -1, axis=1) - sample.graph.x
    length = np.hypot(sides[..., 0], sides[..., 1])
    np.testing.assert_allclose((N / length).mean(axis=1), sample.overlap, rtol=1e-12)
    slides = sample.regime == 2
    assert slides.any(axis=1).all() if family[2] == "sliding" else not slides.any()
    np.testing.assert_allclose(np.abs(T)[slides], (sample.law.mu * N)[slides], rtol=1e-14)
    if family[0] == "regular":
        np.testing.assert_allclose(length, 1, rtol=1e-12)


@pytest.mark.parametrize("shape", ["regular", "irregular"])
def test_balanced_forces_are_in_equilibrium_with_a_uniform_stress(shape):
    sample = drawn(5, shape, "balanced", "elastic")
    graph = sample.graph
    assert np.abs(graph.shear_force).max() > 0.01
    f, P = contact_forces(graph), love_weber_stress(graph)
    external = -np.einsum("bij,bcj->bci", P, boundary_vectors(graph.x))
    np.testing.assert_allclose(f - np.roll(f, 1, axis=1), external, atol=1e-13)
    np.testing.assert_allclose(P[:, 0, 1], P[:, 1, 0], atol=1e-14)


@pytest.mark.parametrize("order", [3, 5, 6, 7, 8])
@pytest.mark.parametrize("closure", ["affine"])
def test_chiral_regular_loops_flutter_in_closed_form(order, closure):
    # Shear alike in all contacts: the two shear modes turn into each other,
    # lambda = (n l^2/4 V) (kn + kt - N/l +- i T/l); the pressure mode stays real.
    N, T, kt = 0.15, 0.06, 0.4
    graph = regular_polygon(order)
    graph = graph.replace(normal_force=np.full(order, N), shear_force=np.full(order, T))
    K = restrict(affine_tangent(graph, LinearFrictional(kn=1.0, kt=kt)).matrix, "symmetric")
    area = order / (4 * np.tan(np.pi / order))
    expected = order / (4 * area) * (1 + kt - N + 1j * np.array([-T, T]))
    found = spectrum(K)
    pair = found[np.abs(found.imag) > 1e-9]
    np.testing.assert_allclose(np.sort_complex(pair), np.sort_complex(expected), rtol=1e-12)
    assert flutter_pairs(K).sum() == 2
    # While second-order work is positive in every direction.
    assert symmetric_spectrum(K)[0] > 0.1 and flutter_of(K[None]).stable.item()


@pytest.mark.parametrize("T", [0.01, 0.3, 0.9])
def test_chiral_square_never_flutters(T):
    # Its shear modes don't turn into each other: K is triangular, with 2 kn and 2 (kt - N/l).
    graph = regular_polygon(4, orientation="edge")
    graph = graph.replace(normal_force=np.full(4, 0.1), shear_force=np.full(4, T))
    K = restrict(affine_tangent(graph, LinearFrictional(kn=1.0, kt=0.4)).matrix, "symmetric")
    np.testing.assert_allclose(spectrum(K), [0.6, 2, 2], atol=1e-12)
    assert not flutter_of(K[None]).flutters.any()


def test_hits_have_complex_eigenvalues_to_fifty_digits():
    """Traction operators are rebuilt from the state with 50 digits: no rounding is shared."""
    checked = {}
    for order, family in ((5, FAMILIES[4]), (6, FAMILIES[1]), (4, FAMILIES[7]), (3, FAMILIES[5])):
        sample = drawn(order, *family, count=600)
        for name, K in operators_of(sample):
            closure, _, subspace = name.partition(" ")
            found = flutter_of(K)
            # The oracle takes one coefficient of friction for a loop.
            alike = np.ptp(sample.law.mu, axis=1) < 1e-14
            alike |= (sample.regime == 1).all(axis=1)
            usable = found.flutters & (alike if closure == "traction" else True)
            for b in np.flatnonzero(usable)[:2]:
                with mpmath.workdps(50):
                    exact = (
                        exact_traction(sample, b, subspace)
                        if closure == "traction"
                        else mpmath.matrix(K[b].tolist())
                    )
                    values = mpmath.eig(exact, left=False, right=False)
                    ratio = max(abs(v.imag) / abs(v) for v in values if abs(v.imag) > 1e-12)
                assert float(ratio) == pytest.approx(found.ratio[b], rel=1e-6)
                checked[closure] = checked.get(closure, 0) + 1
    assert checked["affine"] >= 15 and checked["traction"] >= 8 and checked["grains"] >= 6


def exact_traction(sample, b, subspace):
    graph = sample.graph
    A = traction_tangent_50(
        graph.x[b], graph.x0[b], graph.normal_force[b], graph.shear_force[b],
        1.0, sample.law.kt[b, 0], sample.law.mu[b, 0], sample.regime[b],
    )  # fmt: skip
    return restricted(A, subspace)


def restricted(A, subspace):
    """(11, 22), with the shear component, or all four of an mpmath operator."""
    with mpmath.workdps(50):
        h = mpmath.sqrt(mpmath.mpf(1) / 2)
        rows = {
            "diagonal": [[1, 0, 0, 0], [0, 0, 0, 1]],
            "symmetric": [[1, 0, 0, 0], [0, 0, 0, 1], [0, h, h, 0]],
            "full": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]],
        }[subspace]
        B = mpmath.matrix(rows)
        return B * A * B.T


def test_levels_scale_forces_and_keep_balance():
    rng = np.random.default_rng(3)
    loops = draw_loops(rng, 7, 5, "regular", "balanced", "sliding", Ranges())
    friction, overlap = np.repeat([0.2, 0.4], 7), np.repeat([0.01, 0.03], 7)
    sample = loaded(repeated(loops, 2), friction, overlap)
    assert sample.graph.batch_shape == (14,) and sample.reached.all()
    np.testing.assert_array_equal(sample.graph.x[7:], sample.graph.x[:7])
    N, T = sample.graph.normal_force, sample.graph.shear_force
    np.testing.assert_allclose((np.abs(T) / N).max(axis=1), friction, rtol=1e-12)
    np.testing.assert_allclose(N.mean(axis=1), overlap, rtol=1e-12)
    # The same contact comes first on its way out of the cone or another: N stays positive.
    assert (N > 0).all()


def test_without_shear_elastic_loops_never_flutter():
    for order in (3, 4, 5, 6):
        sample = drawn(order, "irregular", "assigned", "elastic")
        still = sample.graph.replace(shear_force=np.zeros(order))
        K = assemble_tangent(still, sample.law, regime=sample.regime)
        assert not flutter_of(K).flutters.any()
        A = affine_tangent(still, sample.law, regime=sample.regime).matrix
        assert not flutter_of(A).flutters.any()


def test_map_is_its_family_level_by_level():
    options = {"order": 5, "loops": 30, "seed": 2, "ranges": Ranges()}
    levels = np.array([0.1, 0.9]), np.array([0.01, 0.1, 0.3])
    maps = flutter_map("assigned", "elastic", *levels, **options)
    ratio, share = maps["affine"]
    assert ratio.shape == share.shape == (3, 2)
    assert share[0, 0] <= share[2, 1] and share[2, 1] > 0
    assert ((ratio > 0) == (share > 0)).all()


def test_study_writes_tables_and_figures(tmp_path):
    given = FlutterSearch(orders=(3, 4), loops=150, map_order=4, map_loops=4)
    summary = run_flutter(given, tmp_path / "out")
    written = {path.name for path in (tmp_path / "out").iterdir()}
    assert written == {
        "summary.json", "flutter.parquet", "flutter.csv", "maps.parquet",
        "flutter_maps.png", "flutter_maps.svg", "flutter_orders.png", "flutter_orders.svg",
    }  # fmt: skip
    assert json.loads((tmp_path / "out/summary.json").read_text())["loops"] == summary["loops"]
    table = pd.read_parquet(tmp_path / "out/flutter.parquet")
    assert len(table) == 2 * len(FAMILIES) * len(OPERATORS)
    assert summary["loops"] == 2 * 8 * 150 and summary["uncertainty"] == UNCERTAINTY
    assert summary["flutter"] == table["flutter"].sum() > 100
    again = run_flutter(given, tmp_path / "again")
    assert {**again, "provenance": 0} == {**summary, "provenance": 0}
    with pytest.raises(InputError, match="folder that holds files"):
        run_flutter(given, tmp_path / "out")
    with pytest.raises(InputError, match="orders of 3 or more"):
        run_flutter(FlutterSearch(orders=(2,)), tmp_path / "none")


def test_command_refuses_bad_input_in_one_line(tmp_path, capsys):
    for orders in ("abc", "8-3", "2-4", "5"):
        with pytest.raises(typer.Exit) as left:
            main(tmp_path / "none", orders=orders)
        said = capsys.readouterr().err
        assert left.value.exit_code == 2 and said.count("\n") == 1 and "--orders" in said
    assert not (tmp_path / "none").exists()
