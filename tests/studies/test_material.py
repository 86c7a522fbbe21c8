"""`grainloops material`: its files, its numbers, and what it refuses."""

import json

import numpy as np
import pandas as pd
import pyarrow.parquet
import pytest

from grainloops import LoopMaterial, loops_of, march, oriented
from loops import LinearFrictional
from patterns import read_snapshot, regular_polygon, sample_path
from stability import COMPONENTS, Stage, programmes
from studies.material import MaterialOptions, run_material
from studies.output import field_metadata
from tests.command import run


@pytest.fixture(scope="module")
def hexagons(tmp_path_factory):
    out = tmp_path_factory.mktemp("material") / "out"
    options = MaterialOptions(end=0.07, steps=140)
    return run_material(options, out), out


def test_the_command_has_the_numbers_of_the_call(hexagons):
    summary, out = hexagons
    mean = summary["mean"]
    assert abs(mean["peak_stress_ratio"] - 4.649) < 1e-3 and round(mean["peak_strain"], 9) == 0.061
    assert round(mean["w2_negative_strain"], 9) == 0.0615
    table = pd.read_parquet(out / "path.parquet")
    for name in ("mean", "single"):
        run = table[(table["set"] == name) & (table["stage"] == "programme")]
        assert summary[name]["cone_strain"] == run.loc[run["cone_status"] == "open", "strain"].min()
        assert summary[name]["w2_negative_strain"] == run.loc[run["w2"] < 0, "strain"].min()
    assert mean["cone_strain"] <= mean["w2_negative_strain"]
    # The single hexagon, the first of equal ones, peaks where its four inclined contacts yield.
    assert summary["loop"] == 0
    assert summary["single"]["peak_strain"] < 0.025
    rows = table[(table["set"] == "mean") & (table["stage"] == "programme")]
    law = LinearFrictional(1.0, 0.5, np.tan(np.radians(30)))
    material = LoopMaterial(oriented(regular_polygon(6), 36), None, law)
    confining = Stage(programmes.isotropic_stress(), "P11", 1e-2)
    start = march(material, confining, 20).H[-1, 0]
    path = march(material, [confining, Stage("drained_biaxial", "H11", start + 0.07)], 140)
    assert np.array_equal(rows["P11"], path.P[path.stage == 1, 0])
    assert np.allclose(rows["P22"], 1e-2, rtol=0, atol=1e-12)


def test_a_ratio_that_rises_to_the_end_has_no_peak(tmp_path):
    summary = run_material(MaterialOptions(end=0.005, steps=10, orientations=2), tmp_path / "out")
    mean = summary["mean"]
    assert mean["end_stress_ratio"] > 1.2 and round(mean["end_strain"], 12) == 0.005
    assert mean["peak_stress_ratio"] is None and mean["peak_strain"] is None


def test_files_hold_units_meanings_and_provenance(hexagons):
    summary, out = hexagons
    names = {path.name for path in out.iterdir()}
    assert {"path.parquet", "loops.parquet", "material.png", "report.html"} < names
    for name in ("path", "loops"):
        for field in pyarrow.parquet.read_schema(out / f"{name}.parquet"):
            said = {key: field.metadata.get(key) for key in (b"unit", b"meaning")}
            assert said == field_metadata(f"material/{name}", field.name), field.name
    kept = json.loads((out / "summary.json").read_text())
    assert kept["provenance"]["configuration"]["orientations"] == 36
    assert kept["mean"] == summary["mean"]
    told = set(", ".join(kept["definitions"]).split(", "))
    assert set(kept["mean"]) <= told


def test_loops_of_a_snapshot_and_the_printed_lines(tmp_path, capsys):
    given = [str(sample_path()), "--orders", "3,4", "--count", "20", "--closure", "affine"]
    out = ["--out", str(tmp_path / "out"), "--no-figures", "--steps", "5"]
    assert run("material", *given, *out) == 0
    said = capsys.readouterr().out
    assert "20 loops (" in said and "of order 3" in said and "half in each" in said
    loops = pd.read_parquet(tmp_path / "out" / "loops.parquet")
    assert set(loops["order"]) == {3, 4} and abs(loops["weight"].sum() - 1.0) < 1e-12


def test_the_single_loop_is_near_the_mean_or_the_one_asked_for(tmp_path):
    loops = loops_of(read_snapshot(sample_path()), orders=[3, 4, 6], count=60)
    options = {"orders": (3, 4, 6), "count": 60, "closure": "affine", "steps": 2, "end": 1e-5}
    told = {}
    for single in (None, 7):
        summary = run_material(
            MaterialOptions(**options, single=single), tmp_path / str(single),
            snapshot=sample_path(), figures=False,
        )  # fmt: skip
        table = pd.read_parquet(tmp_path / str(single) / "path.parquet")
        first = table[(table["set"] == "single") & (table["strain"] == 0.0)]
        told[summary["loop"]] = first[["P11", "P12", "P21", "P22"]].to_numpy()[0].reshape(2, 2)
    near, seven = told
    assert seven == 7
    middle = np.median(loops.orders)
    stress = loops.stress
    mean = np.average(stress, axis=0, weights=loops.weights)
    away = np.linalg.norm(stress - mean, axis=(1, 2))
    others = loops.orders == middle
    assert loops.orders[near] == middle and away[near] == away[others].min()
    for number, P in told.items():
        assert P == pytest.approx(0.5 * (stress[number] + stress[number].T), rel=1e-6, abs=1e-3)


@pytest.mark.parametrize(
    ("programme", "numbers", "held"),
    [
        ("proportional-strain", {"strain_ratio": -0.5}, lambda H, P: H[:, 3] + 0.5 * H[:, 0]),
        ("undrained", {"fluid_bulk_modulus": 0.3},
         lambda H, P: P[:, 3] / (1.0 - H[:, 0]) - 0.3 * np.log((1.0 - H[:, 0]) * (1.0 - H[:, 3]))),
    ],
)  # fmt: skip
def test_programmes_with_numbers(tmp_path, programme, numbers, held):
    options = MaterialOptions(programme=programme, orientations=6, end=0.02, steps=5, **numbers)
    run_material(options, tmp_path / "out", figures=False)
    table = pd.read_parquet(tmp_path / "out" / "path.parquet")
    rows = table[(table["set"] == "mean") & (table["stage"] == "programme")]
    H, P = (rows[[f"{tensor}{c}" for c in COMPONENTS]].to_numpy() for tensor in "HP")
    values = held(H, P)
    assert np.ptp(values) < 1e-12 and np.ptp(P[:, 3]) > 1e-4


@pytest.mark.parametrize(
    "options, words",
    [
        ({"programme": "proportional-strain"}, "--strain-ratio"),
        ({"fluid_bulk_modulus": 1.0}, "--fluid-bulk-modulus"),
        ({"programme": "undrained", "fluid_bulk_modulus": -1.0}, "--fluid-bulk-modulus"),
        ({"order": 2}, "--order"),
        ({"phi_deg": 91.0}, "--phi"),
        ({"alpha0_deg": 45.0, "order": 5}, "hexagon"),
        ({"closure": "reuss"}, "--closure"),
        ({"programme": "triaxial"}, "--programme"),
        ({"end": 0.0}, "--end"),
        ({"end": 1.0}, "--end: got 1, expected a strain below 1"),
        ({"confine": -1.0}, "--confine"),
    ],
)
def test_options_that_are_refused(options, words):
    with pytest.raises(ValueError, match=words):
        MaterialOptions(**options)


@pytest.mark.parametrize(
    "arguments, words",
    [
        (["--orders", "4"], "--orders: got given without a snapshot"),
        (["file.csv", "--order", "4"], "--order: got given with a snapshot"),
        (["--order", "5", "--closure", "cell"], "expected hexagons"),
        (["--single", "36"], "--single: got 36, expected a number from 0 to 35"),
    ],
)
def test_arguments_that_are_refused(tmp_path, arguments, words, capsys):
    out = tmp_path / "out"
    assert run("material", *arguments, "--out", out) == 2
    assert words in capsys.readouterr().err and not out.exists()


def compressed_until(share, specimen, step):
    """Compress a specimen until its stress ratio is below a share of its peak."""
    from studies.examples.biaxial_specimen import compressed

    steps = []
    for strain, ratio, residuals in compressed(specimen, step, 0.066):
        steps.append((strain, ratio, residuals))
        if ratio < share * max(value for _, value, _ in steps):
            strain, ratio, residuals = zip(*steps, strict=True)
            return specimen, np.array(strain), np.array(ratio), residuals
    pytest.fail(f"ends at {strain} with {ratio}")


@pytest.fixture(scope="module")
def specimen():
    """Path of a small specimen beyond its peak, and its last state."""
    pytest.importorskip("skfem")
    from studies.examples.biaxial_specimen import Specimen

    return compressed_until(0.94, Specimen(columns=4, rows=6, orientations=12), 1e-3)


def test_newtons_method_squares_its_residual_while_contacts_slide(specimen):
    _, strain, _, residuals_of_steps = specimen
    sliding = (strain > 0.0245) & (strain < 0.045)
    constants = []
    for residuals in np.array(residuals_of_steps, dtype=object)[sliding]:
        # Where the last residual but one is small, regimes have settled; rounding is some 1e-16.
        last = [r for r in residuals if r > 1e-15]
        if len(last) > 2 and last[-2] < 1e-6:
            constants.append(last[-1] / last[-2] ** 2)
    # A rate of .1 would be 1e5 and more.
    assert len(constants) >= 8 and max(constants) < 200.0
    # There the mean of the loops does slide.
    law = LinearFrictional(1.0, 0.5, np.tan(np.radians(30)))
    material = LoopMaterial(oriented(regular_polygon(6), 12), None, law)
    confining = Stage("isotropic_stress", "P11", 1e-2)
    end = Stage("drained_biaxial", "H11", march(material, confining, 10).H[-1, 0] + 0.0245)
    assert march(material, [confining, end], 20).regimes[-1, 1] > 0.03


@pytest.mark.slow
def test_the_band_follows_the_mesh():
    """At .98 of the peak it takes .375 of 5 by 8 elements, and .144 of 10 by 16."""
    pytest.importorskip("skfem")
    from studies.examples.biaxial_specimen import Specimen, band

    shares, peaks = [], []
    for k in (1, 2):
        specimen = Specimen(columns=5 * k, rows=8 * k, orientations=12)
        _, _, ratio, _ = compressed_until(0.98, specimen, 1e-3 / k)
        assert specimen.weak.sum() == k * k
        shares.append(band(specimen)[1])
        peaks.append(ratio.max())
    assert shares[1] < 0.5 * shares[0] and peaks[1] < peaks[0] - 0.03


def test_a_specimen_converges_in_second_order_and_follows_the_material():
    pytest.importorskip("skfem")
    from studies.examples.biaxial_specimen import CONFINING, Specimen, compressed, law

    steps = compressed(Specimen(columns=3, rows=4, orientations=12), 0.002, 0.01)
    strain, ratio, residuals_of_steps = zip(*steps, strict=True)
    assert strain[-1] == 0.01
    for residuals in residuals_of_steps[1:]:
        # Two steps: each squares the residual over the tangent.
        assert len(residuals) == 3
        assert residuals[1] < 0.1 * residuals[0] ** 2 and residuals[2] < 10.0 * residuals[1] ** 2
    # Elastic, the weak element is as the others: the specimen is one point of the material.
    material = LoopMaterial(oriented(regular_polygon(6), 12), None, law(30.0))
    confining = Stage("isotropic_stress", "P11", CONFINING)
    start = march(material, confining, 10).H[-1, 0]
    path = march(material, [confining, Stage("drained_biaxial", "H11", start + 0.01)], 5)
    assert np.allclose(ratio, path.P[path.stage == 1, 0] / CONFINING, rtol=1e-10)
