"""Forces on grains after a finite straight motion: Hertz-Mindlin and a rolling spring, integrated.

The sibling of `finite_motion`, written from E, nu and the overlap alone. The normal force is the
difference of Hertz's closed form, so a state may carry any normal force. A sliding contact keeps
|T| in step with N from the value that it starts with.
"""

import numpy as np

from loops import Regime

NODES, WEIGHTS = np.polynomial.legendre.leggauss(24)


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


def external_forces(graph, young, poisson, mu, k_r, regime, v, w, step, rule="branch"):
    """External forces (2 G) and moments (G) that hold the grains after the motion `step * v`."""
    grains = graph.grain_count
    out = np.zeros(3 * grains)
    for c, (i, j) in enumerate(graph.contacts.tolist()):
        d, dv = graph.x[j] - graph.x[i], v[j] - v[i]
        r_i, r_j = graph.radii[i], graph.radii[j]
        end = d + step * dv
        length = np.hypot(*end)
        change = hertz_force(young, poisson, r_i, r_j, length) - hertz_force(
            young, poisson, r_i, r_j, np.hypot(*d)
        )
        normal, shear = graph.normal_force[c] + change, graph.shear_force[c]
        if regime[c] == Regime.SLIDING:
            shear = shear + np.sign(shear) * mu * change
        else:
            path = d + (0.5 * step * (NODES + 1))[:, None] * dv
            along = np.hypot(path[:, 0], path[:, 1])
            swept = (path[:, 0] * dv[1] - path[:, 1] * dv[0]) / along
            if rule == "branch":
                roll = 0.5 * (along + r_i - r_j) * w[i] + 0.5 * (along + r_j - r_i) * w[j]
            else:
                swept = swept * (r_i + r_j) / along
                roll = r_i * w[i] + r_j * w[j]
            kt = mindlin_stiffness(young, poisson, r_i, r_j, along)
            shear = shear - 0.5 * step * (WEIGHTS @ (kt * (swept - roll)))
        n = end / length
        f = normal * n + shear * np.array([-n[1], n[0]])
        moment = -k_r * step * (w[j] - w[i])
        out[2 * i : 2 * i + 2] += f
        out[2 * j : 2 * j + 2] -= f
        out[2 * grains + i] += 0.5 * (length + r_i - r_j) * shear + moment
        out[2 * grains + j] += 0.5 * (length + r_j - r_i) * shear - moment
    return out
