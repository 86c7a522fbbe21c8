"""Errors of the input against finite differences, and against perturbed samples."""

import numpy as np
import pytest

import grainloops as gl
from loops import macroscopic_tangent
from stability import restrict, symmetric_spectrum
from stability.input_error import RULES, InputErrors, at_edge, eigenvalue_errors

LINEAR = gl.LinearFrictional(1.0, 0.4, 0.5)
HERTZ = gl.HertzMindlin(young=10.0, poisson=0.3, mu=0.5)


def smallest(graph, law, rule, **regime):
    closure, spins = RULES[rule]
    A = macroscopic_tangent(graph, law, closure, spins=spins, **regime).matrix
    return symmetric_spectrum(restrict(A, "symmetric"))[..., 0]


def errors_of(graph, **errors):
    none = np.zeros(graph.contact_count), np.zeros(graph.grain_count)
    return InputErrors(**{name: none[name in "xy"] for name in InputErrors._fields} | errors)


def found_of(graph, law, regime, errors):
    faces = gl.find_faces(graph)
    return eigenvalue_errors(graph, law, regime, faces, errors, faces.loops)


def ring(order, law, sliding=False):
    graph = gl.random_loop(order, order, convex=order < 6, polydispersity=0.2, strain=0.05)
    graph = graph.replace(x0=graph.x, normal_force=law.normal_force(gl.contact_state(graph)))
    regime = np.ones(order, dtype=np.int8)
    if sliding:
        regime[[0, 2]] = gl.Regime.SLIDING
    return graph, regime


@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize("sliding", [False, True])
@pytest.mark.parametrize("law", [LINEAR, HERTZ])
@pytest.mark.parametrize("order", [3, 4, 5, 8])
def test_the_bound_adds_the_slopes_of_every_contact(order, law, sliding, rule):
    graph, regime = ring(order, law, sliding)
    step, total = 1e-6, 0.0
    for name in ("normal_force", "shear_force"):
        changes = step * np.concatenate([np.eye(order), -np.eye(order)])
        moved = graph.replace(**{name: getattr(graph, name) + changes})
        up, down = np.split(smallest(moved, law, rule, regime=regime), 2)
        total += np.abs(up - down).sum() / 2.0
    size = np.full(order, step)
    found = found_of(graph, law, regime, errors_of(graph, N=size, T=size))[rule]
    assert found.value[0] == pytest.approx(smallest(graph, law, rule, regime=regime), rel=1e-9)
    # Of first order in the steps, those of 1e-7 and the one here.
    assert found.bound[0] == pytest.approx(total, rel=1e-4)


@pytest.mark.parametrize("rule", RULES)
def test_the_bound_of_stiffness_is_that_of_kn_and_of_kt(rule):
    graph, regime = ring(6, LINEAR)
    step, total = 1e-6, 0.0
    for name in ("kn", "kt"):
        for c in range(6):
            k = {"kn": np.ones(6), "kt": np.full(6, 0.4)}
            values = []
            for sign in (1, -1):
                own = k | {name: k[name] * (1.0 + sign * step * (np.arange(6) == c))}
                law = gl.LinearFrictional(own["kn"], own["kt"], 0.5)
                values.append(smallest(graph, law, rule, regime=regime))
            total += abs(values[0] - values[1]) / 2.0
    share = np.full(6, step)
    found = found_of(graph, LINEAR, regime, errors_of(graph, kn=share, kt=share))[rule]
    assert found.bound[0] == pytest.approx(total, rel=1e-4)


@pytest.mark.parametrize("rule", ["affine", "traction"])
@pytest.mark.parametrize("law", [LINEAR, HERTZ])
@pytest.mark.parametrize("order", [3, 6])
def test_the_bound_of_the_centres_is_that_of_moving_each(order, law, rule):
    """Branches, frames, levers, areas and overlaps go with them; the forces stay."""
    graph, regime = ring(order, law)
    step, total = 1e-7, 0.0
    for grain in range(order):
        for axis in range(2):
            moved = [graph.x.copy(), graph.x.copy()]
            moved[0][grain, axis] += step
            moved[1][grain, axis] -= step
            values = [smallest(graph.replace(x=x, x0=x), law, rule, regime=regime) for x in moved]
            total += abs(values[0] - values[1]) / 2.0
    size = np.full(order, step)
    found = found_of(graph, law, regime, errors_of(graph, x=size, y=size))[rule]
    assert found.bound[0] == pytest.approx(total, rel=2e-5)


@pytest.fixture(scope="module")
def sample():
    return gl.read_snapshot(gl.sample_path())


def smallest_of(graph, law, faces, rule):
    closure, spins = RULES[rule]
    A = gl.loop_tangents(graph, law, faces, closure, spins=spins).matrix
    return symmetric_spectrum(restrict(A, "symmetric"))[..., 0]


@pytest.mark.parametrize(
    ("share", "draws"), [(1e-3, 2), (0.03, 3), pytest.param(0.03, 20, marks=pytest.mark.slow)]
)
def test_drawn_errors_of_the_forces_stay_within_the_errors(sample, share, draws):
    """Contacts that come to their strength slide, others stick, as the law has it."""
    graph, (law, regime) = sample.graph, sample.mechanics()
    force = share * np.hypot(graph.normal_force, graph.shear_force)
    errors = errors_of(graph, N=force, T=force)
    near = at_edge(gl.contact_state(graph), law, errors).any(axis=0)
    found = eigenvalue_errors(graph, law, regime, sample.faces, errors, sample.faces.loops)
    outside = dict.fromkeys(RULES, 0)
    for seed in range(1, draws + 1):
        rng = np.random.default_rng(seed)
        u, v = rng.uniform(-1.0, 1.0, (2, graph.contact_count))
        drawn = graph.replace(
            normal_force=graph.normal_force + u * force, shear_force=graph.shear_force + v * force
        )
        own = np.where(near, law.regime(gl.contact_state(drawn)), regime)
        drawn = drawn.replace(regime=own)
        for rule, one in found.items():
            change = np.abs(smallest_of(drawn, law, sample.faces, rule) - one.value)
            outside[rule] += np.count_nonzero(change > one.error * (1.0 + 1e-3))
            sure = one.error == one.bound
            assert sure.any() and (change <= one.bound * (1.0 + 1e-2))[sure].all()
    # The bound is of first order.
    assert not any(outside.values())


@pytest.mark.parametrize("digits", [4, 6])
def test_rounded_positions_stay_within_the_errors_of_their_digits(sample, digits):
    graph, (law, regime) = sample.graph, sample.mechanics()
    from studies.snapshot.input_error import half_unit

    size = 10.0 ** (np.floor(np.log10(np.abs(graph.x).max())) - digits + 1)
    rounded = graph.replace(x=np.round(graph.x / size) * size, x0=None, regime=regime)
    assert np.array_equal(half_unit(rounded.x), np.full(graph.x.shape, 0.5 * size))
    errors = errors_of(graph, **dict(zip("xy", half_unit(rounded.x).T, strict=True)))
    known = eigenvalue_errors(graph, law, regime, sample.faces, errors, sample.faces.loops)
    for rule, one in known.items():
        found = smallest_of(rounded, law, sample.faces, rule)
        assert (np.abs(found - one.value) <= one.error).all()


def test_contacts_within_the_errors_of_their_strength_are_at_the_edge():
    graph, _ = ring(5, LINEAR)
    N = graph.normal_force
    share = np.array([0.5, 0.47, 0.44, -0.5, 0.0])
    graph = graph.replace(shear_force=share * N)
    errors = errors_of(graph, N=0.02 * N, T=0.02 * N)
    near = at_edge(gl.contact_state(graph), LINEAR, errors)
    back, ahead = [False, False, False, True, False], [True, True, False, False, False]
    assert near.tolist() == [back, ahead]
    assert not at_edge(gl.contact_state(graph), LINEAR, errors_of(graph)).any()


@pytest.mark.parametrize("rule", RULES)
def test_drawn_triangles_whose_shear_forces_may_turn_stay_within_the_errors(rule):
    """A contact that comes to its strength does so on the side of its shear force."""
    graph = gl.polydisperse_polygon([0.2, 0.5, 0.9], strain=1e-5)
    N = graph.normal_force
    graph = graph.replace(shear_force=[-0.45, -0.3, 0.3] * N)
    share = 0.3 * np.hypot(N, graph.shear_force)
    assert at_edge(gl.contact_state(graph), LINEAR, errors_of(graph, N=share, T=share)).sum() == 3
    regime = np.full(3, gl.Regime.ELASTIC)
    found = found_of(graph, LINEAR, regime, errors_of(graph, N=share, T=share))[rule]
    signs = np.stack(np.meshgrid(*[[-1.0, 1.0]] * 6), axis=-1).reshape(-1, 2, 3)
    drawn = graph.replace(
        normal_force=N + signs[:, 0] * share, shear_force=graph.shear_force + signs[:, 1] * share
    )
    own = LINEAR.regime(gl.contact_state(drawn))
    assert (own == gl.Regime.SLIDING).all(axis=-1).any()
    change = np.abs(smallest(drawn, LINEAR, rule, regime=own) - found.value)
    assert change.max() == pytest.approx(found.error[0], rel=1e-3)
    assert change.max() <= found.error[0]
