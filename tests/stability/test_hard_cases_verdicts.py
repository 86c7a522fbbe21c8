"""What must come out of the hard cases: verdicts, errors within their bounds, events."""

import numpy as np
import pytest

from loops import Scene, affine_tangent, traction_tangent
from stability import (
    branch_fraction,
    judge,
    programmes,
    rates_at,
    restrict,
    statuses,
    symmetric_spectrum,
)
from tests.benchmarks.hard_cases import (
    followed,
    hard_path_rows,
    loop_letters,
    read_letters,
    solve,
    tangent_rows,
)
from tests.oracles.hard_cases import HARD_CASES, hard_case
from tests.oracles.loop_balls import exact_tangent

# The longest rings take seconds in 50 digits.
TANGENTS = [case for case in HARD_CASES if case.kind == "tangent" and case.name != "gear-mode"]
PATHS = [case for case in HARD_CASES if case.kind == "path"]


def check(case):
    rows = tangent_rows(case)
    for closure in ("affine", "traction"):
        found = "".join(row["answer"] for row in rows if row["closure"] == closure)
        assert found == case.expected[closure]
    for row in rows:
        # Undetermined is an answer; a wrong sign is none.
        assert row["answer"] in "?e" or row["exact"] in ("-", row["answer"])
        if np.isfinite(row["operator_error"]):
            assert row["operator_error"] <= row["bound"]
            assert row["eigenvalue_error"] <= max(row["bound"], 1e-15)


@pytest.mark.parametrize("case", TANGENTS, ids=lambda case: case.name)
def test_verdicts_are_right_and_errors_within_their_bounds(case):
    check(case)


@pytest.mark.slow
def test_the_gear_mode_does_not_touch_the_operator():
    check(hard_case("gear-mode"))


@pytest.mark.parametrize("name", ["next-to-yield", "frictionless", "infinite-friction"])
def test_what_the_state_says_of_its_contacts(name):
    case = hard_case(name)
    found = read_letters(case)
    for key in {"regime", "edge"} & set(case.expected):
        assert found[key] == case.expected[key]


def test_parallel_half_edges_are_ordered_or_refused():
    case = hard_case("parallel-half-edges")
    assert loop_letters(case) == case.expected["loops"]


@pytest.mark.parametrize("case", PATHS, ids=lambda case: case.name)
def test_paths_meet_their_events(case):
    for row in hard_path_rows(case):
        assert row["expected_met"], row
        # A shear force at the start moves point B of Table 1 by some times itself.
        moved = 10 * row["value"] if case.name == "yield-together" else 0.0
        assert row["error"] <= moved + 1e-14
        assert row["energy_error"] < 1e-12
        assert np.isfinite(row["condition"])


def test_every_row_of_a_path_has_its_condition():
    path = followed(hard_case("force-control").build(0.1), "traction")
    assert path.condition.shape == path.parameter.shape
    assert (path.condition >= 1.0).all()
    assert "condition" in path.columns()


def test_a_tangent_brings_its_error_to_the_verdict():
    scene = hard_case("stiff-sliding-grains").build(1e-8)
    tangent = solve(scene, "traction")
    size = np.linalg.norm(tangent.matrix)
    rounding = 8 * np.finfo(float).eps
    np.testing.assert_allclose(tangent.error, rounding * tangent.condition * size, rtol=1e-14)
    verdict = judge(tangent, "symmetric")
    plain = judge(tangent.matrix, "symmetric")
    assert verdict.status == plain.status == "unstable"
    norm = np.linalg.norm(restrict(tangent.matrix, "symmetric"))
    np.testing.assert_allclose(verdict.tolerance, 1e-12 + tangent.error / norm, rtol=1e-14)
    wide = 1.01 * abs(plain.symmetric_eigenvalues[0])
    assert judge(tangent, "symmetric", error=wide).status == "undetermined"
    assert judge(tangent.matrix, "symmetric", error=0.9 * wide).status == "unstable"


def test_statuses_of_a_batch_take_errors_one_by_one():
    found = statuses([0.1, 0.1, -0.1, 0.1], 1.0, error=[0.0, 0.2, 0.05, np.inf])
    assert found.tolist() == ["stable", "undetermined", "unstable", "undetermined"]


def test_an_operator_without_a_digit_is_not_a_number():
    """The condition grows as one over the overlap; once its rounding exceeds 1, nothing is said."""
    scene = hard_case("stiff-sliding-grains").build(1e-12)
    far = scene.graph.replace(
        normal_force=1e-4 * scene.graph.normal_force, shear_force=1e-4 * scene.graph.shear_force
    )
    tangent = traction_tangent(far, scene.law)
    assert not tangent.trusted
    assert np.isnan(tangent.matrix).all()
    assert tangent.error == np.inf
    assert judge(tangent, "symmetric").status == "undetermined"
    values = symmetric_spectrum(restrict(tangent.matrix, "symmetric"))
    assert statuses(values[0], 1.0, error=tangent.error) == "undetermined"


def test_the_affine_sum_loses_nothing_but_to_its_area():
    scene = hard_case("stiff-sliding-grains").build(1e-12)
    tangent = affine_tangent(scene.graph, scene.law)
    # Some for the sum, whatever the overlap, and the terms of the hexagon's area over the area.
    assert 1.0 <= tangent.condition < 6.0
    assert tangent.error < 1.2e-14 * np.linalg.norm(tangent.matrix)


@pytest.mark.parametrize("flatness", [1e-2, 1e-6])
def test_flatness_along_an_axis_costs_no_digits(flatness):
    tangent = solve(hard_case("squashed-hexagon").build(flatness), "traction")
    assert tangent.condition < 1e3


@pytest.mark.parametrize("excess", [1e-2, 1e-5, 1e-9])
def test_a_nearly_singular_contact_costs_no_digits(excess):
    """What is soft in shear is an unknown of its own: nothing is divided by next to nothing."""
    scene = hard_case("singular-contact").build(excess)
    tangent = traction_tangent(scene.graph, scene.law)
    exact = exact_tangent(scene.graph, scene.law)
    assert np.linalg.norm(tangent.matrix - exact) < 1e-14 * np.linalg.norm(exact)
    assert tangent.condition < 1e3


@pytest.mark.parametrize("closure", ["affine", "traction"])
def test_within_rounding_of_yield_directions_decide_alike(closure):
    case = hard_case("next-to-yield")
    scenes = [case.build(value) for value in case.values]
    below, *near = (branch_fraction(s.graph, s.law, closure=closure) for s in scenes)
    shares = [float(found.unstable) for found in near]
    np.testing.assert_allclose(shares, shares[0], atol=1e-9)
    # Not at yield, nothing slides: no direction is unstable.
    assert below.unstable == 0.0 < shares[0]
    for scene in scenes[1:]:
        found = rates_at(Scene(scene.graph, scene.law), programmes.oedometric(), closure=closure)
        assert found.status == "unique"
        assert found.taken.rates.rates.condition < 1e4
