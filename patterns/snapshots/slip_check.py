"""Check of kt: changes of T between two snapshots against the slip of the grains."""

from __future__ import annotations

import numpy as np

from loops import FrictionalLaw, Regime, contact_state
from loops.arrays import Floats, Integers, median
from loops.laws.frictional import of_tables
from patterns.snapshots.checked import FEWEST
from patterns.snapshots.findings import Finding, finding
from patterns.snapshots.geometry import index_of
from patterns.snapshots.snapshot import Snapshot

# Change of T over kt times slip, between snapshots: clean 1 to 1e-7 in steps of 2e-5 of strain.
KT = 0.1
# Share of the contacts whose change of T must agree to KT for a judgement on kt.
AGREEING = 0.5
# Contacts to which unknown rotations are fitted at most.
FITTED = 50_000
# How often these are weighted anew.
REWEIGHTED = 12


def check_kt(before: Snapshot, after: Snapshot) -> Finding | None:
    """Changes of T between two snapshots against kt times the slip of the grains.

    Contacts that are elastic in both count. Rotations that the file lacks are fitted to the same
    contacts, with the factor on kt, by reweighted least squares.
    """
    law, later = before.law, after.law
    if before.regime is None or after.regime is None:
        return None
    if not (of_tables(law) and of_tables(later)):
        return None
    # Loads sparse matrices, which a snapshot alone needs nowhere else.
    from loops.tracking import match_contacts

    match = match_contacts(before.graph, before.ids, after.graph, after.ids)
    first = match.shared
    second = match.after[first]
    both = (before, law, first), (after, later, second)
    T = np.stack([one.graph.shear_force[rows] for one, _, rows in both])
    springs = []
    for one, of, rows in both:
        spring = of.stiffnesses(contact_state(one.graph))[1]
        springs.append(np.broadcast_to(spring, one.graph.contact_count)[rows])
    kt = np.stack(springs)
    elastic = (before.regime[first] != Regime.SLIDING) & (after.regime[second] != Regime.SLIDING)
    # Contacts without friction or shear stiffness keep T = 0.
    elastic &= T.any(axis=0) & (kt > 0).all(axis=0)
    first, second, T, kt = first[elastic], second[elastic], T[:, elastic], kt[:, elastic]
    if len(first) < FEWEST:
        return None
    needed = law.elastic_slip(T, kt)
    if not needed.any():
        return None
    sign = np.where(match.reversed[first], -1, 1)[:, None]
    pairs, arms, moved = _moved(before, first, sign * after.graph.branches[second])
    spare = len(first)
    if before.rotation is None or after.rotation is None:
        strip = np.argsort(before.graph.x[pairs[:, 0], 0])[:FITTED]
        pairs, arms, moved, needed = pairs[strip], arms[strip], moved[strip], needed[strip]
        spare = len(strip) - len(np.unique(pairs)) - 1
        if spare < FEWEST:
            return None
        spins = _fitted_spins(pairs, arms, moved, needed)
    else:
        spin = after.rotation[index_of(after.ids, before.ids)] - before.rotation
        spins = np.remainder(spin + np.pi, 2 * np.pi) - np.pi
    slip = moved - np.einsum("ck,ck->c", arms, spins[pairs])
    if not slip.any():
        return None
    factor = median((needed / slip)[slip != 0])
    wrong = np.count_nonzero(np.abs(needed - factor * slip) > KT * np.abs(factor * slip))
    agreeing = max(1 - wrong / spare, 0.0)
    if agreeing < AGREEING:
        return finding("kt", agreeing, "long", percent=100 * agreeing)
    case = "ok" if abs(factor - 1) <= KT else "small" if factor > 1 else "large"
    return finding("kt", factor, case, needed=factor * median(kt))


def _moved(before: Snapshot, contacts: Integers, later: Floats) -> tuple[Integers, Floats, Floats]:
    """Grains of some contacts, their arms, and the slip by the turn of the branches to `later`."""
    d = before.graph.branches[contacts]
    turn = np.arctan2(
        d[:, 0] * later[:, 1] - d[:, 1] * later[:, 0], np.einsum("ck,ck->c", d, later)
    )
    pairs = before.graph.contacts[contacts]
    arms = before.graph.radii[pairs]
    reach = arms.sum(axis=1)
    assert isinstance(before.law, FrictionalLaw)
    if before.law.shear_increment == "branch":
        length = (np.hypot(*d.T) + np.hypot(*later.T)) / 2
        arms, reach = arms * (length / reach)[:, None], length
    return pairs, arms, reach * turn


def _fitted_spins(pairs: Integers, arms: Floats, moved: Floats, needed: Floats) -> Floats:
    """Spin of each grain from `moved = arms spins + needed / factor`, outliers weighted down."""
    import scipy.sparse as sp
    from scipy.sparse.linalg import spsolve

    grains, place = np.unique(pairs, return_inverse=True)
    place = place.reshape(pairs.shape)
    rows, count = np.arange(len(pairs)), len(grains)
    size = float(arms.mean())
    last = needed / (float(np.abs(needed).mean()) or 1.0)
    values = np.concatenate([arms.T.ravel() / size, last])
    columns = np.concatenate([*place.T, np.full(len(pairs), count)])
    matrix = sp.csr_matrix((values, (np.tile(rows, 3), columns)), shape=(len(pairs), count + 1))
    weight = np.ones(len(pairs))
    for _ in range(REWEIGHTED):
        weighted = matrix.T @ sp.diags_array(weight)
        normal = (weighted @ matrix).tocsc()
        # Grains in rows may turn against one another like gears: held by a millionth of a spring.
        normal += 1e-6 * sp.diags_array(normal.diagonal())
        found = spsolve(normal, weighted @ moved)
        left = np.abs(moved - matrix @ found)
        weight = 1 / (left + 1e-6 * np.abs(moved).mean())
    spins = np.zeros(int(pairs.max()) + 1)
    spins[grains] = found[:-1] / size
    return spins
