"""Loops in small packings against 90 digits: wrong signs, errors beyond the stated one.

Periodic packings of 9 to 36 grains: dense, near the fewest contacts that carry, lattices (gear
modes), rings of gears that nearly close, jammed ones; without a force, soft, stiff (N/l to 1e-8);
contacts sliding from none to all; kt/kn from 1e-10 to 1; both shear increments. `closing_packing`
draws lattices with rings of gears alone, whose mismatch is from 1e-15 to 1e-3.
"""

from collections import Counter
from contextlib import suppress

import numpy as np

from loops import (
    GrainGraph,
    InputError,
    LinearFrictional,
    Regime,
    Scene,
    contact_state,
    find_faces,
    loop_batches,
)
from patterns import synthetic_network
from stability import restrict, symmetric_part
from studies.snapshot.in_packing import place_columns
from tests.oracles.lattices import lattice
from tests.oracles.loop_balls import ball_tangent
from tests.oracles.loops_to_ninety_digits import operators
from tests.oracles.rings import member
from tests.packings import JAMMED, frobenius, jammed, loops_in_place

FAMILIES = ("dense", "sparse", "flowing", "lattice", "jammed")
SIGNS = [f"packing_lambda_{name}" for name in ("min", "mid", "max")] + ["surroundings_lambda_min"]


def random_packing(rng, family, largest=36):
    """Graph, law and regimes of a packing of at most so many grains."""
    kt = 10.0 ** rng.choice([0.0, -0.3, -1, -2, -4, -6, -8, -10])
    increment = str(rng.choice(["radii", "branch"]))
    law = LinearFrictional(1.0, kt, float(rng.choice([0.05, 0.5])), increment)
    if family == "jammed":
        which = [(size, own) for size, own in JAMMED if size[0] <= max(largest, 12)]
        size, own = which[rng.integers(len(which))]
        graph = jammed(*size, own)
    elif family == "lattice":
        angle = rng.choice([np.pi / 2, np.pi / 3, 1.2])
        vectors = np.array([[1.0, np.cos(angle)], [0.0, np.sin(angle)]])
        branches = [[1, 0], [0, 1]] + ([[-1, 1]] if rng.random() < 0.5 else [])
        cells = tuple(rng.integers(3, 6 if largest > 20 else 4, 2).tolist())
        graph = lattice(vectors, branches, *np.zeros((2, len(branches))), cells=cells)
        x = graph.x + 10.0 ** rng.uniform(-6, -2) * rng.uniform(-1, 1, graph.x.shape)
        graph = graph.replace(x=x if rng.random() < 0.5 else graph.x)
        if increment == "branch":
            # Arms of equal grains make gears too, which the oracle of loops alone doesn't know.
            graph = graph.replace(radii=graph.radii * rng.uniform(0.99, 1.01, len(x)))
    else:
        grains = int(rng.integers(9, largest + 1))
        side = 1.1 * np.sqrt(grains)
        cell = [[side, 0.3], [-0.2, side]]
        z = {"dense": 5.0, "sparse": 3.3, "flowing": 4.2}[family] + rng.uniform(-0.4, 0.4)
        graph = synthetic_network(
            grains,
            seed=int(rng.integers(2**31)),
            cell=cell,
            coordination=z,
        )
    count = graph.contact_count
    force = rng.choice([0.0, 1e-8, 1e-6, 1e-4, 1e-2, 0.1], p=[0.1, 0.1, 0.1, 0.3, 0.3, 0.1])
    normal = force * rng.uniform(0.3, 1.7, count)
    share = rng.uniform(-0.95, 0.95, count)
    sliding = 0.0 if family == "dense" else rng.choice([0.0, 0.1, 0.3, 0.6, 1.0])
    slides = rng.random(count) < sliding
    shear = np.where(slides, np.sign(share), share) * float(law.mu) * normal
    graph = graph.replace(normal_force=normal, shear_force=shear)
    regime = np.where(slides, Regime.SLIDING, Regime.ELASTIC).astype(np.int8)
    return graph, law, regime


def closing_packing(rng, family, largest=36):
    """Graph, law and regimes of a square lattice of gears, off by so much: their mismatch is its
    square. `family` is a number, or "closing" for a random one.
    """
    sizes = [(4, 4), (4, 6), (6, 6), (3, 4)]
    nx, ny = sizes[rng.choice([k for k, size in enumerate(sizes) if np.prod(size) <= largest])]
    place = np.arange(nx * ny).reshape(nx, ny)
    x = np.column_stack(np.divmod(np.arange(nx * ny), ny)).astype(float)
    off = float(family) if family != "closing" else 10.0 ** rng.uniform(-7.5, -1.5)
    contacts = np.concatenate([
        np.column_stack([place.ravel(), np.roll(place, -1, axis=axis).ravel()]) for axis in (0, 1)
    ])  # fmt: skip
    images = np.repeat(np.eye(2, dtype=int), nx * ny, axis=0)
    images *= contacts[:, 1:] < contacts[:, :1]
    count = len(contacts)
    normal = rng.choice([1e-30, 1e-4, 1e-2], p=[0.5, 0.25, 0.25]) * rng.uniform(0.5, 1.5, count)
    slides = rng.random(count) < rng.choice([0.0, 0.15, 0.5])
    share = np.where(slides, rng.choice([-1.0, 1.0], count), rng.uniform(-0.9, 0.9, count))
    graph = GrainGraph(
        x=x + off * rng.uniform(-1, 1, x.shape), radii=0.5 + off * rng.uniform(-1, 1, len(x)),
        contacts=contacts, images=images, cell=np.diag([float(nx), float(ny)]),
        normal_force=normal, shear_force=0.3 * share * normal,
    )  # fmt: skip
    increment = str(rng.choice(["branch", "radii"], p=[0.8, 0.2]))
    law = LinearFrictional(1.0, 10.0 ** rng.choice([-0.3, -0.3, -2, -6]), 0.3, increment)
    return graph, law, np.where(slides, Regime.SLIDING, Regime.ELASTIC).astype(np.int8)


def loops_alone(graph, law, faces, regime):
    """(L, 4, 4) `A_loop` by balls; nan where a loop has none."""
    out = np.full((len(faces.loops), 4, 4), np.nan)
    row = {face: k for k, face in enumerate(faces.loops)}
    for batch in loop_batches(graph, faces):
        for k, face in enumerate(batch.face):
            one = member(batch.graph, k)
            blocks = law.local_stiffness(contact_state(one), regime[batch.contacts[k]])
            with suppress(ZeroDivisionError):
                by_radii = law.shear_increment == "radii"
                out[row[face]] = ball_tangent(one, blocks, by_radii, "traction", "free")[0]
    return out


def eigenvalues(matrix):
    """(L, 3) eigenvalues of Ks in the symmetric subspace; nan where the matrix is not finite."""
    out = np.full((len(matrix), 3), np.nan)
    known = np.isfinite(matrix).all(axis=(1, 2))
    out[known] = np.linalg.eigvalsh(symmetric_part(restrict(matrix[known], "symmetric")))
    return out


def compared(graph, law, regime):
    """Counts, the largest error over the stated one, and the stated errors, of one packing."""
    faces = find_faces(graph)
    found = loops_in_place(Scene(graph.replace(regime=regime), law), faces, method="whole")
    # Contacts of grains that are left out carry nothing.
    carries = found.system.carrying
    exact = operators(graph, law, faces, np.where(carries.contacts, regime, Regime.OPEN))
    table = place_columns(found, 1.0)
    with np.errstate(all="ignore"):
        error = frobenius(found.matrix - exact) / frobenius(found.matrix)
    known = np.isfinite(found.matrix[:, 0, 0])
    stands = np.zeros(len(faces.loops), dtype=bool)
    row = {face: k for k, face in enumerate(faces.loops)}
    for batch in loop_batches(graph, faces):
        stands[[row[face] for face in batch.face]] = carries.grains[batch.grains].all(axis=1)
    alone = loops_alone(graph, law, faces, regime)
    around = exact - alone
    true = [*eigenvalues(exact).T, eigenvalues(around)[:, 0]]
    claimed = [table[name] for name in SIGNS]
    count = Counter(
        loops=len(exact),
        standing=int(stands.sum()),
        answered=int(known.sum()),
        beyond=int(np.count_nonzero(known & ~(error <= found.error))),
    )
    # Gear modes softer than rounding of stiff grains that shear by the branch: the error of the
    # loop cut out knows nothing of them, whatever its packing does.
    with np.errstate(invalid="ignore"):
        off = frobenius(found.alone - alone) > found.alone_error
    count["cut out beyond"] = int(off.sum())
    claimed[-1] = np.where(off, np.nan, claimed[-1])
    for name, said, is_ in zip(SIGNS, claimed, true, strict=True):
        count[f"{name} claimed"] = int(np.isfinite(said).sum())
        count[f"{name} wrong"] = int(np.count_nonzero(np.isfinite(said) & ~(said * is_ > 0)))
    ratio = np.where(known, error / found.error, 0.0)
    return count, float(np.max(ratio, initial=0.0)), found.error[known]


def campaign(packings, seed, largest=36, families=FAMILIES, draw=random_packing):
    """Totals, the largest ratio by family, and quantiles of the stated error."""
    rng, total, ratios, stated = np.random.default_rng(seed), Counter(), Counter(), {}
    for k in range(packings):
        family = families[k % len(families)]
        graph, law, regime = draw(rng, family, largest)
        try:
            count, ratio, errors = compared(graph, law, regime)
        except InputError:
            total["floating"] += 1
            continue
        total.update(count)
        total[f"{family} loops"] += count["loops"]
        ratios[family] = max(ratios[family], ratio)
        if len(errors):
            stated.setdefault(family, []).append(errors)
        if count["beyond"] or any(count[f"{name} wrong"] for name in SIGNS):
            print(
                f"packing {k}: {family}, kt {law.kt:g}, {law.shear_increment}", dict(count), ratio
            )
    return (
        total,
        dict(ratios),
        {family: np.quantile(np.concatenate(e), [0.5, 0.9, 0.99]) for family, e in stated.items()},
    )
