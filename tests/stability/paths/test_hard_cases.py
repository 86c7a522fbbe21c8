"""Hard cases of paths: flat and steep diamonds, extreme stiffness, units, other shear rules."""

import numpy as np
import pytest

from loops import (
    HertzMindlin,
    LinearFrictional,
    RollingResistance,
    Scene,
    boundary_of,
    contact_state,
)
from patterns import diamond, regular_polygon
from stability import Stage, follow, programmes
from tests.oracles.diamond import DIAMOND_SHEAR_SIGNS, DiamondParameters, angle_from_strains
from tests.oracles.drained import drained_path as exact_drained_path

CLOSURES = ("affine", "traction")


def drained_stages(confinement, end):
    return [
        Stage(programmes.isotropic_strain(), "H11", confinement),
        Stage(programmes.drained_biaxial(), "H11", end),
    ]


@pytest.mark.parametrize(
    ("alpha0", "kappa", "phi", "confinement", "closure"),
    [
        (2.0, 0.2, 10.0, 0.1, "affine"),
        (85.0, 0.5, 0.05, 0.1, "traction"),
        pytest.param(45.0, 2.0, 10.0, 0.1, "affine", marks=pytest.mark.slow),
        pytest.param(45.0, 1e-3, 0.02, 0.2, "traction", marks=pytest.mark.slow),
        (20.0, 0.2, 30.0, 0.02, "affine"),
        (40.0, 0.3, 0.1, 1e-6, "traction"),
    ],
)
def test_yield_of_extreme_diamonds(alpha0, kappa, phi, confinement, closure):
    p = DiamondParameters(np.radians(alpha0), kappa, np.radians(phi), confinement)
    exact = exact_drained_path(p)
    assert exact.status == "yield"
    law = LinearFrictional(kn=1.0, kt=kappa, mu=p.mu)
    end = float(exact.end.E1) + 0.1 * confinement
    path = follow(
        Scene(diamond(p.alpha0), law, boundary_of(diamond(p.alpha0), volume=1.0)),
        drained_stages(confinement, end),
        closure=closure,
    )
    reached = next(event for event in path.events if event.contacts == (0, 1, 2, 3))
    assert reached.kind == ("control_limit" if exact.snaps_back else "yield")
    size = max(abs(float(exact.end.E1)), abs(float(exact.end.E2)))
    expected = [float(exact.end.E1), float(exact.end.E2)]
    assert path.H[reached.index, [0, 3]] == pytest.approx(expected, abs=1e-11 * size)
    N, T = path.normal_force[reached.index], path.shear_force[reached.index]
    assert pytest.approx(float(exact.end.N), abs=1e-11 * confinement) == N
    assert pytest.approx(float(exact.end.T) * DIAMOND_SHEAR_SIGNS, abs=1e-11 * confinement) == T


@pytest.mark.parametrize("closure", CLOSURES)
def test_without_shear_stiffness_nothing_is_sheared(closure):
    law = LinearFrictional(kn=1.0, kt=0.0, mu=0.1)
    path = follow(Scene(diamond(0.8), law), drained_stages(0.1, 0.2), closure=closure)
    assert path.status == "finished"
    assert not path.shear_force.any()
    assert path.work[-1, 3] == 0.0


@pytest.mark.parametrize("closure", CLOSURES)
def test_shear_by_radii_counts_the_turn_alone(closure):
    # Yade's rule: T' = kt (r_i + r_j) alpha', whatever the length of the branch.
    law = LinearFrictional(kn=1.0, kt=0.3, shear_increment="radii")
    oedometric = Stage(programmes.oedometric(), "H11", 0.3)
    stages = [Stage(programmes.isotropic_strain(), "H11", 0.1), oedometric]
    path = follow(Scene(diamond(0.7), law), stages, closure=closure)
    turned = angle_from_strains(path.H[:, 0], path.H[:, 3], 0.7) - 0.7
    expected = 0.3 * turned[:, None] * DIAMOND_SHEAR_SIGNS
    assert path.shear_force == pytest.approx(expected, abs=1e-13)
    assert np.abs(path.energy_error).max() < 1e-12


@pytest.mark.parametrize(
    ("order", "orientation", "end", "max_step"),
    [
        (5, "vertex", 0.9, 0.05),
        (8, "edge", 0.4, 0.05),
        (8, "edge", 0.4, 0.037),
        (10, "vertex", 0.4, 0.05),
    ],
)
def test_through_a_singular_threshold_there_is_always_an_answer(
    monkeypatch, order, orientation, end, max_step
):
    """Relaxed rings compressed through kappa/(1 + kappa), where the balance is singular.

    Whether a step lands on the singular state is chance; the path goes on or says where it ends,
    and the loss it has met is the threshold.
    """
    kappa = 0.3
    monkeypatch.setattr("stability.paths.loop_path.LONGEST_STEP", max_step)
    path = follow(
        Scene(regular_polygon(order, orientation=orientation), LinearFrictional(1.0, kappa)),
        [Stage(programmes.isotropic_strain(), "H11", end)],
        closure="traction",
    )
    assert path.status in ("finished", "control_limit", "lost")
    assert path.status == "finished" or path.message
    (loss,) = [event for event in path.of_kind("det_Ks_zero")][:1]
    assert abs(path.H[loss.index, 0] - kappa / (1 + kappa)) < 1e-8
    assert np.isfinite(path.H).all() and np.isfinite(path.P).all()


DRIVEN = {
    "isotropic strain": (programmes.isotropic_strain, "H11"),
    "isotropic stress": (programmes.isotropic_stress, "P11"),
    "drained": (lambda s: programmes.drained_biaxial(rate=s), "H11"),
    "oedometric": (lambda s: programmes.oedometric(rate=s), "H11"),
    "undrained": (lambda s: programmes.undrained(rate=s), "H11"),
    "force": (lambda s: programmes.proportional_stress(s, 0.0), "P11"),
}


def driven(name, sense, target):
    programme, quantity = DRIVEN[name]
    return Stage(programme(sense), quantity, target)


def random_law(rng):
    mu = float(rng.choice([np.inf, 0.0, rng.uniform(0.05, 0.8)], p=[0.2, 0.1, 0.7]))
    linear = LinearFrictional(kn=1.0, kt=rng.uniform(0.1, 1.0), mu=mu)
    kind = rng.choice(["linear", "hertz", "rolling"], p=[0.6, 0.2, 0.2])
    if kind == "hertz":
        return HertzMindlin(young=1.0, poisson=rng.uniform(0.0, 0.5), mu=mu)
    return RollingResistance(linear, rng.uniform(0.01, 0.3)) if kind == "rolling" else linear


def random_scene(seed):
    """Graph, law, stages and options of one path."""
    rng = np.random.default_rng(seed)
    law = random_law(rng)
    graph = regular_polygon(int(rng.integers(3, 13)), strain=rng.uniform(0.01, 0.1))
    if rng.random() < 0.5:
        # An irregular loop: the reference is moved too, so that it stays an affine image.
        moved = graph.x + 0.02 * rng.standard_normal(graph.x.shape)
        graph = graph.replace(x=moved, x0=moved)
    graph = graph.replace(normal_force=law.normal_force(contact_state(graph)))
    level = rng.uniform(0.1, 0.25)
    stages = [Stage(programmes.isotropic_strain(), "H11", level)]
    for _ in range(int(rng.integers(1, 4))):
        name = str(rng.choice(list(DRIVEN)))
        back = bool(rng.random() < 0.5)
        if name in ("isotropic stress", "force"):
            # Back to zero, or on: the stress of the start is some tenths.
            stages.append(driven(name, -1.0 if back else 1.0, 0.0 if back else 1.0))
            continue
        target = 0.0 if back else level + float(rng.choice([-1.0, 1.0])) * rng.uniform(0.02, 0.25)
        if target != level:
            stages.append(driven(name, float(np.sign(target - level)), target))
        level = target
    options = {
        "closure": str(rng.choice(["affine", "traction"])),
        "spins": str(rng.choice(["blocked", "affine", "free"])),
        "contact_on_touch": str(rng.choice(["ignore", "add"])),
    }
    return graph, law, stages, options


def test_regimes_do_not_keep_switching():
    """Hertzian contacts that yield with 1e-11 of overlap left: no digit of their forces tells."""
    graph, law, stages, options = random_scene(48)
    path = follow(Scene(graph, law), stages, **options)
    assert path.status == "control_limit"
    assert "isotropic stress" in path.message


def test_springs_against_rolling_change_nothing_where_spins_are_blocked():
    """Also where contacts slide without a force, and part or stick as soon as they move."""
    graph, law, stages, options = random_scene(170)
    assert isinstance(law, RollingResistance) and options["spins"] == "blocked"
    paths = [follow(Scene(graph, one), stages, **options) for one in (law, law.law)]
    found, wanted = ([(e.kind, e.contacts) for e in path.events] for path in paths)
    assert found == wanted and len(found) > 12
    for one, other in zip(*(path.events for path in paths), strict=True):
        np.testing.assert_allclose(one.H, other.H, rtol=0, atol=1e-13)


@pytest.mark.parametrize("end", [0.4, 0.46, 0.5])
@pytest.mark.parametrize("shift", [0, 3])
def test_spheres_that_part_on_an_axis_of_symmetry_open(shift, end):
    """The contact on the axis has no shear force but rounding, and loses its force as depth^1.5.

    There its strength falls to that rounding before its overlap ends; it opens, wherever the stage
    ends and however grains are numbered, and the path goes on.
    """
    loop = regular_polygon(5)
    x = np.roll(loop.x, shift, axis=0)
    law = HertzMindlin(young=1.82, poisson=0.3, mu=np.tan(np.radians(5.0)))
    stages = [Stage(programmes.isotropic_strain(), "H11", 0.1),
              Stage(programmes.drained_biaxial(), "H11", end)]  # fmt: skip
    path = follow(Scene(loop.replace(x=x, x0=x), law), stages, closure="affine")
    opening = path.of_kind("opening")[0]
    assert path.status == "finished" and opening.contacts == ((2 + shift) % 5,)
    # Its branch lies along axis 2: it opens where H22 is back at zero. Depth^1.5 of 1e-13 is 2e-9.
    assert path.H[opening.index, 3] == pytest.approx(0.0, abs=4e-9)
    assert (path.normal_force[opening.index + 1 :, opening.contacts[0]] == 0.0).all()
