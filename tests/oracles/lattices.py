"""Bravais lattices of equal discs under a strain rate, by hand: only the common spin is unknown.

Every grain is a centre of symmetry, so centres move affinely. With `d' = -H' d` a set of contacts
along `d` has `un' = n.d'`, `ut' = t.d' - l w`; moments balance when the sum of `l T' + l' T` over
the sets vanishes.
"""

from itertools import product

import numpy as np

from loops import GrainGraph


def lattice(vectors, branches, normal, shear, cells=(2, 2)):
    """Discs at `vectors @ (i, j)`, contacts along the whole-number `branches`, one force a set."""
    vectors, (m, n) = np.asarray(vectors, dtype=float), cells
    at = np.array(list(product(range(m), range(n))))
    contacts, images = [], []
    for step in branches:
        to = at + step
        contacts.append(np.column_stack([np.arange(m * n), (to[:, 0] % m) * n + to[:, 1] % n]))
        images.append(np.column_stack([to[:, 0] // m, to[:, 1] // n]))
    length = np.linalg.norm(vectors @ branches[0])
    return GrainGraph(
        x=at @ vectors.T,
        radii=np.full(m * n, 0.5 * length * 1.001),
        contacts=np.concatenate(contacts),
        images=np.concatenate(images),
        cell=vectors * [m, n],
        normal_force=np.repeat(normal, m * n),
        shear_force=np.repeat(shear, m * n),
    )


def lattice_rates(vectors, branches, normal, shear, law, H, at_yield):
    """Nominal stress rate and sliding sets; `at_yield` sets slide or stick, whichever agrees."""
    d = np.array([np.asarray(vectors, dtype=float) @ step for step in branches])
    length = np.linalg.norm(d, axis=1)
    n = d / length[:, None]
    t = np.column_stack([-n[:, 1], n[:, 0]])
    rate = -d @ np.asarray(H).T
    un, turn = np.sum(n * rate, axis=1), np.sum(t * rate, axis=1) / length
    N, T, side = np.asarray(normal), np.asarray(shear), np.sign(shear)
    more = -law.kn * un
    found = []
    for slides in product(*[(False, True) if free else (False,) for free in at_yield]):
        slides = np.array(slides)
        slid = side * law.mu * more
        # sum of l T' + l' T = 0 with T' = kt l (w - turn) where it sticks.
        known = np.where(slides, slid, -law.kt * length * turn)
        stiffness = np.sum(np.where(slides, 0.0, law.kt * length**2))
        if stiffness == 0.0:
            continue
        w = -np.sum(length * known + un * T) / stiffness
        slip = length * (turn - w)
        stuck = -law.kt * slip
        fits = np.where(slides, -side * (slip + slid / law.kt) >= 0, True)
        fits &= np.where(np.array(at_yield) & ~slides, side * stuck <= law.mu * more, True)
        if fits.all():
            dT = np.where(slides, slid, stuck)
            f = (more - T * turn)[:, None] * n + (dT + N * turn)[:, None] * t
            area = abs(np.linalg.det(vectors))
            found.append((f.T @ d / area, slides))
    return found
