"""Arguments out of range raise one clear error before anything is computed."""

import numpy as np
import pytest

from loops import InputError
from patterns import (
    diamond,
    hexagon,
    polydisperse_polygon,
    random_loop,
    regular_polygon,
    synthetic_network,
)

NAN, INF = float("nan"), float("inf")
BAD = {
    "random_loop order": (lambda: random_loop(2), "order: got 2"),
    "random_loop order NaN": (lambda: random_loop(NAN), "order: got nan"),
    "random_loop order infinite": (lambda: random_loop(INF), "order: got inf"),
    "random_loop seed": (lambda: random_loop(5, seed=-1), "seed: got -1"),
    "random_loop seed part": (lambda: random_loop(5, seed=1.5), "seed: got 1.5"),
    "random_loop size": (lambda: random_loop(5, size=-2), "size: got -2"),
    "random_loop sizes": (lambda: random_loop(5, size=(2, -3)), "size: got -3"),
    "random_loop mu": (lambda: random_loop(5, mu=NAN), "mu: got nan"),
    "random_loop radius": (lambda: random_loop(5, radius=0.0), "radius: got 0"),
    "random_loop kn": (lambda: random_loop(5, kn=-1.0), "kn: got -1"),
    "random_loop strain": (lambda: random_loop(5, strain=NAN), "strain: got nan"),
    "random_loop polydispersity": (lambda: random_loop(5, polydispersity=1.0), "polydispersity"),
    "regular_polygon order": (lambda: regular_polygon(3.5), "order: got 3.5"),
    "regular_polygon order text": (lambda: regular_polygon("six"), "order: got 'six'"),
    "regular_polygon radius": (lambda: regular_polygon(4, radius=-1.0), "radius: got -1"),
    "regular_polygon kn": (lambda: regular_polygon(4, kn=0.0), "kn: got 0"),
    "regular_polygon strain": (lambda: regular_polygon(4, strain=-INF), "strain: got -inf"),
    "polydisperse radii": (lambda: polydisperse_polygon([1.0, -1.0, 1.0]), "radii.*got -1"),
    "polydisperse count": (lambda: polydisperse_polygon([1.0, 1.0]), "at least three"),
    "hexagon T": (lambda: hexagon(1.0, T=NAN), "T: got nan"),
    "diamond strain": (lambda: diamond(0.7, E1=1.0), "E1: got 1"),
    "diamond text": (lambda: diamond("flat"), "alpha0: got 'flat'"),
    "network grains": (lambda: synthetic_network(-5), "grains: got -5"),
    "network seed": (lambda: synthetic_network(10, seed=-1), "seed: got -1"),
    "network jitter": (lambda: synthetic_network(10, jitter=NAN), "jitter: got nan"),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_arguments_are_one_error(name):
    make, message = BAD[name]
    with pytest.raises(InputError, match=message) as caught:
        make()
    assert len(str(caught.value)) < 300


def test_no_loops_at_all_is_a_batch():
    assert random_loop(5, size=0).batch_shape == (0,)
    assert random_loop(np.int64(4), seed=np.int64(3), size=(2, 1)).batch_shape == (2, 1)
