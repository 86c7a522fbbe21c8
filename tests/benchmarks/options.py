"""Speed against error of the options that a user can turn, each beside an oracle that converged.

`grainloops bench --only options`. The sample is a dense one of Yade at rest (2,000 grains), the
increment a strain of 1e-5, the error the share of the change that is missed; of the yield band the
share of the loops of Yade's 600 grains between walls with another verdict.
"""

import time
from functools import cache

import numpy as np

import grainloops as gl
from loops import LinearFrictional, Scene
from patterns import regular_polygon
from stability import Stage, follow, programmes
from stability.packing import loops_at_yield
from tests.benchmarks.methods import Row
from tests.packings import LAW, jammed

# The intervals, rates, ... that are tried; the default of each option is among them.
PARTS = (1, 2, 4, 8, 16, 32)
RATES = (3e-5, 1e-5, 2e-6, 1e-6, 3e-7, 1e-7)
SUSTAINED = (4e-5, 2e-5, 1e-5, 5e-6)
FANS = (21, 41, 91, 181, 361)
BANDS = (0.99, 0.999, 0.9999, 0.999999)
STEPS = (1, 4, 16, 64, 256)
STRAIN, TOWARDS = 1e-5, Stage(programmes.drained_biaxial(), "parameter", 1e-5)
# Options by the names of their panels.
OPTIONS = (
    "interval of a path", "inertial number of a replay", "interval of sustain",
    "directions of a domain", "yield band", "steps of a material",
)  # fmt: skip
# Oracles are finer than the finest setting by so much.
FINER = 8


@cache
def sample():
    """The packing at rest."""
    cell = np.loadtxt(gl.sample_path("slow/cells.csv"), delimiter=",", skiprows=1, max_rows=1)
    read = gl.read_snapshot(gl.sample_path("slow/grains_10.parquet"), cell=cell[1:5].reshape(2, 2))
    return gl.hold(read.scene).scene


def missed(values, exact, start=0.0):
    """Share of a change that is missed."""
    return float(np.linalg.norm(values - exact) / np.linalg.norm(exact - start))


def measured(group, oracle, method, settings, answer, gap, default):
    """A row a setting: `answer(setting)`, run once before for its kernels, and `gap(answer)`."""
    answer(settings[0])
    rows = []
    for setting in settings:
        begin = time.process_time()
        found = answer(setting)
        seconds = time.process_time() - begin
        named = f"{method} {setting:g}"
        error = max(gap(found), 1e-17)
        rows.append(
            Row(group, method, named, 1, seconds, error, np.nan, oracle, setting == default)
        )
    return rows


def followed(interval):
    """The packing's path of the increment, at intervals of a size."""
    return follow(sample(), TOWARDS, closure="packing", interval=interval * (1.0 + 1e-9))


def intervals(quick):
    """Interval of a path, beside an interval that is 8 times finer than the finest."""
    sizes = [STRAIN / n for n in PARTS[: 3 if quick else None]]
    exact = followed(sizes[-1] / FINER)

    def gap(path):
        return missed(path.P[-1], exact.P[-1], exact.P[0])

    oracle = "an eighth of the finest interval"
    return measured("interval of a path", oracle, "interval", sizes, followed, gap, 5e-6)


def rates(quick):
    """Inertial number of a replay, beside the quasistatic path by events."""
    tried, exact = RATES[: 3 if quick else None], followed(STRAIN / 64)
    count = sample().graph.contact_count
    end, start = (exact.states[k].forces[:count] for k in (-1, 0))

    def replayed(number):
        return gl.replay(sample(), TOWARDS, inertial_number=number)

    def gap(path):
        return missed(path.states[-1].forces[:count], end, start)

    oracle = "the path by events, interval 1.6e-7"
    return measured("inertial number of a replay", oracle, "I", tried, replayed, gap, 2e-6)


def limits(quick):
    """Interval of a sustained load, beside one that is 8 times finer."""
    tried = SUSTAINED[: 3 if quick else None]
    scene = Scene(jammed(24, 3), LAW)
    p = 0.5 * float(np.trace(np.asarray(gl.love_weber_stress(scene))))

    def sustained(interval):
        how = {"interval": interval, "largest": p, "spread": False}
        return gl.sustain(scene, [[1.0, -1.0]], **how).limit[0]

    exact = sustained(tried[-1] / 4)

    def gap(load):
        return abs(load / exact - 1.0)

    oracle = "a quarter of the finest interval"
    return measured("interval of sustain", oracle, "interval", tried, sustained, gap, 5e-6)


def directions(quick):
    """Directions of a domain: the area in the strains that its limits enclose."""
    tried = FANS[: 3 if quick else None]
    hexagon = Scene(
        regular_polygon(6, strain=0.05), LinearFrictional(1.0, 0.3, np.tan(np.radians(20.0)))
    )

    def area(count):
        limits = gl.loop_domain(hexagon, "traction", directions=count).table()
        x, y = limits["E1"].to_numpy(), limits["E2"].to_numpy()
        return 0.5 * abs(float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))))

    exact = area(361 if quick else 1441)

    def gap(found):
        return abs(found / exact - 1.0)

    oracle = f"{361 if quick else 1441} directions"
    return measured("directions of a domain", oracle, "directions", tried, area, gap, 361)


def bands(quick):
    """Yield band: loops of another verdict than with the contacts that do slide at rest."""
    tried = BANDS[1 if quick else 0 :]

    packing = gl.hold(gl.read_snapshot(gl.sample_path()).scene).scene

    def unstable(band):
        return loops_at_yield(packing, band).unstable

    exact = unstable(1.0)

    def gap(flags):
        return np.count_nonzero(flags != exact) / len(exact)

    oracle = "contacts at their strength, band 1"
    return measured("yield band", oracle, "band", tried, unstable, gap, 0.999)


def steps(quick):
    """Steps of a material, beside the hexagon's path by events."""
    law, tried = LinearFrictional(1.0, 0.5, np.tan(np.radians(30))), STEPS[: 3 if quick else None]
    turned = np.array([[np.cos(0.3), np.sin(0.3)], [-np.sin(0.3), np.cos(0.3)]])
    loop = regular_polygon(6)
    loop = loop.replace(x=loop.x @ turned, x0=loop.x @ turned)
    end = np.array([0.05, 0.0, 0.0, 0.01])
    programme = programmes.combination(np.zeros((4, 4)), np.eye(4), end, "straight")
    path = follow(Scene(loop, law), Stage(programme, "parameter", 1.0), closure="traction")
    exact = path.P[-1].reshape(2, 2)
    material = gl.LoopMaterial(loop, None, law, closure="traction")

    def marched(count):
        state = material.start(1)
        for k in range(1, count + 1):
            response = material.update((np.eye(2) - end.reshape(2, 2) * k / count)[None], state)
            state = response.state
        return response.stress[0]

    def gap(stress):
        return missed(np.diag(stress), np.diag(exact))

    oracle = "the path by events"
    return measured("steps of a material", oracle, "steps", tried, marched, gap, None)


def option_methods(quick):
    """Every option in turn."""
    parts = (intervals, rates, limits, directions, bands, steps)
    return [row for part in parts for row in part(quick)]
