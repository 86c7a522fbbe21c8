"""Errors of the input against finite differences, and against perturbed samples."""

import numpy as np
import pytest

import grainloops as gl
from stability.input_error import CLOSURES, ContactErrors, at_edge, eigenvalue_errors, smallest

LINEAR = gl.LinearFrictional(1.0, 0.4, 0.5)
HERTZ = gl.HertzMindlin(young=10.0, poisson=0.3, mu=0.5)
TANGENTS = {"affine": gl.affine_tangent, "traction": gl.traction_tangent}


def no_errors(count, **errors):
    fields = dict.fromkeys(ContactErrors._fields, np.zeros(count)) | errors
    return ContactErrors(**fields)


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


@pytest.mark.parametrize("closure", CLOSURES)
@pytest.mark.parametrize("sliding", [False, True])
@pytest.mark.parametrize("law", [LINEAR, HERTZ])
@pytest.mark.parametrize("order", [3, 4, 5, 8])
def test_the_bound_adds_the_slopes_of_every_contact(order, law, sliding, closure):
    graph, regime = ring(order, law, sliding)
    step, total = 1e-6, 0.0
    for name in ("normal_force", "shear_force"):
        for c in range(order):
            up, down = (
                graph.replace(
                    **{name: getattr(graph, name) + sign * step * (np.arange(order) == c)}
                )
                for sign in (1, -1)
            )
            values = [
                smallest(TANGENTS[closure](one, law, regime=regime).matrix) for one in (up, down)
            ]
            total += abs(values[0] - values[1]) / 2.0
    size = np.full(order, step)
    found = found_of(graph, law, regime, no_errors(order, N=size, T=size))[closure]
    known = smallest(TANGENTS[closure](graph, law, regime=regime).matrix)
    # Blocks have springs of 1e-12 kn, which sliding contacts feel: they are as soft as N/l.
    assert found.value[0] == pytest.approx(known, rel=1e-9)
    # Of second order in the step.
    assert found.bound[0] == pytest.approx(total, rel=1e-4)


@pytest.mark.parametrize("closure", CLOSURES)
def test_the_bound_of_stiffness_is_that_of_kn_and_of_kt(closure):
    graph, regime = ring(6, LINEAR)
    step, total = 1e-6, 0.0
    for name in ("kn", "kt"):
        for c in range(6):
            k = {"kn": np.ones(6), "kt": np.full(6, 0.4)}
            values = []
            for sign in (1, -1):
                own = k | {name: k[name] * (1.0 + sign * step * (np.arange(6) == c))}
                law = gl.LinearFrictional(own["kn"], own["kt"], 0.5)
                values.append(smallest(TANGENTS[closure](graph, law, regime=regime).matrix))
            total += abs(values[0] - values[1]) / 2.0
    errors = no_errors(6, stiffness=np.full(6, step))
    found = found_of(graph, LINEAR, regime, errors)[closure]
    assert found.bound[0] == pytest.approx(total, rel=1e-6)


@pytest.fixture(scope="module")
def sample():
    return gl.read_snapshot(gl.sample_path())


@pytest.mark.parametrize("share", [1e-3, 0.03])
def test_drawn_errors_of_the_forces_stay_within_the_errors(sample, share):
    """Contacts that come to their strength slide, others stick, as the law has it."""
    graph, (law, regime) = sample.graph, sample.mechanics()
    force = share * np.hypot(graph.normal_force, graph.shear_force)
    errors = no_errors(graph.contact_count, N=force, T=force)
    near = at_edge(gl.contact_state(graph), law, errors)
    found = eigenvalue_errors(graph, law, regime, sample.faces, errors, sample.faces.loops)
    rng, outside = np.random.default_rng(1), dict.fromkeys(CLOSURES, 0)
    for _ in range(10):
        u, v = rng.uniform(-1.0, 1.0, (2, graph.contact_count))
        drawn = graph.replace(
            normal_force=graph.normal_force + u * force, shear_force=graph.shear_force + v * force
        )
        own = np.where(near, law.regime(gl.contact_state(drawn)), regime)
        drawn = drawn.replace(regime=own)
        for closure, one in found.items():
            tangents = gl.loop_tangents(drawn, law, sample.faces, closure).matrix
            change = np.abs(smallest(tangents) - one.value)
            outside[closure] += np.count_nonzero(change > one.error * (1.0 + 1e-3))
            sure = one.error == one.bound
            assert sure.any() and (change <= one.bound * (1.0 + 1e-2))[sure].all()
    # The bound is of first order.
    assert outside == {"affine": 0, "traction": 0}


@pytest.mark.parametrize("digits", [4, 6])
def test_rounded_positions_stay_within_the_errors_of_their_digits(sample, digits):
    graph, (law, regime) = sample.graph, sample.mechanics()
    from studies.snapshot.input_error import half_unit

    size = 10.0 ** (np.floor(np.log10(np.abs(graph.x).max())) - digits + 1)
    rounded = graph.replace(x=np.round(graph.x / size) * size, x0=None, regime=regime)
    assert np.array_equal(half_unit(rounded.x), np.full(graph.x.shape, 0.5 * size))
    away = half_unit(rounded.x).sum(axis=1)[graph.contacts].sum(axis=1)
    state = gl.contact_state(rounded)
    errors = no_errors(graph.contact_count, overlap=away, turn=away / state.length)
    known = eigenvalue_errors(graph, law, regime, sample.faces, errors, sample.faces.loops)
    for closure, one in known.items():
        found = smallest(gl.loop_tangents(rounded, law, sample.faces, closure).matrix)
        assert (np.abs(found - one.value) <= one.error).all()


def test_contacts_within_the_errors_of_their_strength_are_at_the_edge():
    graph, _ = ring(5, LINEAR)
    N = graph.normal_force
    share = np.array([0.5, 0.47, 0.44, -0.5, 0.0])
    graph = graph.replace(shear_force=share * N)
    errors = no_errors(5, N=0.02 * N, T=0.02 * N)
    near = at_edge(gl.contact_state(graph), LINEAR, errors)
    assert near.tolist() == [True, True, False, True, False]
    assert not at_edge(gl.contact_state(graph), LINEAR, no_errors(5)).any()
