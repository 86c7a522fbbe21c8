"""The exact sweep of drained diamonds against scipy's integrators."""

import numpy as np
import pytest

from patterns.diamond import TABLE_1
from tests.tools.settled import sweep


def test_sweep():
    diamonds = sweep.random_diamonds(2000)
    drawn = np.degrees(diamonds[:, 0])
    assert drawn.min() >= 5 and drawn.max() <= 85
    status, rows = sweep.compare_methods(diamonds, 20)
    assert sum(status.values()) == 2000 and status["yield"] > 1000
    errors = [row["error"] for row in rows]
    # DOP853 at 1e-12 agrees with the exact sweep; solve_ivp's default does not.
    assert errors[3] < 1e-9 < errors[1] < 0.1
    table = np.array([TABLE_1.alpha0, TABLE_1.kappa, TABLE_1.phi, TABLE_1.confinement])
    found = sweep.by_scipy(table, "DOP853", 1e-12, 1e-15)
    assert found == pytest.approx([0.409734348970334, 0.164934999828386, 0.254009900083053], 1e-11)
    assert np.isnan(sweep.by_scipy([1.4, 0.05, 0.6, 0.5], "RK45", 1e-6, 1e-9)).all()
