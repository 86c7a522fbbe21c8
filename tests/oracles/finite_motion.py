"""Forces on grains after a finite straight motion: the contact law integrated exactly.

Along straight motions of the centres with constant spins the branch is d(s) = d + s v. The normal
force follows from the length, the shear force from the integral of the tangential rate, taken by a
24-point Gauss rule whose error is far below rounding for the steps used here.
"""

import numpy as np

from loops import Regime, contact_forces

NODES, WEIGHTS = np.polynomial.legendre.leggauss(24)


def external_forces(graph, kn, kt, mu, regime, v, w, step, rule="branch"):
    """External forces (2 G) and moments (G) that hold the grains after the motion `step * v`."""
    return _held(
        graph, lambda c, start, end: kn * (start - end), lambda c, length: kt,
        mu, 0.0, regime, v, w, step, rule,
    )  # fmt: skip


def forces_of_spheres(graph, young, poisson, mu, k_r, regime, v, w, step, rule="branch"):
    """The same by Hertz and Mindlin with a rolling spring, from E, nu and the overlap alone."""
    r = graph.radii[graph.contacts]

    def change(c, start, end):
        return hertz_force(young, poisson, *r[c], end) - hertz_force(young, poisson, *r[c], start)

    def stiffness(c, length):
        return mindlin_stiffness(young, poisson, *r[c], length)

    return _held(graph, change, stiffness, mu, k_r, regime, v, w, step, rule)


def hertz_force(young, poisson, r_i, r_j, length):
    """`(4/3) E* sqrt(R*) delta^(3/2)`."""
    e_star = 1 / (2 * (1 - poisson**2) / young)
    r_star = 1 / (1 / r_i + 1 / r_j)
    return 4 / 3 * e_star * np.sqrt(r_star) * (r_i + r_j - length) ** 1.5


def mindlin_stiffness(young, poisson, r_i, r_j, length):
    """`8 G* a` with the contact radius `a`; `1/G* = 2 (2 - nu)/G` for two equal grains."""
    g = young / (2 * (1 + poisson))
    g_star = 1 / (2 * (2 - poisson) / g)
    return 8 * g_star * np.sqrt((r_i + r_j - length) * r_i * r_j / (r_i + r_j))


def _held(graph, change, stiffness, mu, k_r, regime, v, w, step, rule):
    """A sliding contact keeps |T| in step with N from the value that it starts with."""
    grains = graph.grain_count
    out = np.zeros(3 * grains)
    for c, (i, j) in enumerate(graph.contacts.tolist()):
        d, dv = graph.x[j] - graph.x[i], v[j] - v[i]
        r_i, r_j = graph.radii[i], graph.radii[j]
        end = d + step * dv
        length = np.hypot(*end)
        more, shear = change(c, np.hypot(*d), length), graph.shear_force[c]
        if regime[c] == Regime.SLIDING:
            shear = shear + np.sign(shear) * mu * more
        else:
            path = d + (0.5 * step * (NODES + 1))[:, None] * dv
            along = np.hypot(path[:, 0], path[:, 1])
            swept = (path[:, 0] * dv[1] - path[:, 1] * dv[0]) / along
            if rule == "branch":
                roll = 0.5 * (along + r_i - r_j) * w[i] + 0.5 * (along + r_j - r_i) * w[j]
            else:
                swept = swept * (r_i + r_j) / along
                roll = r_i * w[i] + r_j * w[j]
            shear = shear - 0.5 * step * (WEIGHTS @ (stiffness(c, along) * (swept - roll)))
        n = end / length
        f = (graph.normal_force[c] + more) * n + shear * np.array([-n[1], n[0]])
        moment = -k_r * step * (w[j] - w[i])
        out[2 * i : 2 * i + 2] += f
        out[2 * j : 2 * j + 2] -= f
        out[2 * grains + i] += 0.5 * (length + r_i - r_j) * shear + moment
        out[2 * grains + j] += 0.5 * (length + r_j - r_i) * shear - moment
    return out


def assert_slope(forces, rate, steps, atol):
    """`rate` is the slope of `forces(step)` at zero: first order one-sided, second centred."""
    one_sided = [np.linalg.norm((forces(s) - forces(0.0)) / s - rate) for s in steps]
    centred = [np.linalg.norm((forces(s) - forces(-s)) / (2 * s) - rate) for s in steps]
    np.testing.assert_allclose(np.diff(np.log2(one_sided)), -1.0, atol=atol)
    np.testing.assert_allclose(np.diff(np.log2(centred)), -2.0, atol=atol)


def assert_turns_forces(graph, tangent):
    """A rigid turn of a loop by a tangent with spins: the forces turn with it, no moment."""
    grains, f = graph.grain_count, contact_forces(graph)
    turn = np.append(np.column_stack([-graph.x[:, 1], graph.x[:, 0]]).ravel(), np.ones(grains))
    force = np.zeros((grains, 2))
    np.add.at(force, graph.contacts[:, 0], f)
    np.add.at(force, graph.contacts[:, 1], -f)
    turned = np.column_stack([-force[:, 1], force[:, 0]])
    wanted = np.append(turned.ravel(), np.zeros(grains))
    np.testing.assert_allclose(tangent @ turn, wanted, atol=1e-14)
