"""Principal minors of a matrix, all of them: the definition of a P-matrix."""

import numpy as np


def principal_minors(M):
    """Return all `2^m - 1` principal minors of `M` (m, m), by determinants: for small `m`."""
    m = len(M)
    sets = (np.arange(1, 2**m)[:, None] >> np.arange(m) & 1).astype(bool)
    both = sets[:, :, None] & sets[:, None, :]
    return np.asarray(np.linalg.det(np.where(both, M, np.eye(m))))
