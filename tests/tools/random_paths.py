"""Random paths: how they end, and how long they take.

    python -m tests.tools.random_paths --count 225 [--seed 0] [--only 17] [--limit 60]

Loops of 3 to 12 grains, both closures, all spin rules, all laws, programmes forth and back. Each
path has its own seed and can be run again by itself. A line for each that is not `finished` or
takes long, then how many ended how.
"""

import argparse
import signal
import time
from collections import Counter

import numpy as np

from loops import HertzMindlin, LinearFrictional, RollingResistance, Scene, contact_state
from patterns import regular_polygon
from stability import Stage, follow, programmes

SLOW = 10.0  # seconds
DRIVEN = {
    "isotropic strain": (programmes.isotropic_strain, "H11"),
    "isotropic stress": (programmes.isotropic_stress, "P11"),
    "drained": (lambda s: programmes.drained_biaxial(rate=s), "H11"),
    "oedometric": (lambda s: programmes.oedometric(rate=s), "H11"),
    "undrained": (lambda s: programmes.undrained(rate=s), "H11"),
    "force": (lambda s: programmes.proportional_stress(s, 0.0), "P11"),
}


def driven(name, sense, target):
    programme, quantity = DRIVEN[name]
    return Stage(programme(sense), quantity, target)


def random_law(rng):
    mu = float(rng.choice([np.inf, 0.0, rng.uniform(0.05, 0.8)], p=[0.2, 0.1, 0.7]))
    linear = LinearFrictional(kn=1.0, kt=rng.uniform(0.1, 1.0), mu=mu)
    kind = rng.choice(["linear", "hertz", "rolling"], p=[0.6, 0.2, 0.2])
    if kind == "hertz":
        return HertzMindlin(young=1.0, poisson=rng.uniform(0.0, 0.5), mu=mu)
    return RollingResistance(linear, rng.uniform(0.01, 0.3)) if kind == "rolling" else linear


def random_scene(seed):
    """Graph, law, stages and options of one path."""
    rng = np.random.default_rng(seed)
    law = random_law(rng)
    graph = regular_polygon(int(rng.integers(3, 13)), strain=rng.uniform(0.01, 0.1))
    if rng.random() < 0.5:
        # An irregular loop: the reference is moved too, so that it stays an affine image.
        moved = graph.x + 0.02 * rng.standard_normal(graph.x.shape)
        graph = graph.replace(x=moved, x0=moved)
    graph = graph.replace(normal_force=law.normal_force(contact_state(graph)))
    level = rng.uniform(0.1, 0.25)
    stages = [Stage(programmes.isotropic_strain(), "H11", level)]
    for _ in range(int(rng.integers(1, 4))):
        name = str(rng.choice(list(DRIVEN)))
        back = bool(rng.random() < 0.5)
        if name in ("isotropic stress", "force"):
            # Back to zero, or on: the stress of the start is some tenths.
            stages.append(driven(name, -1.0 if back else 1.0, 0.0 if back else 1.0))
            continue
        target = 0.0 if back else level + float(rng.choice([-1.0, 1.0])) * rng.uniform(0.02, 0.25)
        if target != level:
            stages.append(driven(name, float(np.sign(target - level)), target))
        level = target
    options = {
        "closure": str(rng.choice(["affine", "traction"])),
        "spins": str(rng.choice(["blocked", "affine", "free"])),
        "contact_on_touch": str(rng.choice(["ignore", "add"])),
    }
    return graph, law, stages, options


class _TooLongError(Exception):
    pass


def _ring(*_):
    raise _TooLongError


def run(seed, limit):
    """Status, message and processor seconds of one path."""
    graph, law, stages, options = random_scene(seed)
    start = time.process_time()
    signal.signal(signal.SIGVTALRM, _ring)
    signal.setitimer(signal.ITIMER_VIRTUAL, limit)
    try:
        path = follow(Scene(graph, law), stages, **options)
        status, message = path.status, path.message
    except _TooLongError:
        status, message = "too long", f"over {limit} s"
    finally:
        signal.setitimer(signal.ITIMER_VIRTUAL, 0)
    what = (
        f"n = {graph.grain_count}, {type(law).__name__}, {options['closure']}, {options['spins']}"
    )
    names = ", ".join(f"{s.programme.name} to {s.quantity} = {s.target:.3g}" for s in stages)
    return status, message, time.process_time() - start, f"{what}: {names}"


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=225)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", type=int)
    parser.add_argument("--limit", type=int, default=60, help="seconds for one path")
    asked = parser.parse_args()
    seeds = [asked.only] if asked.only is not None else range(asked.seed, asked.seed + asked.count)
    statuses, longest = Counter(), (0.0, -1)
    for seed in seeds:
        status, message, seconds, what = run(seed, asked.limit)
        statuses[status] += 1
        longest = max(longest, (seconds, seed))
        if status != "finished" or seconds > SLOW or asked.only is not None:
            print(f"{seed}: {status} in {seconds:.1f} s: {message} [{what}]", flush=True)
    print(", ".join(f"{count} {status}" for status, count in statuses.most_common()))
    print(f"longest: {longest[0]:.1f} s, path {longest[1]}")


if __name__ == "__main__":
    main()
