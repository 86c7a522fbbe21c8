"""Limits and tolerances of paths: what lies on either side of them."""

import numpy as np
import pytest

from loops import InputError, LinearFrictional, Scene
from patterns import diamond, regular_polygon
from stability import Stage, follow, programmes, rates_at

LAW = LinearFrictional(kn=1.0, kt=0.2, mu=0.3)


def isotropic(E):
    return Stage(programmes.isotropic_strain(), "H11", E)


@pytest.mark.parametrize(("off", "refused"), [(5e-10, False), (2e-9, True)])
def test_forces_that_do_not_fit_the_overlaps_are_refused(off, refused):
    confined = regular_polygon(4, strain=0.1)
    beyond = confined.replace(shear_force=np.array([0.03 + off, 0.0, 0.0, 0.0]))
    pressed = confined.replace(normal_force=confined.normal_force + off)
    for graph, name in ((pressed, "normal force"), (beyond, "shear force")):
        if refused:
            with pytest.raises(InputError, match=f"{name} of contact 0"):
                rates_at(Scene(graph, LAW), programmes.isotropic_strain(), closure="affine")
        else:
            assert (
                rates_at(Scene(graph, LAW), programmes.isotropic_strain(), closure="affine").status
                == "unique"
            )


@pytest.mark.parametrize("closure", ["affine", "traction"])
@pytest.mark.parametrize("end", [1e-9, 1e-16])
def test_stages_of_any_length_end_at_their_target(end, closure):
    path = follow(Scene(regular_polygon(5), LAW), isotropic(end), closure=closure)
    assert (path.status, len(path.events)) == ("finished", 0)
    assert path.H[-1, [0, 3]] == pytest.approx([end, end], rel=1e-13, abs=0)
    assert path.normal_force[-1] == pytest.approx(np.full(5, end), rel=1e-13, abs=0)


@pytest.mark.parametrize(("shear", "torn"), [(5e-10, False), (2e-9, True)])
def test_a_shear_force_that_a_parting_contact_may_drop(shear, torn):
    # Isotropic strain turns no branch: the shear force stays until the contacts open.
    start = diamond(np.pi / 4, E1=0.01, E2=0.01, T=shear)
    stage = Stage(programmes.isotropic_strain(-1.0), "H11", -0.01)
    path = follow(Scene(start, LinearFrictional(1.0, 0.2)), stage, closure="traction")
    assert ("part while they carry a force" in path.message) == torn
    assert path.H[-1, 0] == pytest.approx(0.0 if torn else -0.01, abs=1e-12)


@pytest.mark.parametrize(("shear", "events"), [(1e-13, 1), (1.2e-11, 2)])
def test_contacts_that_yield_within_rounding_yield_at_once(shear, events):
    confined = diamond(np.pi / 4, E1=0.3, E2=0.3)
    disturbed = confined.replace(shear_force=shear * np.array([1.0, 0.0, 0.0, 0.0]))
    law = LinearFrictional(kn=1.0, kt=0.2, mu=np.tan(np.radians(5.0)))
    path = follow(
        Scene(disturbed, law), Stage(programmes.drained_biaxial(), "H11", 0.42), closure="affine"
    )
    assert len(path.of_kind("yield")) == events


@pytest.mark.parametrize(("short", "events"), [(3e-13, 2), (1e-9, 0)])
def test_a_stage_that_ends_within_rounding_of_an_event_meets_it(short, events):
    # det K and det Ks of the square vanish at kappa/(1 + kappa).
    path = follow(Scene(diamond(np.pi / 4), LAW), isotropic(1 / 6 - short), closure="affine")
    assert len(path.of_kind("det_K_zero") + path.of_kind("det_Ks_zero")) == events
