"""Rates of merging and splitting: by hand, and from Gillespie runs of known rates."""

import numpy as np
import pytest
from scipy.stats import binom

from loops import GrainGraph, InputError, OrderKinetics, find_faces, order_kinetics
from loops.kinetics import (
    FATES,
    OrderEvents,
    order_events,
    order_neighbours,
    over_packings,
    poisson_limits,
)
from patterns import synthetic_network
from tests.loops.test_tracking import CORNERS, SQUARE, follow, network, with_contacts

# Orders up to 7: every pair that merges into one of them.
PAIRS = [(m, n) for m in range(3, 7) for n in range(m, 7) if m + n - 2 <= 7]
MERGE = {pair: 0.3 + 0.2 * k for k, pair in enumerate(PAIRS)}
# A distribution per grain, sum (n - 2) x_n = 2, that closing rates are balanced with.
WANTED = np.array([0, 0, 0, 0.5, 0.3, 0.12, 0.07, 0.05]) * 2.0 / 1.99


def balanced(x=WANTED):
    """Closing rates with which every pair merges as often as it comes about at x."""
    twins = {pair: 0.5 if pair[0] == pair[1] else 1.0 for pair in PAIRS}
    return {(m, n): twins[m, n] * MERGE[m, n] * x[m] * x[n] / x[m + n - 2] for m, n in PAIRS}


def gillespie(split, until, seed, grains=300, interval=0.05):
    """Events of a run from its steady state, by intervals: every event counts."""
    rng = np.random.default_rng(seed)
    N = np.rint(WANTED * grains).astype(int)
    pairs = np.array(PAIRS)
    m, n = pairs.T
    p, q = (np.array([rates[pair] for pair in PAIRS]) for rates in (MERGE, split))
    size, out, time, end = 0.5 * np.sum((np.arange(8) - 2) * N), [], 0.0, interval
    before, counts = N.copy(), np.zeros((2, len(PAIRS)), int)
    while True:
        merge = p * np.where(m == n, N[m] * (N[m] - 1) / 2, N[m] * N[n]) / size
        rates = np.concatenate([merge, q * N[m + n - 2]])
        time += rng.exponential(1.0 / rates.sum())
        while time > end:
            some = counts.sum(axis=0) > 0
            out.append(OrderEvents(before, N.copy(), pairs[some], *counts[:, some], 0, 0, 0, 0))
            before, counts, end = N.copy(), np.zeros_like(counts), end + interval
            if end > until:
                return out
        kind, k = divmod(int(np.searchsorted(rates.cumsum(), rng.random() * rates.sum())), len(p))
        counts[kind, k] += 1
        np.add.at(N, [m[k], n[k]], 2 * kind - 1)
        N[m[k] + n[k] - 2] += 1 - 2 * kind


# --- what is counted --------------------------------------------------------------------------


def test_a_diagonal_that_closes_and_opens_is_one_event_of_two_triangles():
    square, crossed = network(CORNERS, SQUARE), network(CORNERS, [*SQUARE, [0, 2]])
    closing, opening = order_events(follow(square, crossed)), order_events(follow(crossed, square))
    assert closing.pairs.tolist() == opening.pairs.tolist() == [[3, 3]]
    assert (closing.opened.tolist(), closing.closed.tolist()) == ([0], [1])
    assert (opening.opened.tolist(), opening.closed.tolist()) == ([1], [0])
    assert (closing.kept, closing.once, closing.several) == (0, 1, 0)
    assert (opening.kept, opening.once, opening.several) == (0, 2, 0)


def test_contacts_that_open_far_apart_are_each_counted_and_two_of_one_loop_are_not():
    graph = synthetic_network(400, seed=3, coordination=4.6)
    rng = np.random.default_rng(1)
    keep = np.ones(graph.contact_count, bool)
    keep[rng.choice(graph.contact_count, 12, replace=False)] = False
    events = order_events(follow(graph, with_contacts(graph, keep)))
    assert events.opened.sum() <= 12 and events.closed.sum() == 0
    assert sum(getattr(events, name) for name in FATES) == events.before.sum()
    # The same backwards; a merger leaves one loop less.
    back = order_events(follow(with_contacts(graph, keep), graph))
    assert back.pairs.tolist() == events.pairs.tolist()
    assert back.closed.tolist() == events.opened.tolist()
    two = network([*CORNERS, [0.5, 0.5]], [*SQUARE, *([k, 4] for k in range(4))])
    events = order_events(follow(two, with_contacts(two, np.arange(8) < 6)))
    assert (len(events.pairs), events.kept, events.several) == (0, 1, 3)


def test_a_grain_that_comes_loose_is_no_merger_of_the_rule():
    """Two squares that share a grain of two contacts: one opens, and the grain dangles."""
    x = [*CORNERS, [0.5, 0.5]]
    graph = network(x, [*SQUARE, [0, 4], [4, 2]])
    events = order_events(follow(graph, with_contacts(graph, np.arange(6) < 5)))
    assert (len(events.pairs), events.grain, events.once, events.several) == (0, 2, 0, 0)


def test_no_event_and_times_that_do_not_fit_are_refused():
    square = network(CORNERS, SQUARE)
    with pytest.raises(InputError, match="without an elementary event"):
        order_kinetics([follow(square, square)])
    crossed = network(CORNERS, [*SQUARE, [0, 2]])
    for time in ([1.0, 1.0], [0.0], [np.nan]):
        with pytest.raises(InputError, match=r"time.*got .*expected (a positive|a finite|shape)"):
            order_kinetics([follow(square, crossed)], time)


# --- against known rates -----------------------------------------------------------------------


@pytest.fixture(scope="module")
def runs():
    return [gillespie(balanced(), 6.0, seed) for seed in range(25)]


def test_known_rates_lie_within_their_limits(runs):
    split, inside, of = balanced(), 0, 0
    for run in runs:
        found = order_kinetics(run, np.full(len(run), 0.05))
        (p_low, q_low), (p_high, q_high) = found.limits()
        for k, pair in enumerate(map(tuple, found.pairs.tolist())):
            inside += int(p_low[k] <= MERGE[pair] <= p_high[k])
            inside += int(q_low[k] <= split[pair] <= q_high[k])
            of += 2
    # Garwood's limits hold at least 95 %; one in a thousand samples of `of` has fewer than this.
    assert inside >= binom.ppf(1e-3, of, 0.95)


def test_balance_is_refused_no_more_often_than_the_level_says(runs):
    balances = [order_kinetics(run).balance() for run in runs]
    most = binom.ppf(0.999, len(runs), 0.05)
    assert sum(balance.p_all < 0.05 for balance in balances) <= most
    assert sum(balance.p_cycles < 0.05 for balance in balances) <= most
    assert all(balance.cycles > 0 for balance in balances)


def test_a_cycle_is_refused():
    """(3, 5) -> 6 -> (4, 4) faster than back: fluxes around, whatever the distribution."""
    split = balanced()
    split[3, 5] *= 0.2
    split[4, 4] *= 5.0
    balance = order_kinetics(gillespie(split, 6.0, 0)).balance()
    assert balance.p_cycles < 1e-6 and balance.p_all < 1e-6


def test_a_distribution_on_its_way_is_no_cycle():
    """Started away from its steady state a reversible system has net events; its rates balance."""
    run = gillespie(balanced(WANTED * np.array([1, 1, 1, 0.5, 1, 1, 1, 1])), 0.5, 0, grains=3000)
    balance = order_kinetics(run).balance()
    assert balance.p_all < 1e-6 and balance.p_cycles > 0.01


def test_the_steady_state_of_balanced_rates_is_the_distribution_they_were_made_for():
    """Exact rates, by counts that are exposures times rates."""
    found = order_kinetics(gillespie(balanced(), 1.0, 0))
    split = balanced()
    rates = [[table[tuple(pair)] for pair in found.pairs.tolist()] for table in (MERGE, split)]
    found.__dict__.update(opening_rate=np.array(rates[0]), closing_rate=np.array(rates[1]))
    share = found.steady().share
    assert share == pytest.approx(WANTED / WANTED.sum(), abs=1e-8)


def test_the_error_of_the_steady_state_covers_runs(runs):
    """z of an order over ten runs: chi squared of 10, from 1.2 to 31 in 999 of 1000 samples."""
    want = WANTED / WANTED.sum()
    steady = [order_kinetics(run, np.full(len(run), 0.05)).steady() for run in runs[:10]]
    z = np.array([(one.share - want)[3:6] / one.error[3:6] for one in steady])
    assert 1.2 < (z**2).sum(axis=0).min() and (z**2).sum(axis=0).max() < 31


def test_stated_error_is_the_difference_of_the_rates():
    """By central differences over the rates: their truncation is 1e-8 of a slope."""
    run = gillespie(balanced(), 3.0, 1)
    found = order_kinetics(run)
    wanted = np.zeros(len(found.loops))
    for kind in ("opening_rate", "closing_rate"):
        base = getattr(found, kind)
        counts = (found.opened if kind == "opening_rate" else found.closed).sum(axis=0)
        for k in range(len(base)):
            shares = []
            for step in (-1e-4, 1e-4):
                moved = base.copy()
                moved[k] *= 1.0 + step
                found.__dict__[kind] = moved
                shares.append(found.steady().share)
            found.__dict__[kind] = base
            wanted += ((shares[1] - shares[0]) / 2e-4) ** 2 / counts[k]
    assert found.steady().error == pytest.approx(np.sqrt(wanted), rel=1e-3, abs=1e-9)


def test_a_steady_state_that_too_few_events_tell_is_withheld():
    """Squares from pairs of triangles, and no way back: order 3, half the loops, empties."""
    one = OrderEvents(
        np.array([0, 0, 0, 10, 10]), np.array([0, 0, 0, 6, 12]), np.array([[3, 3]]), np.array([2]),
        np.array([0]), 16, 4, 0, 0,
    )  # fmt: skip
    steady = order_kinetics([one]).steady()
    assert np.isnan(steady.share).all() and np.isnan(steady.error).all()
    back = one._replace(closed=np.array([1]))
    share = order_kinetics([back]).steady().share
    assert np.isfinite(share).all() and share[3] > 0.01 and share[4] > 0.01


# --- by order ---------------------------------------------------------------------------------


def test_rates_by_order_are_those_of_the_pairs():
    """Splits and mergers of each order, in a run at its steady state."""
    events = gillespie(balanced(), 60.0, 4)
    found = order_kinetics(events, np.full(len(events), 0.05))
    table = found.by_order()
    m, n = found.pairs.T
    time = found.loops * found.duration
    for k in range(3, 8):
        splits = float(found.closed.sum(axis=0)[m + n - 2 == k].sum())
        with_k = found.opened.sum(axis=0) * ((m == k).astype(float) + (n == k))
        assert table["split_rate"][k] == pytest.approx(splits / time[k])
        assert table["merger_rate"][k] == pytest.approx(with_k.sum() / time[k])
        assert table["splits"][k] == splits
        assert table["mergers"][k] == found.opened.sum(axis=0)[(m == k) | (n == k)].sum()
        for name in ("split", "merger"):
            low, high = table[f"{name}_rate_low"][k], table[f"{name}_rate_high"][k]
            assert low <= table[f"{name}_rate"][k] <= high
    assert table["split_rate"][3] == 0.0 and np.isnan(table["split_rate"][2])
    # In balance a loop of order 7 splits as often as the rates that led there say.
    wanted = sum(q for (a, b), q in balanced().items() if a + b - 2 == 7)
    assert table["split_rate_low"][7] < wanted < table["split_rate_high"][7]


def test_excess_over_its_error_is_z():
    found = order_kinetics(gillespie(balanced(), 20.0, 5))
    table = found.columns()
    total = table["openings"] + table["closings"]
    excess = (table["openings"] - table["closings"]) / total
    assert table["balance_excess"] == pytest.approx(excess)
    assert table["balance_error"] == pytest.approx(1 / np.sqrt(total))
    assert table["balance_excess"] / table["balance_error"] == pytest.approx(table["balance_z"])


@pytest.mark.parametrize(("count", "low", "high"), [(0, 0.0, 3.689), (1, 0.0253, 5.572),
                                                    (10, 4.795, 18.390)])  # fmt: skip
def test_limits_of_counts_are_those_of_tables(count, low, high):
    """Garwood's limits, 95 %, as printed in tables of the Poisson distribution."""
    assert poisson_limits(count) == pytest.approx((low, high), abs=5e-4)


def test_errors_over_packings_are_those_of_drawing_packings(runs):
    """Two packings in closed form; more draws of three than by chance agree with random ones."""
    events = runs[0]
    first, second, third = ((events[k::3], np.full(len(events[k::3]), 1.0 + k)) for k in range(3))

    def measure(found):
        return np.array([found.duration, found.opened.sum()])

    value, error = over_packings([first, second], measure)
    own = np.array([measure(order_kinetics(*one)) for one in (first, second)])
    # (a, a), (a, b) twice, (b, b).
    assert value == pytest.approx(own.sum(axis=0))
    assert error == pytest.approx(np.abs(own[0] - own[1]) / np.sqrt(2.0))
    packings, random = [first, second, third], np.random.default_rng(0)
    own = np.array([measure(order_kinetics(*one)) for one in packings])
    drawn = own[random.integers(0, 3, (20_000, 3))].sum(axis=1).std(axis=0)
    assert over_packings(packings, measure)[1] == pytest.approx(drawn, rel=0.02)
    for count in (1, 7):
        with pytest.raises(InputError, match="2 to 6"):
            over_packings([first] * count, measure)


def test_a_draw_without_the_measure_is_left_out_of_the_error(runs):
    packings = [(runs[0][:9], np.ones(9)), (runs[0][9:19], np.ones(10))]
    value, error = over_packings(
        packings, lambda found: np.array([found.duration, np.nan][found.duration == 18.0])
    )
    # 19 twice and 20: without the draw of the first packing alone.
    assert value == 19.0 and error == pytest.approx(np.sqrt(2.0 / 9.0))


def test_neighbours_of_a_square_beside_two_triangles():
    x = [[0, 0], [1, 0], [1, 1], [0, 1], [1.8, 0.5]]
    contacts = [[0, 1], [1, 2], [2, 3], [3, 0], [1, 4], [4, 2], [0, 2]]
    crossed = GrainGraph(x=x, radii=[0.5] * 5, contacts=contacts)
    assert order_neighbours(find_faces(crossed))[3, 3] == 4  # two contacts between three triangles
    square = crossed.replace(contacts=contacts[:-1], normal_force=None, shear_force=None)
    found = order_neighbours(find_faces(square))
    assert found[3, 4] == found[4, 3] == 1 and found.sum() == 2


def test_neighbours_are_those_of_every_contact():
    graph = synthetic_network(400, seed=1)
    faces = find_faces(graph)
    found, wanted = order_neighbours(faces), {}
    loops = set(faces.loops.tolist())
    by_contact = {}
    for face in range(len(faces.order)):
        for row in range(faces.offsets[face], faces.offsets[face + 1]):
            by_contact.setdefault(int(faces.contacts[row]), []).append(face)
    for sides in by_contact.values():
        if len(sides) == 2 and sides[0] != sides[1] and loops.issuperset(sides):
            pair = tuple(int(faces.order[side]) for side in sides)
            for one in (pair, pair[::-1]):
                wanted[one] = wanted.get(one, 0) + 1
    told = {(m, n): int(found[m, n]) for m, n in np.argwhere(found).tolist()}
    assert told == wanted and len(wanted) > 5


def test_rates_of_an_order_count_both_loops_of_a_merger_of_two_alike():
    """Three mergers of two triangles and two of a triangle with a square, in two units of time."""
    found = OrderKinetics(
        pairs=np.array([[3, 3], [3, 4]]), opened=np.array([[3, 2]]), closed=np.array([[1, 4]]),
        opening_exposure=np.ones(2), closing_exposure=np.ones(2),
        loops=np.array([0.0, 0.0, 0.0, 10.0, 5.0, 8.0]), duration=2.0, kept=0, once=0, grain=0,
        several=0,
    )  # fmt: skip
    rates = found.by_order()
    assert rates["mergers"].tolist() == [0, 0, 0, 5, 2, 0]
    assert rates["splits"].tolist() == [0, 0, 0, 0, 1, 4]
    # Eight triangles took part in five mergers; limits are those of five, for as many loops each.
    low, high = poisson_limits(5)
    np.testing.assert_allclose(rates["merger_rate"][3:], [8 / 20, 2 / 10, 0.0])
    np.testing.assert_allclose(rates["merger_rate_low"][3], 8 / 5 * low / 20)
    np.testing.assert_allclose(rates["merger_rate_high"][3], 8 / 5 * high / 20)
    np.testing.assert_allclose(rates["split_rate"][3:], [0.0, 1 / 10, 4 / 16])
    np.testing.assert_allclose(rates["merger_rate_high"][5], poisson_limits(0)[1] / 16)


def test_dispersion_is_the_scatter_of_the_net_events_over_that_of_poisson():
    """Events of one pair in four intervals; none of the other is frequent enough to count."""
    opened = np.array([[6, 1], [2, 0], [9, 0], [3, 0]])
    closed = np.array([[4, 0], [5, 0], [1, 0], [2, 0]])
    found = OrderKinetics(
        pairs=np.array([[3, 4], [3, 5]]), opened=opened, closed=closed,
        opening_exposure=np.ones(2), closing_exposure=np.ones(2), loops=np.full(7, 20.0),
        duration=4.0, kept=0, once=0, grain=0, several=0,
    )  # fmt: skip
    a, b = opened[:, 0], closed[:, 0]
    each, share = a + b, (a - b).sum() / (a + b).sum()
    scatter = ((a - b - share * each) ** 2).sum()
    expected = (each * (1 - each / each.sum())).sum() * (1 - share**2)
    assert found.balance().dispersion == pytest.approx(scatter / expected)
