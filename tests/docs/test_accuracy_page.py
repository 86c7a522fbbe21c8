"""`docs/evidence/accuracy.md`: its verdicts and errors are those of today; its times are dated."""

import numpy as np
import pytest

from loops import LinearFrictional, Scene, find_faces, traction_tangent
from patterns import random_loop
from tests.benchmarks import options
from tests.benchmarks.hard_cases import hard_path_rows, tangent_rows
from tests.benchmarks.methods import METHOD_GROUPS
from tests.docs.pages import DOCS, of_size, page, section, tables
from tests.oracles.hard_cases import HARD_CASES
from tests.packings import frobenius, loops_in_place, repeated

TEXT = page("evidence/accuracy")
HARD = section(TEXT, "## The hard cases")
IN_PLACE = "## Loops in place"
ERRORS = (
    *("error: median", "error: 90 %", "error: largest", "error: stated"),
    "share within the stated error",
)
# Options, and the number of grains up to which the page has the method.
METHODS = {
    "whole": ({"method": "whole"}, 400_000),
    "blocks 100, buffer 8": ({"method": "blocks"}, 200_000),
    "blocks 50, buffer 8": ({"method": "blocks", "block": 50.0}, 40_000),
    "blocks 25, buffer 4": ({"method": "blocks", "block": 25.0, "buffer": 4.0}, 40_000),
    "blocks 25, buffer 8": ({"method": "blocks", "block": 25.0, "buffer": 8.0}, 40_000),
    "blocks 6, buffer 8": ({"method": "blocks", "block": 6.0, "buffer": 8.0}, 40_000),
}
FAST = {"directions"}


def quoted_rows():
    """(group, method, setting) to error, as the page has them."""
    found = {}
    for part in section(TEXT, "## Speed against error").split("\n### ")[1:]:
        group = part.split("\n")[0].lower()
        for row in tables(part)[0]:
            key = (group, row["method"], row["setting"].replace(" **(default)**", ""))
            found[key] = float(row["error"])
    return found


def compare(groups, quick):
    quoted, seen = quoted_rows(), 0
    for group in groups:
        for row in METHOD_GROUPS[group](quick):
            error = quoted.get((row.group, row.method, row.setting))
            if error is not None:
                assert of_size(row.error, error, 1e-15), (row, error)
                # An error far above rounding belongs to the method, not to the machine.
                assert error < 1e-12 or row.error > error / 30, (row, error)
                seen += 1
    return seen


def test_errors_of_the_methods():
    # So many settings of the quick run stand on the page.
    assert compare(FAST, quick=True) >= 6


@pytest.mark.slow
def test_errors_of_the_slow_methods():
    assert compare(tuple(METHOD_GROUPS.keys() - FAST), quick=False) >= 19


@pytest.mark.slow
def test_errors_of_the_options():
    """Those of paths, domains and materials, which take seconds."""
    quoted = {(row["option"], row["setting"].partition(" ")[0]): float(row["error"])
              for row in tables(section(TEXT, "## Options"))[0]}  # fmt: skip
    assert {group for group, _ in quoted} == set(options.OPTIONS)
    for part in (options.intervals, options.directions, options.steps):
        for row in part(quick=False):
            error = quoted[row.group, row.setting.split()[-1]]
            assert error / 3.0 < row.error < 3.0 * error, row


def test_defaults_are_marked():
    defaults = {row.method for group in FAST for row in METHOD_GROUPS[group](True) if row.default}
    marked = [row.get("method") for table in tables(TEXT) for row in table
              if "**(default)**" in row.get("setting", "")]  # fmt: skip
    assert defaults <= set(marked)


def test_every_hard_case_has_its_letters():
    (cases, _), rows = tables(HARD), {}
    for row in cases:
        rows[row["case"].split("**")[1]] = row
    wanted = {case.name: case for case in HARD_CASES if case.kind != "path"}
    assert rows.keys() == wanted.keys()
    for name, case in wanted.items():
        row = rows[name]
        assert row["case"] == f"**{name}**: {case.description}"
        assert row["values"] == f"{case.parameter} {case.values[0]:g} to {case.values[-1]:g}"
        for closure in {"affine", "traction"} & set(case.expected):
            assert f"`{case.expected[closure]}`" in row[closure]
        if case.kind == "faces":
            assert row["affine"] == f"loops {case.expected['loops']}"


@pytest.mark.slow
def test_errors_of_the_hard_tangents():
    judged = wrong = 0
    for case, row in zip(HARD_CASES, tables(HARD)[0], strict=False):
        if case.kind != "tangent":
            continue
        rows = tangent_rows(case)
        errors = [r["operator_error"] for r in rows]
        assert of_size(np.nanmax(errors), float(row["largest error"].split()[0])), case.name
        judged += sum(r["answer"] in "su" and r["exact"] in "su" for r in rows)
        wrong += sum(
            r["answer"] in "su" and r["exact"] in "su" and r["answer"] != r["exact"] for r in rows
        )
    assert f"{judged} were judged stable or unstable,\n{wrong} of them wrongly" in TEXT.replace(
        "unstable, 0", "unstable,\n0"
    )


@pytest.mark.slow
def test_hard_paths():
    quoted = {(row["path"].strip("*"), row["value"]): row for row in tables(HARD)[1]}
    rows = [row for case in HARD_CASES if case.kind == "path" for row in hard_path_rows(case)]
    assert len(rows) == len(quoted)
    for row in rows:
        said = quoted[row["case"], f"{row['parameter']} {row['value']:g}"]
        assert said["status"] == row["status"]
        assert said["events"] == row["events"].replace("_", " ")
        # A relative 1e-6 of the value is the strain's own shift by the shear at the start.
        assert of_size(row["error"], float(said["error of H11"]))
        assert of_size(row["energy_error"], float(said["energy"]), 1e-14)


def test_stiff_grains():
    (rows,) = tables(section(TEXT, "## Stiff grains"))
    case = next(case for case in HARD_CASES if case.name == "stiff-sliding-grains")
    found = [row for row in tangent_rows(case, 5) if row["closure"] == "traction"]
    assert len(rows) == len(case.values)
    for row, said in zip(found, rows[::5], strict=True):
        assert float(said["overlap"]) == pytest.approx(row["value"])
        assert said["verdict"] == row["answer"]
        # Rounding grown by the softness of the loop scatters; the bound holds it.
        assert max(row["operator_error"], float(said["operator"])) <= row["bound"]
        assert float(said["bound"]) == pytest.approx(row["bound"], rel=0.5)
        assert of_size(row["fraction_error"], float(said["fraction"]))


@pytest.mark.parametrize(
    ("overlap", "shares"), [(1e-5, (0.0, 0.0, 0.0)), (1e-8, (0.04, 0.01, 0.02))]
)
def test_even_loops_with_free_spins_that_are_not_trusted(overlap, shares):
    rng = np.random.default_rng(1)
    for order, share in zip((4, 6, 8), shares, strict=True):
        ring = random_loop(order, seed=order, convex=True, polydispersity=0.5, size=1000)
        relative = overlap * rng.uniform(0.5, 1.5, (1000, 1))
        normal = relative * (ring.radii + np.roll(ring.radii, -1, axis=-1))
        x = ring.x * (1 - relative[..., None])
        shear = 0.3 * normal * rng.uniform(-1, 1, normal.shape)
        loops = ring.replace(x=x, x0=x, normal_force=normal, shear_force=shear)
        by_branch, by_radii = (
            traction_tangent(
                loops, LinearFrictional(1.0, 0.5, 0.5, shear_increment=by), spins="free"
            )
            for by in ("branch", "radii")
        )
        assert 1 - by_branch.trusted.mean() == pytest.approx(share, abs=0.01)
        assert by_radii.trusted.all()


def test_figures_exist():
    for name in ("pareto", "batches", "settled", "stiff", "in-place"):
        assert f"figures/accuracy-{name}.png" in TEXT
        assert (DOCS / "figures" / f"accuracy-{name}.png").exists()


def compare_in_place(names, times):
    quoted = {(row["grains"], row["method"]): row for row in tables(section(TEXT, IN_PLACE))[0]}
    graph, law = repeated(times)
    faces = find_faces(graph)
    exact = loops_in_place(Scene(graph, law), faces, method="whole").matrix
    for name in names:
        place = loops_in_place(Scene(graph, law), faces, **METHODS[name][0])
        said, stated = quoted[f"{graph.grain_count:,}", name], place.error
        error = frobenius(place.matrix - exact) / frobenius(exact)
        found = (*np.quantile(error, [0.5, 0.9, 1.0]), np.median(stated), np.mean(error <= stated))
        for title, value in zip(ERRORS, found, strict=True):
            # Two digits.
            assert float(said[title]) == pytest.approx(100 * value, rel=0.06, abs=0.1), (
                name,
                title,
            )


@pytest.mark.slow
def test_loops_in_place():
    compare_in_place(("blocks 25, buffer 4", "blocks 6, buffer 8"), 1)


@pytest.mark.slow
def test_loops_in_place_by_every_method():
    compare_in_place([name for name in METHODS if name != "whole"], 1)
    compare_in_place([name for name, (_, most) in METHODS.items() if most > 8_000], 2)
