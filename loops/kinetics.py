"""Kinetics of loop orders: contacts that open merge two loops, contacts that close split one."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations_with_replacement
from math import factorial, prod
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from loops.arrays import Floats, Integers
from loops.errors import InputError, counted, listed
from loops.faces import Faces
from loops.shown import Shown
from loops.tracking import Fate, LoopFates
from loops.validation import positive

# Least number of events of a pair of orders that enters chi squared.
MIN_EVENTS = 10
# Fields of `OrderEvents` that count the fates of the earlier loops.
FATES = ("kept", "once", "grain", "several")
# Limits of the rates hold for this share of repeated counts.
LEVEL = 0.95
# Times of the slowest event after which a distribution is steady.
STEADY_TIMES = 1e4
# Orders below this share of the loops are empty.
EMPTY = 1e-3
# `steady` gives no answer if the rates empty orders that held more than this share.
DRAINED = 0.05


class OrderEvents(NamedTuple):
    """Elementary events of one interval, and its loops by order.

    `before`, `after` count loops, indexed by order; row k of `pairs` holds two orders, ascending,
    that `opened[k]` times merged into one loop and that `closed[k]` times came from one. Of the
    earlier loops `kept` survived, `once` went through one such event, `grain` through one that
    freed or caught a grain, `several` through more.
    """

    before: Integers
    after: Integers
    pairs: Integers
    opened: Integers
    closed: Integers
    kept: int
    once: int
    grain: int
    several: int


def order_events(fates: LoopFates) -> OrderEvents:
    """Events of an interval that are one contact each.

    A contact that opens between loops of orders m and n leaves one of m + n - 2; one that closes
    inside a loop does the reverse. All other fates of a loop took several events, or the outside.
    """
    split, caught = _parted(fates.before, Fate.SPLIT, fates.order_before, fates.predecessor,
                            fates.order_after)  # fmt: skip
    merged, freed = _parted(fates.after, Fate.MERGED, fates.order_after, fates.successor,
                            fates.order_before)  # fmt: skip
    pairs, which = np.unique(np.concatenate([merged, split]), axis=0, return_inverse=True)
    which = which.ravel()
    opened = np.bincount(which[: len(merged)], minlength=len(pairs))
    closed = np.bincount(which[len(merged) :], minlength=len(pairs))
    kept = int(np.count_nonzero(fates.before == Fate.SURVIVED))
    once, grain = 2 * len(merged) + len(split), 2 * freed + caught
    return OrderEvents(
        np.bincount(fates.order_before), np.bincount(fates.order_after), pairs, opened, closed,
        kept, once, grain, len(fates.before) - kept - once - grain,
    )  # fmt: skip


def _parted(
    fate: NDArray[np.int8], wanted: Fate, whole: Integers, partner: Integers, parts: Integers
) -> tuple[Integers, int]:
    """(E, 2) orders of the two parts of each loop of that fate that one contact divides.

    Return also the number of loops that a grain divides in two.
    """
    mine = partner >= 0
    mine[mine] = fate[partner[mine]] == wanted
    owner = partner[mine]
    order = np.argsort(owner, kind="stable")
    owner, part = owner[order], parts[mine][order]
    loop, first, count = np.unique(owner, return_index=True, return_counts=True)
    loop, first = loop[count == 2], first[count == 2]
    found = np.sort(np.stack([part[first], part[first + 1]], axis=1), axis=1)
    by_contact = found.sum(axis=1) == whole[loop] + 2
    return found[by_contact], int(np.count_nonzero(~by_contact))


@dataclass(frozen=True, eq=False, repr=False)
class Balance(Shown):
    """Openings against closings, see `OrderKinetics.balance`."""

    z: Floats
    p: Floats
    chi2: float
    pairs: int
    p_all: float
    cycles_chi2: float
    cycles: int
    p_cycles: float
    dispersion: float


@dataclass(frozen=True, eq=False, repr=False)
class SteadyOrders(Shown):
    """Steady shares of the loops, indexed by order, and their errors."""

    share: Floats
    error: Floats


@dataclass(frozen=True, eq=False, repr=False)
class OrderKinetics(Shown):
    """Elementary events of a series, and their rates.

    The size of the system is `G = sum (n - 2) N_n/2`, its grains in loops: no event changes it.
    Orders m <= n merge `p_mn N_m N_n/G` times per unit of time (`N_m (N_m - 1)/2` pairs if m = n),
    a loop of order m + n - 2 splits into them `q_mn` times: the master equations of Wanjura, Gago,
    Matsushima and Blumenfeld 2020.

    Attributes
    ----------
    pairs : (P, 2) array of int
        Orders m <= n of which an event was seen.
    opened, closed : (I, P) array of int
        Mergers into, and splits of, order m + n - 2 in each interval.
    opening_exposure, closing_exposure : (P,) array
        Time integrals of `N_m N_n/G` and of `N_(m+n-2)`, by the trapezoidal rule.
    loops : (K,) array
        Mean number of loops over the time, indexed by order.
    duration : float
        Time of all intervals.
    kept, once, grain, several : int
        Earlier loops that survived their interval, took part in one elementary event, were merged
        or split by a grain that came loose or was caught, took part in more.
    """

    pairs: Integers
    opened: Integers
    closed: Integers
    opening_exposure: Floats
    closing_exposure: Floats
    loops: Floats
    duration: float
    kept: int
    once: int
    grain: int
    several: int

    def facts(self) -> dict[str, object]:
        """Counts of the events."""
        opened, closed = int(self.opened.sum()), int(self.closed.sum())
        return {"pairs": len(self.pairs), "opened": opened, "closed": closed}

    @cached_property
    def opening_rate(self) -> Floats:
        """(P,) `p_mn`."""
        return self.opened.sum(axis=0) / self.opening_exposure

    @cached_property
    def closing_rate(self) -> Floats:
        """(P,) `q_mn`."""
        return self.closed.sum(axis=0) / self.closing_exposure

    def limits(self, level: float = LEVEL) -> tuple[Floats, Floats]:
        """Lower and upper limits, each (2, P), of `p_mn` and of `q_mn`: Poisson counts, exact."""
        counts = np.stack([self.opened.sum(axis=0), self.closed.sum(axis=0)])
        exposure = np.stack([self.opening_exposure, self.closing_exposure])
        low, high = poisson_limits(counts, level)
        return low / exposure, high / exposure

    def by_order(self, level: float = LEVEL) -> dict[str, Any]:
        """Return how often a loop of each order splits and merges, per loop and unit of time.

        One row an order, with the counts and the limits of Poisson's counts. A loop of order k
        splits where a contact closes inside it, and merges where one of its own opens; a merger of
        two loops of one order counts for both.
        """
        order, opened, closed = (
            np.arange(len(self.loops)), self.opened.sum(axis=0), self.closed.sum(axis=0)
        )  # fmt: skip
        m, n = self.pairs.T
        splits = np.bincount(m + n - 2, closed, minlength=len(order))
        # Mergers in which loops of the order took part, and the loops of it that did.
        with_one = np.bincount(np.where(m == n, m, n), opened, minlength=len(order))
        mergers = with_one + np.bincount(m[m != n], opened[m != n], minlength=len(order))
        loops = mergers + np.bincount(m[m == n], opened[m == n], minlength=len(order))
        table: dict[str, Any] = {"order": order}
        exposure = np.maximum(self.loops * self.duration, 1e-300)
        for name, counts, taking_part in (("split", splits, splits), ("merger", mergers, loops)):
            twice = np.divide(taking_part, counts, out=np.ones(len(order)), where=counts > 0)
            seen = self.loops > 0
            values = (taking_part, *(twice * one for one in poisson_limits(counts, level)))
            for tail, value in zip(("", "_low", "_high"), values, strict=True):
                table[f"{name}_rate{tail}"] = np.where(seen, value / exposure, np.nan)
            table[f"{name}s"] = counts.astype(np.int64)
        return table

    def columns(self) -> dict[str, Any]:
        """One row a pair of orders: counts, rates with their limits, and the balance.

        `balance_excess` is `(openings - closings)/(openings + closings)`, zero under detailed
        balance, and `balance_error` its standard error there; `balance_z` is the one over the
        other.
        """
        (p_low, q_low), (p_high, q_high) = self.limits()
        balance, total = self.balance(), (self.opened + self.closed).sum(axis=0)
        return {
            "order_1": self.pairs[:, 0],
            "order_2": self.pairs[:, 1],
            "order_merged": self.pairs.sum(axis=1) - 2,
            "openings": self.opened.sum(axis=0),
            "closings": self.closed.sum(axis=0),
            "opening_rate": self.opening_rate,
            "opening_rate_low": p_low,
            "opening_rate_high": p_high,
            "closing_rate": self.closing_rate,
            "closing_rate_low": q_low,
            "closing_rate_high": q_high,
            "balance_excess": (self.opened - self.closed).sum(axis=0) / total,
            "balance_error": 1.0 / np.sqrt(total),
            "balance_z": balance.z,
            "balance_p": balance.p,
        }

    def balance(self) -> Balance:
        """Test of detailed balance: whether every pair of orders merges as often as it comes about.

        Under detailed balance either event of a pair is as likely. `z = (opened - closed)/sqrt(n)`
        with `n = opened + closed`, `p` the exact binomial two-sided level. `chi2` adds up `z^2`
        over the `pairs` of at least 10 events. A distribution on its way has net events, whatever
        the rates; whether these can be balanced at all is Kolmogorov's criterion: around every
        closed cycle of pairs, as 3 + 5 -> 6 -> 4 + 4, 4 -> 3 + 3, 3 + 4 -> 5, the products of the
        rates are the same in either direction. `cycles_chi2` adds up the logarithms of their
        ratios, each over its error, for the `cycles` that are independent; half an event is added
        to every count.

        Errors are Poisson's. Net events of a steady reversible system vary less, so that `p_all`
        rejects it less often than the level says. `dispersion` is the variance of the net events
        between intervals over Poisson's: above 1 events come in bursts; divide chi squared by it.
        """
        from scipy.special import bdtr, chdtrc

        opened, closed = self.opened.sum(axis=0), self.closed.sum(axis=0)
        total, net = opened + closed, opened - closed
        z = net / np.sqrt(total)
        p = np.minimum(2.0 * bdtr(np.minimum(opened, closed).astype(float), total, 0.5), 1.0)
        many = total >= MIN_EVENTS
        chi2, pairs = float(np.sum(z[many] ** 2)), int(np.count_nonzero(many))
        cycle, cycles = 0.0, 0
        if pairs:
            # Combinations of mergers and splits that change no number of loops.
            _, sizes, basis = np.linalg.svd(self.stoichiometry[:, many])
            free = basis[np.count_nonzero(sizes > 1e-9 * sizes[0]) :]
            up, down = opened + 0.5, closed + 0.5
            ratio = np.log(
                self._twins * up * self.closing_exposure / (down * self.opening_exposure)
            )
            cycles, around = len(free), free @ ratio[many]
            spread = (free * (1.0 / up + 1.0 / down)[many]) @ free.T
            cycle = float(around @ np.linalg.solve(spread, around))
        levels = (
            float(chdtrc(n, at)) if n else np.nan for n, at in ((pairs, chi2), (cycles, cycle))
        )
        p_all, p_cycles = levels
        each, counted = self.opened + self.closed, np.maximum(total, 1)
        share = net / counted
        with np.errstate(invalid="ignore", divide="ignore"):
            poisson = each * (1.0 - each / counted) * many
            beyond = (self.opened - self.closed - share * each) ** 2 * many
            dispersion = float(beyond.sum() / np.sum(poisson * (1.0 - share**2)))
        return Balance(z, p, chi2, pairs, p_all, cycle, cycles, p_cycles, dispersion)

    @property
    def _twins(self) -> Floats:
        """Factor 1/2 for pairs of one order."""
        return np.where(self.pairs[:, 0] == self.pairs[:, 1], 0.5, 1.0)

    @cached_property
    def stoichiometry(self) -> Floats:
        """(K, P) change of the number of loops of each order by a merger."""
        change = np.zeros((len(self.loops), len(self.pairs)))
        at = np.arange(len(self.pairs))
        np.add.at(change, (self.pairs, at[:, None]), -1.0)
        change[self.pairs.sum(axis=1) - 2, at] += 1.0
        return change

    def steady(self) -> SteadyOrders:
        """Distribution of orders that the rates lead to from the mean one, in a large system.

        Errors are those of Poisson's counts, to first order. An order that no event touches keeps
        its number. An order that the rates empty is NaN, as events that lead back there were too
        rare to be seen; all are where such orders held more than a twentieth of the loops.
        """
        from scipy.integrate import solve_ivp

        S, order = self.stoichiometry, np.arange(len(self.loops))
        start = 2.0 * self.loops / np.sum((order - 2) * self.loops)
        rates = np.concatenate([self.opening_rate, self.closing_rate])
        x = solve_ivp(
            lambda _, x: S @ np.subtract(*self._events(x)),
            (0.0, STEADY_TIMES / rates[rates > 0].min()), start,
            method="BDF", rtol=1e-9, atol=1e-13, jac=lambda _, x: S @ self._slopes(x),
        ).y[:, -1]  # fmt: skip
        x = np.maximum(x, 0.0)
        emptied = (self.loops > 0) & (x < EMPTY * x.sum())
        if self.loops[emptied].sum() > DRAINED * self.loops.sum():
            return SteadyOrders(np.full(len(x), np.nan), np.full(len(x), np.nan))
        merged, split = self._events(x)
        variance = merged**2 / np.maximum(self.opened.sum(axis=0), 1)
        variance += split**2 / np.maximum(self.closed.sum(axis=0), 1)
        # The number of grains is conserved for any rates.
        J, grains = S @ self._slopes(x), (order - 2.0) * S.any(axis=1)
        grains *= np.linalg.norm(J) / np.linalg.norm(grains)
        shift = -np.linalg.pinv(np.vstack([J, grains]), rcond=1e-9)[:, : len(x)] @ S
        share = x / x.sum()
        turned = (shift - np.outer(share, shift.sum(axis=0))) / x.sum()
        error = np.sqrt(turned**2 @ variance)
        return SteadyOrders(np.where(emptied, np.nan, share), np.where(emptied, np.nan, error))

    def _events(self, x: Floats) -> tuple[Floats, Floats]:
        """Mergers and splits per time and grain, of `x (K,)` loops per grain of a large system."""
        m, n = self.pairs.T
        return self._twins * self.opening_rate * x[m] * x[n], self.closing_rate * x[m + n - 2]

    def _slopes(self, x: Floats) -> Floats:
        """(P, K) derivatives of mergers less splits."""
        (m, n), at = self.pairs.T, np.arange(len(self.pairs))
        rate = self._twins * self.opening_rate
        slopes = np.zeros((len(at), len(x)))
        slopes[at, m] += rate * x[n]
        slopes[at, n] += rate * x[m]
        slopes[at, m + n - 2] -= self.closing_rate
        return slopes


def order_kinetics(
    intervals: Sequence[LoopFates | OrderEvents], time: ArrayLike | None = None
) -> OrderKinetics:
    """Rates at which loops of a series merge and split, by orders.

    Only events of one contact in an interval are counted: contacts that open and close again
    between two snapshots are missed, and so are loops with two events. Both biases fall with the
    length of the interval, in proportion to it only where contacts don't flicker; `several` over
    `once` measures the second. Mergers and splits that free or catch a grain are counted apart,
    by `grain`.

    Parameters
    ----------
    intervals : sequence of LoopFates
        Of successive snapshots, from `loop_fates`.
    time : (I,) array, optional
        Length of every interval, say its strain; 1 each if left out.

    Returns
    -------
    OrderKinetics
        Events, rates, the test of detailed balance, the steady state.

    Raises
    ------
    InputError
        Without an interval or an event, or if times are not positive, one an interval.

    Examples
    --------
    >>> from loops import GrainGraph, find_faces, loop_fates, match_contacts, order_kinetics
    >>> x, ring = [[0, 0], [1, 0], [1, 1], [0, 1]], [[0, 1], [1, 2], [2, 3], [3, 0]]
    >>> square = GrainGraph(x=x, radii=[0.5] * 4, contacts=ring)
    >>> crossed = GrainGraph(x=x, radii=[0.5] * 4, contacts=[*ring, [0, 2]])
    >>> match = match_contacts(square, range(4), crossed, range(4))
    >>> fates = loop_fates(match, find_faces(square), find_faces(crossed))
    >>> kinetics = order_kinetics([fates])
    >>> kinetics.pairs.tolist(), kinetics.closed.tolist()
    ([[3, 3]], [[1]])
    """
    given = listed("intervals", intervals, (LoopFates, OrderEvents), "See loops.loop_fates.")
    events = [one if isinstance(one, OrderEvents) else order_events(one) for one in given]
    if not any(len(one.pairs) for one in events):
        received = f"{counted(len(events), 'interval')} without an elementary event"
        raise InputError("intervals", received, "loops that merge or split", "Give more of them.")
    length = positive("time", np.ones(len(events)) if time is None else time, len(events))
    pairs = np.unique(np.concatenate([one.pairs for one in events]), axis=0)
    K = max(
        int(pairs.sum(axis=1).max()) - 1, *(len(n) for e in events for n in (e.before, e.after))
    )
    opened, closed = np.zeros((2, len(events), len(pairs)), dtype=np.int64)
    exposure, loops = np.zeros((2, len(pairs))), np.zeros(K)
    place = {tuple(pair): k for k, pair in enumerate(pairs.tolist())}
    m, n = pairs.T
    for row, (one, weight) in enumerate(zip(events, length, strict=True)):
        at = [place[tuple(pair)] for pair in one.pairs.tolist()]
        opened[row, at], closed[row, at] = one.opened, one.closed
        for counts in (one.before, one.after):
            N = np.zeros(K)
            N[: len(counts)] = counts
            grains = max(0.5 * float(np.sum((np.arange(K) - 2) * N)), 1.0)
            # Pairs of loops over the grains, and loops of the merged order.
            many = np.where(m == n, 0.5 * N[m] * (N[m] - 1.0), N[m] * N[n])
            exposure += 0.5 * weight * np.stack([many / grains, N[m + n - 2]])
            loops += 0.5 * weight * N / length.sum()
    fates = {name: sum(getattr(one, name) for one in events) for name in FATES}
    total = float(length.sum())
    return OrderKinetics(pairs, opened, closed, exposure[0], exposure[1], loops, total, **fates)


def over_packings(
    packings: Sequence[tuple[Sequence[OrderEvents], ArrayLike]],
    measure: Callable[[OrderKinetics], Floats],
) -> tuple[Floats, Floats]:
    """Return a measure of several packings together, and its error by the bootstrap over packings.

    Every way to draw as many packings with replacement is taken, weighted by its probability;
    the error is the standard deviation over them. With few packings it is itself uncertain: of four
    by some 40 %.

    Parameters
    ----------
    packings : sequence of (events, times)
        Intervals of each packing and their lengths, as of `order_kinetics`; 2 to 6 packings.
    measure : callable
        Takes the kinetics of the intervals of some packings, returns an array of one shape.

    Returns
    -------
    value, error : arrays
        Of all packings, and its error; numbers that are not finite in a draw leave it out.

    Raises
    ------
    InputError
        If the packings are fewer than 2 or more than 6.
    """
    count = len(packings)
    if not 2 <= count <= 6:
        raise InputError("packings", str(count), "2 to 6", "Group them, or give more.")

    def of(draw: Sequence[int]) -> Floats:
        events = [one for number in draw for one in packings[number][0]]
        times = np.concatenate([np.asarray(packings[number][1], float) for number in draw])
        return np.asarray(measure(order_kinetics(events, times)), dtype=float)

    found, weights = [], []
    for draw in combinations_with_replacement(range(count), count):
        found.append(of(draw))
        repeats = np.bincount(draw)
        weights.append(factorial(count) / prod(factorial(int(k)) for k in repeats))
    values, known = np.array(found), np.isfinite(found)
    weight = np.reshape(weights, (-1,) + (1,) * (values.ndim - 1)) * known
    values = np.where(known, values, 0.0)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = (weight * values).sum(axis=0) / weight.sum(axis=0)
        variance = (weight * (values - mean) ** 2).sum(axis=0) / weight.sum(axis=0)
    return of(range(count)), np.sqrt(variance)


def order_neighbours(faces: Faces) -> Integers:
    """Return (K, K) numbers of contacts between loops of two orders, symmetric, twice if equal.

    Row m over its sum is the probability that the loop across a contact of a loop of order m has
    the order n. Contacts to the outside, and those with one loop on both sides, are left out.
    """
    order, loops = faces.order, faces.row >= 0
    sides = np.zeros((int(faces.contacts.max(initial=-1)) + 1, 2), dtype=np.int64)
    face = np.repeat(np.arange(len(order)), np.diff(faces.offsets))
    sides[faces.contacts, faces.forward.astype(int)] = face
    inner = sides[:, 0] != sides[:, 1]
    inner[inner] = loops[sides[inner]].all(axis=1)
    m, n = order[sides[inner]].T
    counts = np.zeros((int(order[loops].max(initial=0)) + 1,) * 2, dtype=np.int64)
    np.add.at(counts, (m, n), 1)
    return counts + counts.T


def poisson_limits(counts: ArrayLike, level: float = LEVEL) -> tuple[Floats, Floats]:
    """Return the exact limits between which the means of Poisson's counts lie, central."""
    from scipy.special import gammaincinv

    counts, tail = np.asarray(counts), 0.5 * (1.0 - level)
    low = np.where(counts > 0, gammaincinv(np.maximum(counts, 1), tail), 0.0)
    return low, gammaincinv(counts + 1, 1.0 - tail)
