"""The benchmark of indicators: means over packings, their intervals, shuffled targets."""

import numpy as np
import pandas as pd
import pytest
from scipy import integrate

from loops import InputError
from studies.examples import indicators


def student_density(x, nu):
    """Student's density without its constant."""
    return (1 + x * x / nu) ** (-(nu + 1) / 2)


def test_an_interval_covers_95_percent():
    """Half its width over the standard error, put through the integral of Student's density."""
    for count in (2, 5, 8):
        values = np.random.default_rng(count).normal(size=count)
        mean, low, high = indicators.interval([*values, np.nan])
        assert mean == pytest.approx(values.mean(), rel=1e-14)
        assert high - mean == pytest.approx(mean - low, rel=1e-12)
        error = np.sqrt(np.sum((values - mean) ** 2) / (count - 1) / count)
        nu, bound = count - 1, (high - mean) / error
        inside = integrate.quad(student_density, -bound, bound, (nu,))[0]
        whole = integrate.quad(student_density, -np.inf, np.inf, (nu,))[0]
        assert inside / whole == pytest.approx(0.95, abs=1e-9)
    assert indicators.interval([3.0])[0] == 3.0
    assert np.isnan(indicators.interval([3.0])[1:]).all()


def rows(packings=20, intervals=4):
    """A made-up benchmark: the rate problem lies .3 above an indicator in each packing alike."""
    rng, found = np.random.default_rng(1), []
    for k, level in enumerate(rng.normal(0.6, 0.05, packings)):
        for after in range(intervals):
            for name, auc in (("packing", level + 0.3), ("order", level), ("density", 0.5)):
                found.append(
                    {"packing": str(k), "step": 1e-4, "snapshot_after": after, "base": 0.2,
                     "target": "W2_negative", "predictor": name, "auc": auc,
                     "coverage": 1.0, "shuffled": 0.48 + 0.04 * (k % 2)}
                )  # fmt: skip
    return pd.DataFrame(found)


def test_packings_count_once_each():
    """More intervals of one packing do not narrow the interval between packings."""
    one, four = (indicators.compare(rows(intervals=n)).set_index("predictor") for n in (1, 4))
    for name in ("auc", "low", "high", "above", "above_low", "above_high", "base"):
        np.testing.assert_allclose(one[name], four[name], rtol=1e-12)
    assert (one.packings == 20).all() and (four.intervals == 80).all()
    # What packings have in common cancels in the distance to the rate problem.
    assert one.above_low["order"] == pytest.approx(0.3) == one.above_high["order"]
    assert one.high["order"] - one.low["order"] > 0.02
    assert (four.shuffled_low < 0.5).all() and (four.shuffled_high > 0.5).all()
    (best,) = indicators.winners(four.reset_index())
    assert best["best"] == "order" and best["packing"] - best["auc"] == pytest.approx(0.3)
    assert len(indicators.draw(four.reset_index()).axes) == 4


def test_a_folder_without_predictions_is_named(tmp_path):
    with pytest.raises(InputError, match=r"got no series with its packing, expected a result fold"):
        indicators.scores(tmp_path)
