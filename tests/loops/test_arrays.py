"""Median and quantiles of any values, of none too."""

import numpy as np
import pytest

from loops.arrays import median, quantiles


def examples():
    rng = np.random.default_rng(0)
    for count in [*range(1, 30), 997, 1000]:
        values = rng.normal(size=count) * 10.0 ** rng.integers(-9, 9)
        yield values
        yield np.round(3.0 * values / np.abs(values).max())  # many alike
        yield rng.permutation(count)
        yield values.reshape(count, 1)[::-1]
    yield np.array([1.0, np.inf, -np.inf, 2.0])
    yield np.full(8, np.inf)


def test_median_and_quantiles_are_numpys():
    rng = np.random.default_rng(1)
    for values in examples():
        before = values.copy()
        with np.errstate(invalid="ignore"):
            assert median(values) == np.median(values)
            if not np.isfinite(values).all():
                continue
            shares = np.sort([0.0, 0.25, 0.5, 0.75, 0.999, 1.0, *rng.random(4)]).tolist()
            assert quantiles(values, shares) == np.quantile(values, shares).tolist()
        np.testing.assert_array_equal(values, before)


@pytest.mark.parametrize("values", [[], [1.0, np.nan, 2.0], [np.nan] * 3])
def test_without_numbers_there_is_none(values):
    assert np.isnan(median(values)) and np.isnan(quantiles(values, [0.1, 0.5])).all()
