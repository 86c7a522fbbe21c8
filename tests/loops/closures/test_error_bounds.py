"""No error of a tangent exceeds its bound: random and hard loops against balls of 260 bits."""

import numpy as np
import pytest

pytest.importorskip("flint")

from tests.tools.judged_loops import KINDS, judged


@pytest.mark.parametrize(("loops", "seed"), [(16, 3), pytest.param(400, 1, marks=pytest.mark.slow)])
def test_errors_of_hard_loops_stay_below_their_bounds(loops, seed):
    total, ratios, relative = judged(loops, seed)
    for way in ("numpy", "kernels"):
        assert total[f"broken, {way}"] == total[f"wrong, {way}"] == 0
        # Nothing is bounded by not answering.
        assert total[f"withheld, {way}"] <= 0.05 * loops
        assert np.max(ratios[way]) <= 1.0 and np.median(relative[way]) < 1e-14


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_errors_of_one_kind_of_loops_stay_below_their_bounds(kind):
    """Soft gear modes of small overlaps among them: load and stiffness of such a mode are below
    rounding, their ratio is not."""
    total, ratios, _ = judged(40, 7, (kind,))
    for way in ("numpy", "kernels"):
        assert total[f"broken, {way}"] == total[f"wrong, {way}"] == 0
        # A bound that says something.
        assert np.median(ratios[way]) > 1e-5
