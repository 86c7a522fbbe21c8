"""Forces on grains after a finite straight motion: the contact law integrated exactly.

Along straight motions of the centres with constant spins the branch is d(s) = d + s v. The normal
force follows from the length, the shear force from the integral of the tangential rate, taken by a
24-point Gauss rule whose error is far below rounding for the steps used here.
"""

import numpy as np

from loops import Regime, contact_forces

NODES, WEIGHTS = np.polynomial.legendre.leggauss(24)


def external_forces(graph, kn, kt, mu, regime, v, w, step, shear_increment="branch"):
    """External forces (2 G) and moments (G) that hold the grains after the motion `step * v`."""
    grains = graph.grain_count
    out = np.zeros(3 * grains)
    for c, (i, j) in enumerate(graph.contacts.tolist()):
        d = graph.x[j] - graph.x[i]
        dv = v[j] - v[i]
        r_i, r_j = graph.radii[i], graph.radii[j]
        end = d + step * dv
        length = np.hypot(*end)
        normal = graph.normal_force[c] + kn * (np.hypot(*d) - length)
        if regime[c] == Regime.SLIDING:
            shear = np.sign(graph.shear_force[c]) * mu * normal
        else:
            s = 0.5 * step * (NODES + 1)
            path = d + s[:, None] * dv
            length_at = np.hypot(path[:, 0], path[:, 1])
            swept = (path[:, 0] * dv[1] - path[:, 1] * dv[0]) / length_at
            if shear_increment == "branch":
                roll = 0.5 * (length_at + r_i - r_j) * w[i]
                roll = roll + 0.5 * (length_at + r_j - r_i) * w[j]
            else:
                swept = swept * (r_i + r_j) / length_at
                roll = r_i * w[i] + r_j * w[j]
            shear = graph.shear_force[c] - kt * 0.5 * step * (WEIGHTS @ (swept - roll))
        n = end / length
        f = normal * n + shear * np.array([-n[1], n[0]])
        out[2 * i : 2 * i + 2] += f
        out[2 * j : 2 * j + 2] -= f
        out[2 * grains + i] += 0.5 * (length + r_i - r_j) * shear
        out[2 * grains + j] += 0.5 * (length + r_j - r_i) * shear
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
