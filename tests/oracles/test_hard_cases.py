import numpy as np
import pytest

from loops import GrainGraph, InputError, contact_state, find_faces
from tests.oracles.hard_cases import HARD_CASES, LETTERS, hard_case

TANGENTS = [case for case in HARD_CASES if case.kind == "tangent"]


def test_every_hard_case_of_the_theory_has_a_name():
    names = {case.name for case in HARD_CASES}
    assert len(names) == len(HARD_CASES)
    assert names >= {
        *("flat-diamond", "steep-diamond", "soft-in-shear", "stiff-in-shear", "frictionless"),
        *("infinite-friction", "nearly-open", "stiff-grains", "next-to-yield", "yield-together"),
        *("force-control", "snap-back", "through-det-K", "at-threshold", "squashed-hexagon"),
        *("unequal-sizes", "coincident-grains", "order", "gear-mode", "singular-contact"),
        *("double-eigenvalue", "parallel-half-edges", "parting"),
    }


def test_expected_letters_fit_the_values():
    for case in HARD_CASES:
        for letters in case.expected.values():
            assert len(letters) == len(case.values)
            assert set(letters) <= {*LETTERS, "o"}
        assert case.expected or case.events


@pytest.mark.parametrize("case", HARD_CASES, ids=lambda case: case.name)
def test_scenes_are_built_or_refused(case):
    key = {"tangent": "affine", "faces": "loops", "path": ""}[case.kind]
    for k, value in enumerate(case.values):
        if case.kind == "tangent" and case.expected[key][k] == "e":
            with pytest.raises(InputError, match="coincid"):
                case.build(value)
            continue
        scene = case.build(value)
        assert isinstance(scene.graph, GrainGraph)
        assert bool(scene.stages) == (case.kind == "path")


@pytest.mark.parametrize(
    "case", [case for case in TANGENTS if "regime" in case.expected], ids=lambda case: case.name
)
def test_regimes_are_read_as_expected(case):
    for value, letter in zip(case.values, case.expected["regime"], strict=True):
        scene = case.build(value)
        regime = scene.law.regime(contact_state(scene.graph))
        assert {"oes"[r] for r in regime} == {letter}


def test_overlaps_of_stiff_grains_equal_the_value_of_the_case():
    for name in ("stiff-grains", "stiff-sliding-grains", "stiff-sliding-diamond"):
        case = hard_case(name)
        for value in case.values:
            graph = case.build(value).graph
            i, j = graph.contacts.T
            touching = graph.radii[i] + graph.radii[j]
            np.testing.assert_allclose(graph.normal_force / touching, value, rtol=1e-14)


def test_spokes_a_rounding_apart_are_distinguished():
    case = hard_case("parallel-half-edges")
    for value, letter in zip(case.values, case.expected["loops"], strict=True):
        graph = case.build(value).graph
        if letter == "e":
            with pytest.raises(InputError, match="same direction"):
                find_faces(graph)
            continue
        faces = find_faces(graph)
        assert (faces.order[faces.loops] == 3).all()
        assert len(faces.loops) == graph.grain_count - 1


def test_an_unknown_name_is_refused():
    with pytest.raises(InputError, match="gear-mode"):
        hard_case("gears")
