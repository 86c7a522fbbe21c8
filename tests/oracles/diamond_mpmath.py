"""The drained biaxial path in many digits, by a quadrature.

`l(a) tan a sin^kappa a = l_A tan a_A sin^kappa a_A + Int sin^kappa b (sec^2 b - f sec b tan b) db`
with `f = F2/(2 kn l0)`, then `T = (N sin a - f)/cos a`, `N = 1 - l`. Nothing of the package.
"""

from mpmath import mp, mpf


def elastic_state(alpha, alpha0, kappa, confinement):
    """E1, E2, s1, N, T after the branch has turned from `alpha0` to `alpha`."""
    alpha, a0, k, E = mpf(alpha), mpf(alpha0), mpf(kappa), mpf(confinement)
    f = E * mp.sin(a0)

    def weight(b):  # sin^kappa over its value at the end: the quadrature's tolerance is absolute
        return (mp.sin(b) / mp.sin(alpha)) ** k

    def integrand(b):
        return weight(b) * (mp.sec(b) ** 2 - f * mp.sec(b) * mp.tan(b))

    start = (1 - E) * mp.tan(a0) * weight(a0)
    length = (start + mp.quad(integrand, [a0, alpha])) / mp.tan(alpha)
    N = 1 - length
    return _measures(alpha, a0, N, (N * mp.sin(alpha) - f) / mp.cos(alpha))


def yield_state(alpha0, kappa, phi, confinement, guess, s=1):
    """alpha, E1, E2, s1, N, T where `T = s mu N`, found from a guess of alpha."""
    mu = mp.tan(mpf(phi))

    def excess(alpha):
        *_, N, T = elastic_state(alpha, alpha0, kappa, confinement)
        return T - s * mu * N

    step = max(abs(mpf(guess) - mpf(alpha0)), mpf(10) ** -20) * mpf(10) ** -9
    alpha = mp.findroot(excess, (mpf(guess) - step, mpf(guess) + step), tol=mp.eps**1.5)
    return alpha, *elastic_state(alpha, alpha0, kappa, confinement)


def _measures(alpha, a0, N, T):
    E1 = 1 - (1 - N) * mp.cos(alpha) / mp.cos(a0)
    E2 = 1 - (1 - N) * mp.sin(alpha) / mp.sin(a0)
    s1 = (N * mp.cos(alpha) + T * mp.sin(alpha)) / mp.sin(a0)
    return E1, E2, s1, N, T
