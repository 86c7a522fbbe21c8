"""Frictionless samples at rest, made here: discs in a periodic cell, in a box, or in a strip."""

from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy.optimize import minimize

KN = 1.0


@dataclass(frozen=True, eq=False)
class Resting:
    """Discs at rest, springs of stiffness `KN` between them and at the walls.

    `periodic` of x and y, `size` is the side of the square; `pairs` (C, 2), `branch` (C, 2) from
    the first centre to the second, `force` (C,); walls have `grain` (W,), `foot` (W, 2) from the
    foot to the centre, `push` (W, 2) on the grain.
    """

    periodic: tuple[bool, bool]
    size: float
    x: np.ndarray
    radii: np.ndarray
    pairs: np.ndarray
    branch: np.ndarray
    force: np.ndarray
    grain: np.ndarray
    foot: np.ndarray
    push: np.ndarray

    def __post_init__(self):
        # Shared by all tests.
        for values in vars(self).values():
            if isinstance(values, np.ndarray):
                values.flags.writeable = False

    @property
    def cell(self):
        """The square, (2, 2)."""
        return np.diag([self.size, self.size])

    @property
    def normal(self):
        """Unit vectors along the branches."""
        return self.branch / np.linalg.norm(self.branch, axis=1)[:, None]

    @property
    def stress(self):
        """Mean stress of the square, compression positive: `sum f (x) l / A`, walls included."""
        vectors = self.force[:, None] * self.normal
        total = np.einsum("ci,cj->ij", vectors, self.branch)
        return (total + np.einsum("wi,wj->ij", self.push, self.foot)) / self.size**2

    def grains(self):
        """The table of grains."""
        x, y = self.x.T
        return {"id": np.arange(len(x)), "x": x, "y": y, "radius": self.radii}

    def contacts(self, *, normals=False):
        """The table of contacts."""
        one, two = self.pairs.T
        table = {"id1": one, "id2": two}
        if normals:
            table |= {"nx": self.normal[:, 0], "ny": self.normal[:, 1]}
        return table | {"fn": self.force, "ft": np.zeros(len(one))}

    def walls(self):
        """The table of contacts with walls."""
        columns = zip(
            ("fx", "fy", "branch_x", "branch_y"), (*self.push.T, *self.foot.T), strict=True
        )
        return {"id": self.grain.copy(), **dict(columns)}


@cache
def resting(periodic=(True, True), count=60, seed=1, density=0.89):
    """A sample of two sizes that fill the share `density` of their square, all at rest."""
    rng = np.random.default_rng(seed)
    radii = rng.permutation(
        np.where(np.arange(count) % 2, 1.45, 1.05) * rng.uniform(0.96, 1.04, count)
    )
    size = float(np.sqrt(np.pi * np.sum(radii**2) / density))
    one, two = np.triu_indices(count, 1)
    reach, across = radii[one] + radii[two], np.array(periodic)

    def pushes(flat):
        x = flat.reshape(-1, 2)
        d = x[two] - x[one]
        d -= np.where(across, size * np.rint(d / size), 0.0)
        length = np.linalg.norm(d, axis=1)
        # Overlaps with the four walls: left, lower, right, upper.
        near = radii[:, None] - np.hstack([x, size - x])
        walls = np.where(np.tile(~across, 2), np.maximum(near, 0.0), 0.0)
        return d, length, np.maximum(reach - length, 0.0), walls

    def energy(flat):
        d, length, overlap, walls = pushes(flat)
        force = KN * (overlap / length)[:, None] * d
        slope = np.stack(
            [np.bincount(one, f, count) - np.bincount(two, f, count) for f in force.T], axis=1
        )
        slope += KN * (walls[:, 2:] - walls[:, :2])
        return 0.5 * KN * (np.sum(overlap**2) + np.sum(walls**2)), slope.ravel()

    flat = rng.uniform(0, size, 2 * count)
    options = {"maxiter": 5000, "ftol": 0, "gtol": 1e-5}
    flat = minimize(energy, flat, jac=True, method="L-BFGS-B", options=options).x
    for _ in range(6):
        K = _stiffness(flat, pushes, one, two, count)
        flat = flat - np.linalg.lstsq(K, energy(flat)[1], rcond=1e-10)[0]
    x = flat.reshape(-1, 2)
    x = np.where(across, x % size, x)
    d, _, overlap, walls = pushes(x.ravel())
    rows = np.flatnonzero(overlap > 1e-12)
    grain, side = np.nonzero(walls > 1e-12)
    inwards = np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]])[side]
    foot = (radii[grain] - walls[grain, side])[:, None] * inwards
    return Resting(
        *(
            periodic,
            size,
            x,
            radii,
            np.stack([one, two], axis=1)[rows],
            d[rows],
            KN * overlap[rows],
        ),
        *(grain, foot, KN * walls[grain, side][:, None] * inwards),
    )


def _stiffness(flat, pushes, one, two, count):
    """Second derivative of the energy."""
    d, length, overlap, walls = pushes(flat)
    K = np.zeros((count, 2, count, 2))
    for c in np.flatnonzero(overlap > 0):
        n = d[c] / length[c]
        block = KN * (np.outer(n, n) - overlap[c] / length[c] * (np.eye(2) - np.outer(n, n)))
        i, j = one[c], two[c]
        K[i, :, i] += block
        K[j, :, j] += block
        K[i, :, j] -= block
        K[j, :, i] -= block
    for g, side in np.argwhere(walls > 0):
        K[g, side % 2, g, side % 2] += KN
    return K.reshape(2 * count, 2 * count)
