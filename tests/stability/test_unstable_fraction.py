import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from loops import InputError
from stability import unstable_fraction
from tests.oracles import stability_fraction as oracle

SIZES = st.integers(1, 5)
ROUNDED = st.floats(-1.0, 1.0).map(lambda value: round(value, 6))
FORMS = SIZES.flatmap(lambda m: arrays(np.float64, m, elements=ROUNDED))


def spread(seed, signs, decades):
    sizes = 10.0 ** np.random.default_rng(seed).uniform(-decades, decades, len(signs))
    return sizes * np.array(signs)


def relative_error(value, expected):
    return abs(float((value - expected) / expected))


@pytest.mark.parametrize("decades", [1, 5, 20])
@pytest.mark.parametrize("seed", range(3))
def test_plane(seed, decades):
    values = spread(seed, [1, -1], decades)
    assert relative_error(unstable_fraction(values), oracle.plane_fraction(values)) < 1e-15


@pytest.mark.parametrize("signs", [[1, 1, -1], [1, -1, -1]])
@pytest.mark.parametrize("decades", [1, 6])
@pytest.mark.parametrize("seed", range(2))
def test_space(seed, decades, signs):
    values = spread(seed, signs, decades)
    assert relative_error(unstable_fraction(values), oracle.space_fraction(values)) < 3e-15


@pytest.mark.parametrize(
    "values",
    [
        [1.0, 1.0, -1e-8],
        [1.0, 1e-8, -1e-8],
        [1.0, 1e-15, -1e-15],
        [-1e-15, -1.000000000001e-15, 1.0],
        [1.0, 1.0 + 1e-15, -0.3],
        [1.0, -1e-12, -0.5],
        [1.0, 1e-12, -0.5],
        [1e-8, 1e-8, -1.0],
        [1e-10, 1e10, -1.0],
    ],
)
def test_space_near_degenerate(values):
    """Relative accuracy holds for fractions down to 5e-16 and for nearly equal eigenvalues."""
    assert relative_error(unstable_fraction(values), oracle.space_fraction(values)) < 3e-15


@pytest.mark.parametrize("signs", [[1, 1, 1, -1], [1, 1, -1, -1], [1, -1, -1, -1]])
@pytest.mark.parametrize("decades", [1, 4])
def test_four_eigenvalues(decades, signs):
    values = spread(1, signs, decades)
    expected = oracle.imhof_fraction(values)
    assert abs(float(unstable_fraction(values) - expected)) < 1e-15
    if signs.count(-1) == 1:
        assert relative_error(unstable_fraction(values), expected) < 3e-15


@pytest.mark.parametrize("ratio", [1e-8, 0.5, 1e30])
@pytest.mark.parametrize(
    ("positive", "negative"), [(1, 1), (2, 1), (1, 2), (3, 1), (2, 2), (1, 3), (4, 1), (3, 2)]
)
def test_two_distinct_eigenvalues(ratio, positive, negative):
    """A ratio of chi-squared variables: the incomplete beta function."""
    values = [1.0] * positive + [-ratio] * negative
    expected = oracle.two_valued_fraction(ratio, positive, negative)
    assert abs(float(unstable_fraction(values) - expected)) < 1e-15
    if negative == 1:
        assert relative_error(unstable_fraction(values), expected) < 1e-14


def test_ten_coinciding_eigenvalues():
    expected = oracle.two_valued_fraction(0.5, 6, 4)
    assert abs(float(unstable_fraction([1.0] * 6 + [-0.5] * 4) - expected)) < 1e-14


@pytest.mark.parametrize(
    "values", [[1.0, 0.3, -0.4], [1.0, 0.3, -0.4, -0.1], [0.2, -1.0, -0.3, -0.1, 0.05]]
)
def test_draws(values):
    draws = np.random.default_rng(1).standard_normal((400_000, len(values)))
    drawn = (draws**2 @ values < 0.0).mean()
    sigma = np.sqrt(drawn * (1.0 - drawn) / len(draws))
    assert abs(drawn - unstable_fraction(values)) < 4.0 * sigma


@given(FORMS)
def test_opposite_forms_share_the_sphere(values):
    total = unstable_fraction(values) + unstable_fraction(-values)
    np.testing.assert_allclose(total, float(values.any()), atol=2e-15)


@given(FORMS, st.randoms(use_true_random=False), st.sampled_from([1e-200, 3e-7, 11.0, 1e200]))
def test_order_and_unit_do_not_matter(values, random, unit):
    shuffled = list(values)
    random.shuffle(shuffled)
    np.testing.assert_allclose(
        unstable_fraction(unit * np.array(shuffled)), unstable_fraction(values), atol=2e-15
    )


@given(FORMS, st.integers(0, 4), st.floats(0.0, 1.0))
def test_falls_as_an_eigenvalue_grows(values, place, step):
    grown = values.copy()
    grown[place % len(values)] += step
    if values.any() and grown.any():  # a vanishing form counts as 0 by convention
        assert unstable_fraction(grown) <= unstable_fraction(values) + 2e-15


@pytest.mark.parametrize("zeros", [1, 2, 3])
@pytest.mark.parametrize("plane", [[1.0, -0.2], [1e-6, -1.0], [3.0, 1.0], [-1.0, -1.0]])
def test_zero_eigenvalues_drop_out(plane, zeros):
    values = [*plane, *[0.0] * zeros]
    np.testing.assert_allclose(unstable_fraction(values), unstable_fraction(plane), atol=2e-15)


def test_zero_eigenvalues_cost_no_digits():
    expected = oracle.plane_fraction([1.0, -1e-20])
    for zeros in ([0.0], [0.0, 0.0]):
        assert relative_error(unstable_fraction([1.0, *zeros, -1e-20]), expected) < 1e-14


@pytest.mark.parametrize("small", [1e-6, 1e-10, 1e-300, -1e-6, -1e-10, -1e-300])
def test_a_vanishing_third_eigenvalue_leaves_the_plane(small):
    plane, space = unstable_fraction([1.0, -0.5]), unstable_fraction([1.0, -0.5, small])
    assert abs(plane - space) <= 2e-16 - abs(small) * np.log(abs(small))
    if abs(small) > 1e-12:
        assert np.sign(plane - space) == np.sign(small)


@pytest.mark.parametrize(
    ("values", "fraction"),
    [
        ([2.0], 0.0),
        ([-2.0], 1.0),
        ([0.0], 0.0),
        ([1.0, 0.0], 0.0),
        ([-1.0, 0.0, 0.0], 1.0),
        ([0.0, 0.0, 0.0], 0.0),
        ([1.0, -1.0], 0.5),
        ([1e-320, 1e-320, -1e300], 1.0),
        ([1e300, 1e300, 1.0, -1e-320], 0.0),
    ],
)
def test_plain_values(values, fraction):
    np.testing.assert_allclose(unstable_fraction(values), fraction, atol=1e-15)


@pytest.mark.parametrize("size", [1, 2, 3, 4])
def test_batches_and_eigenvalues_that_are_not_finite(size):
    values = np.random.default_rng(size).standard_normal((3, 700, size))
    values[1, 5, 0], values[2, 6, -1] = np.nan, np.inf
    fraction = unstable_fraction(values)
    assert fraction.shape == (3, 700)
    assert np.argwhere(np.isnan(fraction)).tolist() == [[1, 5], [2, 6]]
    assert unstable_fraction(values[2, 699]) == pytest.approx(fraction[2, 699], abs=1e-15)


def test_an_empty_batch():
    assert unstable_fraction(np.empty((0, 3))).shape == (0,)


@pytest.mark.parametrize("values", [1.0, np.empty((4, 0))])
def test_no_eigenvalues(values):
    with pytest.raises(InputError, match="eigenvalues: got shape"):
        unstable_fraction(values)
