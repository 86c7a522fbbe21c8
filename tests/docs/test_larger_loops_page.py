"""`docs/evidence/larger-loops.md`: its thresholds and drained paths, computed again."""

import json
import re

import numpy as np
import pandas as pd
import pytest

from loops import HertzMindlin, LinearFrictional, RollingResistance, Scene
from patterns import regular_polygon
from stability import Stage, follow, programmes
from stability.paths.domain import Fan, FanLimits
from studies.domain import limits_along, programmes_along, unstable_share
from studies.examples.larger_loops import KAPPA, LINEAR, ORDERS, rolling_threshold, threshold
from studies.paths.options import PolygonOptions
from tests.docs.pages import DOCS, of_size, page, says, section, tables
from tests.golden.answers import run
from tests.oracles.polygon_thresholds import critical_strain as oracle

TEXT = page("evidence/larger-loops")
CLOSED = {
    "(1 + κ)/(2 + κ)": (1 + KAPPA) / (2 + KAPPA),
    "κ/(1 + κ)": KAPPA / (1 + KAPPA),
    "1/2": 0.5,
    "0: the first load": 0.0,
}
(THRESHOLDS,) = tables(section(TEXT, "## The threshold"))


def named(row):
    closure, spins = row["closure, spins"].split(", ")
    return closure, spins, [int(n) for n in row["n"].split(", ")]


def path_threshold(order, closure, spins, end):
    """Strain of the first loss on an isotropic path; 0 where the first loaded state has it."""
    law = LinearFrictional(kn=1.0, kt=KAPPA, mu=1e16)
    stage = Stage(programmes.isotropic_strain(), "H11", end)
    path = follow(
        Scene(regular_polygon(order), law),
        [stage],
        closure=closure,
        spins=spins,
        subspace="diagonal",
    )
    loaded = np.flatnonzero(path.H[:, 0] > 0.0)
    if len(loaded) and path.symmetric_eigenvalues[loaded[0], 0] < 0.0:
        return 0.0
    return path.H[path.of_kind("det_Ks_zero")[0].index, 0]


@pytest.mark.parametrize("row", THRESHOLDS, ids=lambda row: f"{row['closure, spins']} {row['n']}")
def test_thresholds_of_the_operators(row):
    closure, spins, orders = named(row)
    wanted = CLOSED[row["strain"]]
    assert says(row["at κ = 0.3"], wanted) and says(row["path (first n)"], wanted)
    for order in orders:
        found = threshold(order, LINEAR, spins, closure=closure)
        assert of_size(abs(found - wanted), float(row["error, operators"]))
        if spins == "blocked":
            assert found == pytest.approx(oracle(order, KAPPA, closure), abs=1e-13)


# Long loops take seconds.
ROWS = [
    pytest.param(row, marks=[pytest.mark.slow] * (k in (2, 5))) for k, row in enumerate(THRESHOLDS)
]


@pytest.mark.parametrize("row", ROWS)
def test_thresholds_through_paths(row):
    closure, spins, orders = named(row)
    wanted = CLOSED[row["strain"]]
    for order in orders:
        found = path_threshold(order, closure, spins, wanted + 0.01)
        assert of_size(abs(found - wanted), float(row["error, paths"]), 1e-14)


def test_the_two_remarks():
    """The form over all components, and the square on its side."""
    diamond = CLOSED["κ/(1 + κ)"]
    for closure in ("affine", "traction"):
        for order in (3, 4, 7, 12):
            found = threshold(order, LINEAR, closure=closure, subspace="full")
            assert abs(found - diamond) < 5e-14
    assert threshold(4, LINEAR, orientation="edge") is None
    found = threshold(4, LINEAR, subspace="symmetric", orientation="edge")
    assert found == pytest.approx(diamond, abs=1e-14) and f"{found:.10f}" in TEXT


def test_other_laws():
    spheres, rolling = tables(section(TEXT, "## Other contact laws"))
    for row in spheres:
        law = HertzMindlin(young=1.0, poisson=float(row["nu"]))
        kappa = float(law.stiffness_ratio)
        assert says(row["κ"], kappa) and says(row["linear law"], kappa / (1 + kappa))
        found = threshold(6, law)
        assert says(row["critical strain"], found)
        assert abs(found - kappa / (kappa + 2 / 3)) < 1e-14
        assert found == pytest.approx(oracle(6, kappa, "traction", exponent=1.5), abs=1e-13)
    for row in rolling:
        k_r = float(row["`k_r`"])
        law = RollingResistance(LINEAR, k_r=k_r)
        for order in ORDERS:
            found = threshold(order, law, "free")
            assert says(row[f"n = {order}"], found)
            assert abs(found - rolling_threshold(order, KAPPA, k_r)) < 1e-13


@pytest.mark.slow
@pytest.mark.parametrize("closure", ["affine", "traction"])
def test_drained_paths(tmp_path, closure):
    out = run(tmp_path, "polygon", "--compare", "3-12", "--closure", closure, "--kappa", 0.3,
              "--phi", 20, "--confine", 0.1, "--end", 0.5)  # fmt: skip
    found = {
        loop["order"]: loop for loop in json.loads((out / "summary.json").read_text())["loops"]
    }
    (rows,) = re.findall(r"\| n \| affine.*?\n\n", section(TEXT, "## Drained paths"), re.DOTALL)
    lines = [
        [c.strip() for c in line.strip("|").split("|")] for line in rows.split("\n")[2:] if line
    ]
    assert len(lines) == len(found) == 10
    for order, *cells in lines:
        loop = found[int(order)]
        yielded, peak_E1, peak_s1, end = cells[:4] if closure == "affine" else cells[4:]
        assert says(yielded, loop["first_yield"]["E1"])
        if loop["peak"] is None:
            assert peak_E1 == peak_s1 == "-"
        else:
            assert says(peak_E1, loop["peak"]["E1"]) and says(peak_s1, loop["peak"]["s1"])
        status, E1 = end.split()
        assert status == loop["status"] and says(E1, loop["end"]["E1"])


def test_unstable_shares():
    """The table is that beside the figure; one loop again."""
    rows = tables(section(TEXT, "## Bifurcation domains"))[1]
    kept = pd.read_csv(DOCS / "figures" / "larger-domain-share.csv")
    kept = kept.set_index(["closure", "contacts", "kappa", "order"]).unstable_share.sort_index()
    assert len(rows) * 10 == len(kept)
    for row in rows:
        closure, contacts = row["closure, contacts"].split(", ")
        for order in range(3, 13):
            assert says(row[str(order)], kept[closure, contacts, float(row["κ"]), order])
    loop = PolygonOptions(3, kappa=0.1, phi_deg=20.0, closure="affine")
    fan = programmes_along(loop, "strain", 61, friction=True)
    found = unstable_share(fan, limits_along(fan))
    assert found == pytest.approx(kept["affine", "frictional", 0.1, 3], abs=1e-9)
    relaxed = kept["traction", "frictional"]
    stuck = kept["traction", "sticking"]
    for kappa, low, high in ((0.1, 0.66, 0.98), (0.3, 0.57, 0.77), (0.5, 0.39, 0.53)):
        assert np.ptp(relaxed[kappa][1:]) <= 0.0225
        assert low < stuck[kappa][2:].min() and stuck[kappa][2:].max() < high
    added = (kept["affine", "frictional"] - kept["affine", "sticking"]).unstack()
    assert added.loc[:, 5:].max().max() <= 0.07
    assert (kept.unstack("kappa").diff(axis=1).iloc[:, 1:] < 0).all().all()
    # Loops of 2 n grains, n odd, have the branch directions of n grains.
    for order in (3, 5):
        for key in (("affine", "sticking"), ("affine", "frictional")):
            both = kept[key].unstack()[[order, 2 * order]].to_numpy()
            np.testing.assert_allclose(both[:, 0], both[:, 1], rtol=0, atol=1e-9)


def test_drawn_losses_are_those_of_the_fan():
    """Of the diamond with friction, along every tenth programme."""
    kept = pd.read_csv(DOCS / "figures" / "larger-domains.csv")
    own = kept[(kept.closure == "affine") & (kept.contacts == "frictional") & (kept.order == 4)]
    loop = PolygonOptions(4, kappa=0.3, phi_deg=20.0, closure="affine")
    fan = programmes_along(loop, "strain", 61, friction=True)
    limits = limits_along(fan)
    angle = np.degrees(fan.programme)
    assert len(own) > 50
    for _, row in own.iloc[::10].iterrows():
        k = int(np.abs(angle - row.programme_deg).argmin())
        assert limits.found[row.kind][k]
        H = limits.states[row.kind].H[k, [0, 3]]
        np.testing.assert_allclose([row.E1, row.E2], H, rtol=0, atol=1e-8)


def limits_at_40(loop, law, closure):
    fan = Fan(Scene(loop, law), closure, "blocked", "strain", np.radians([40.0]), 0.95)
    limits = FanLimits.none(fan)
    limits.follow(fan, 0)
    return limits


@pytest.mark.slow
def test_losses_at_large_n():
    """Affine closure, strain at 40 degrees: the limits and the distance from them."""
    rows = tables(section(TEXT, "## Bifurcation domains"))[2]
    found = {}
    for row in rows:
        loop = regular_polygon(int(row["n"]))
        law = LinearFrictional(1.0, KAPPA)
        limits = limits_at_40(loop, law, "affine")
        for name in ("det_Ks", "det_K"):
            H = limits.states[f"{name}_zero"].H[0]
            found[name, row["n"]] = np.hypot(H[0], H[3])
            assert says(row[f"{name.replace('_', ' ')} = 0"], found[name, row["n"]])
    for row in rows[:-1]:
        off = found["det_Ks", row["n"]] - found["det_Ks", "48"]
        assert says(row["off the limit"], off)


@pytest.mark.slow
def test_losses_at_large_n_under_the_traction_closure():
    """Rows up to 65 grains again; the limit from the others, by the fit that stands there."""
    rows = tables(section(TEXT, "## Bifurcation domains"))[3]
    told = {int(row["n"]): float(row["det K = 0"]) for row in rows}
    for row in rows:
        assert says(row["off the limit"], told[int(row["n"])] - 0.327366)
        if int(row["n"]) <= 65:
            loop, law = regular_polygon(int(row["n"])), LinearFrictional(1.0, KAPPA)
            limits = limits_at_40(loop, law, "traction")
            for name in ("det_Ks", "det_K"):
                H = limits.states[f"{name}_zero"].H[0]
                assert says(row[f"{name.replace('_', ' ')} = 0"], np.hypot(H[0], H[3]))
    n = np.array([64.0, 128.0, 256.0, 512.0])
    powers = {"0.3273654": [n**0, np.log(n) / n**2, n**-2], "0.3273641": [n**0, n**-1.5, n**-2]}
    for limit, shapes in powers.items():
        fitted = np.linalg.lstsq(np.transpose(shapes), [told[int(k)] for k in n])[0][0]
        assert says(limit, fitted) and limit in TEXT and abs(fitted - 0.327366) < 2e-6


def test_ensembles_are_those_of_the_table_beside_the_figure():
    (rows,) = tables(section(TEXT, "## Is a loop of a packing a typical one?"))
    found = pd.read_csv(DOCS / "figures" / "larger-ensembles.csv")
    columns = {
        "n": "order",
        "real loops": "real",
        "real loops with a match": "matched",
        "median eigenvalue, real": "real_lambda",
        "median eigenvalue, random": "random_lambda",
        "mean rank": "rank",
        "share of ranks below .05": "below_5",
        "share convex, real": "real_convex",
        "share convex, random": "random_convex",
    }
    assert len(rows) == len(found)
    for row, (_, value) in zip(rows, found.iterrows(), strict=True):
        assert all(says(row[name], value[column]) for name, column in columns.items())
        low, high = row["its 95 % interval"].split(" to ")
        assert says(low, value.rank_low) and says(high, value.rank_high)


def test_figures_exist():
    names = re.findall(r"figures/(larger-[\w-]+\.png)", TEXT)
    assert len(names) == 10 and all((DOCS / "figures" / name).exists() for name in names)
