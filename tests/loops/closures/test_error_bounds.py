"""No error of a tangent exceeds its bound: random and hard loops against balls of 260 bits."""

import numpy as np
import pytest

pytest.importorskip("flint")

from tests.tools.judged_loops import judged


@pytest.mark.parametrize(("loops", "seed"), [(16, 3), pytest.param(400, 1, marks=pytest.mark.slow)])
def test_errors_of_hard_loops_stay_below_their_bounds(loops, seed):
    total, ratios, relative = judged(loops, seed)
    for way in ("numpy", "kernels"):
        assert total[f"broken, {way}"] == 0
        # Nothing is bounded by not answering.
        assert total[f"withheld, {way}"] <= 0.05 * loops
        assert np.max(ratios[way]) <= 1.0 and np.median(relative[way]) < 1e-14
