"""The smallest model gives what the full one gives, to rounding, and says what it left out."""

import numpy as np
import pytest

from loops import FrictionalLaw, InputError, LinearFrictional, Scene
from patterns import diamond, random_loop, regular_polygon
from stability import Stage, follow, programmes, rates_at

CLOSURES = ("affine", "traction")
SPINS = ("blocked", "affine", "free")
# Steps of the two differ: only the rows at events are the same states.
FIELDS = (
    "parameter",
    "H",
    "P",
    "x",
    "normal_force",
    "shear_force",
    "A",
    "H_rate",
    "P_rate",
    "work",
)
LAW = LinearFrictional(kn=1.0, kt=0.8, mu=np.tan(np.radians(20)))


def stages(confinement=0.1, end=0.25):
    return [
        Stage(programmes.isotropic_strain(), "H11", confinement),
        Stage(programmes.drained_biaxial(), "H11", end),
    ]


def both(loop, law=LAW, programme=None, closure="affine", **choices):
    programme = stages() if programme is None else programme
    return [
        follow(Scene(loop, law), programme, model=model, closure=closure, **choices)
        for model in ("auto", "full")
    ]


def events(path):
    return [(event.kind, event.contacts) for event in path.events]


def largest_difference(small, full):
    """Largest difference over events and the end, up to a state that only the small model passes.

    That is the singular one where other paths branch off, and rounding decides.
    """
    met = full.of_kind("control_limit")
    if met and small.status == "finished":
        (branching,) = small.of_kind("branching")
        assert met[0].parameter == pytest.approx(branching.parameter, abs=1e-6)
        assert met[0].cause in ("singular", "never_consistent")
        before = len(small.events) - 1
        assert events(small)[:before] == events(full)[:before]
        assert all(e.parameter > met[0].parameter - 1e-6 for e in full.events[before:])
        rows = [[event.index for event in path.events[:before]] for path in (small, full)]
    else:
        assert (small.status, events(small)) == (full.status, events(full))
        rows = [[*(event.index for event in path.events), -1] for path in (small, full)]
    found = 0.0
    for name in FIELDS:
        a, b = getattr(small, name)[rows[0]], getattr(full, name)[rows[1]]
        assert (np.isnan(a) == np.isnan(b)).all(), name
        scale = max(1.0, np.nanmax(np.abs(b), initial=0.0))
        found = max(found, np.nanmax(np.abs(a - b), initial=0.0) / scale)
    return found


# The rest of closures and spins with the longer polygons.
@pytest.mark.parametrize(
    ("closure", "spins"), [("affine", "free"), ("traction", "blocked"), ("traction", "affine")]
)
def test_short_polygons_to_rounding(closure, spins):
    small, full = both(regular_polygon(4), closure=closure, spins=spins)
    assert largest_difference(small, full) < 2e-14
    assert small.model.symmetry.startswith("D2")
    assert full.model.symmetry == "none"


@pytest.mark.slow
@pytest.mark.parametrize("spins", SPINS)
@pytest.mark.parametrize("closure", CLOSURES)
@pytest.mark.parametrize("orientation", ["vertex", "edge"])
@pytest.mark.parametrize("order", [3, 4, 5, 6, 7, 8, 9, 10, 11, 12])
def test_longer_polygons_to_rounding(order, orientation, closure, spins):
    small, full = both(
        regular_polygon(order, orientation=orientation), closure=closure, spins=spins
    )
    assert largest_difference(small, full) < 1e-13


@pytest.mark.slow
@pytest.mark.parametrize("closure", CLOSURES)
def test_contacts_added_in_pairs_keep_the_symmetry(closure):
    law = LinearFrictional(kn=1.0, kt=0.3, mu=0.3)
    small, full = both(
        diamond(np.radians(45)), law, stages(0.32, 0.36), closure=closure, contact_on_touch="add"
    )
    assert len(small.contacts) == len(full.contacts) == 6
    assert largest_difference(small, full) < 1e-13
    assert small.model.kept == "to the end"


@pytest.mark.parametrize(("seed", "closure"), [(0, "affine"), (1, "traction")])
def test_loops_without_symmetry_are_the_full_model(seed, closure):
    loop = random_loop(5, seed, strain=0.02, mu=0.2)
    small, full = both(
        loop, programme=Stage(programmes.isotropic_strain(), "H11", 0.04), closure=closure
    )
    assert small.model.symmetry == "none"
    assert small.model.unknowns == full.model.unknowns
    for name in FIELDS:
        assert np.array_equal(getattr(small, name), getattr(full, name), equal_nan=True)


def test_a_perturbation_of_1e_12_is_modelled():
    """All four contacts yield at once by symmetry; next to it they need not."""
    square = regular_polygon(4)
    x = np.array(square.x)
    x[0, 0] += 1e-12
    path = follow(Scene(square.replace(x=x, x0=x), LAW), stages(0.02, 0.03), closure="traction")
    assert path.model.symmetry == "D1 (order 2)"
    x[1, 0] += 2e-12
    path = follow(Scene(square.replace(x=x, x0=x), LAW), stages(0.02, 0.03), closure="traction")
    assert path.model.symmetry == "none"


class Stiffening(FrictionalLaw):
    """Linear springs, stiffer from an overlap of a twentieth on."""

    def closed_force(self, state):
        beyond = np.maximum(state.overlap - 0.05, 0.0)
        return state.overlap + self.more * beyond**3

    def stiffnesses(self, state):
        beyond = np.maximum(state.overlap - 0.05, 0.0)
        return 1.0 + 3.0 * self.more * beyond**2, 0.8


def test_laws_that_differ_at_overlaps_to_come_have_no_symmetry():
    """They are the same at the overlaps of the start."""
    law = Stiffening(more=np.array([0.0, 500.0, 100.0, 0.0]))
    stage = Stage("isotropic_strain", "H11", 0.06)
    small, full = both(regular_polygon(4, strain=0.04), law, stage, "traction")
    assert small.model.symmetry == "none"
    np.testing.assert_allclose(small.P[-1], full.P[-1], rtol=0, atol=1e-13)


def test_a_stage_keeps_the_symmetry_that_is_its_own():
    """Many relaxed modes of a ring go singular together; under isotropic strain none is left."""
    loop = regular_polygon(40)
    path = follow(Scene(loop, LAW), stages(0.47, 0.48), closure="traction")
    assert path.status == "finished"
    assert path.model.symmetry.startswith("D2")
    (threshold,) = path.of_kind("det_Ks_zero")
    assert threshold.parameter == pytest.approx(0.8 / 1.8, abs=2e-13)


@pytest.mark.parametrize("subspace", ["symmetric", "full"])
def test_the_judged_tangent_is_the_full_one(subspace):
    """Events outside the symmetric motions are met all the same."""
    loop = regular_polygon(4, orientation="edge")
    programme = Stage(programmes.isotropic_strain(), "H11", 0.5)
    small, full = both(loop, programme=programme, closure="traction", subspace=subspace)
    assert any(event.kind == "det_Ks_zero" for event in small.events)
    assert largest_difference(small, full) < 1e-12


@pytest.mark.parametrize(("length", "kn"), [(1e-3, 1e-3), (1.0, 1.0), (1e3, 1e3)])
@pytest.mark.parametrize(
    ("shear", "off", "rough", "symmetry"),
    [
        (0.0, 0.0, 0.0, "D4 (order 8)"), (1e-18, 0.0, 0.0, "D4 (order 8)"),
        (1e-10, 0.0, 0.0, "none"), (0.0, 0.0, 1e-8, "D1 (order 2)"),
        (0.0, 5e-13, 0.0, "D4 (order 8)"), (0.0, 5e-12, 0.0, "D2 (order 4)"),
    ],
)  # fmt: skip
def test_a_symmetry_is_kept_within_rounding_in_any_units(shear, off, rough, symmetry, length, kn):
    """A shear force or the friction of one contact breaks it, and strains that are not equal."""
    square = regular_polygon(4, strain=0.05)
    graph = square.replace(
        x=length * square.x, x0=length * square.x, radii=0.5 * length * np.ones(4),
        normal_force=kn * length * square.normal_force,
        shear_force=kn * length * shear * np.array([1.0, 0.0, 0.0, 0.0]),
    )  # fmt: skip
    stage = Stage(programmes.proportional_strain(1.0, 1.0 + off), "H11", 1e-3)
    law = LinearFrictional(kn, 0.2 * kn, 0.3 + rough * np.array([1.0, 0.0, 0.0, 0.0]))
    path = follow(Scene(graph, law), stage, closure="affine")
    assert path.model.symmetry == symmetry


def test_one_solve_where_no_contact_has_a_choice():
    loop = regular_polygon(6, strain=0.05)
    found = rates_at(Scene(loop, LAW), programmes.drained_biaxial(), closure="affine")
    assert (found.status, found.tried, found.combinations) == ("unique", 1, 1.0)


def test_an_unknown_model_is_refused():
    with pytest.raises(InputError, match="model"):
        follow(Scene(regular_polygon(4), LAW), stages(), model="small", closure="affine")
