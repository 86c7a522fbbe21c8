"""Domains of loops of any order: the fan against single paths, exact thresholds and slopes."""

import json
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from loops import GrainGraph, InputError, LinearFrictional, Scene, contact_state
from patterns import opposite_gap, regular_polygon
from stability import Stage, follow, restrict, symmetric_part
from stability.paths.domain import (
    CONTROLS,
    SPECTRAL,
    STRESS_REACH,
    Fan,
    FanLimits,
    stability_measures,
)
from studies.domain import (
    LoopDomainParameters,
    limit_rows,
    limits_along,
    loop_fan,
    programmes_along,
    run_domain,
    unstable_share,
)
from studies.examples.larger_loops import rolling_threshold
from studies.paths.options import PolygonOptions
from tests.command import refusal, run
from tests.oracles.diamond import DiamondParameters as Case
from tests.oracles.diamond_domain import first_losses

KAPPA = 0.3
KIND = {("det_Ks_zero", "diagonal"): "det_Ks_zero", ("det_K_zero", "diagonal"): "det_K_zero",
        ("det_Ks_zero", "symmetric"): "cone_opening", ("yield", ""): "yield"}  # fmt: skip


def fan_of(order, closure, control, angles, mu=np.inf):
    loop = regular_polygon(order)
    law = LinearFrictional(1.0, KAPPA, mu)
    fan = Fan(Scene(loop, law), closure, "blocked", control, np.radians(angles), 0.95)
    return fan, limits_of(fan), law, loop


def limits_of(fan):
    limits = FanLimits.none(fan)
    for row in range(len(fan.programme)):
        limits.follow(fan, row)
    return limits


def path_of(loop, law, control, angle, end=0.95, closure="affine", **options):
    stage = Stage(CONTROLS[control](np.cos(angle), np.sin(angle)), "parameter", end)
    return follow(
        Scene(loop, law),
        stage,
        subspace=("diagonal", "symmetric"),
        closure=closure,
        **options,
    )


def by_follow(loop, law, closure, control, angle):
    path, first = path_of(loop, law, control, angle, closure=closure), {}
    for event in path.events:
        kind = KIND.get((event.kind, event.subspace))
        if kind:
            first.setdefault(kind, np.array(event.H))
    if path.status == "control_limit":
        # Sliding is reached there, and no regimes agree with the load.
        first.setdefault("yield", path.H[-1])
    return first


@pytest.mark.parametrize("mu", [np.inf, 0.364])
@pytest.mark.parametrize("closure", ["affine", "traction"])
@pytest.mark.parametrize(
    "order", [4, *(pytest.param(n, marks=pytest.mark.slow) for n in (3, 5, 6, 7, 8, 9, 10, 11, 12))]
)
def test_limits_of_the_fan_are_those_of_single_paths(order, closure, mu):
    angles = (33.0, 57.0)
    _, limits, law, loop = fan_of(order, closure, "strain", angles, mu)
    compared = 0
    for row, angle in enumerate(np.radians(angles)):
        wanted = by_follow(loop, law, closure, "strain", angle)
        for kind in (*SPECTRAL, "yield"):
            if limits.found[kind][row]:
                np.testing.assert_allclose(
                    limits.states[kind].H[row], wanted[kind], rtol=0, atol=1e-12
                )
                compared += 1
    assert compared >= 1 or not any(limits.found[kind].any() for kind in SPECTRAL)


OTHER_LOOPS = [
    {"order": 4, "spins": "affine"},
    {"order": 5, "spins": "affine", "closure": "traction", "phi_deg": 20.0},
    {"order": 5, "spins": "free", "closure": "affine"},
    {"order": 6, "spins": "free", "closure": "traction", "phi_deg": 20.0},
    {"order": 4, "kappa": 0.82, "contact_law": "hertz", "closure": "traction", "phi_deg": 20.0},
    {"order": 12, "kappa": 0.82, "contact_law": "hertz"},
    {"order": 5, "spins": "free", "kappa": 0.82, "contact_law": "hertz", "phi_deg": 20.0},
    {"order": 4, "spins": "free", "rolling": 0.05, "phi_deg": 20.0},
    {"order": 5, "spins": "free", "rolling": 0.05, "closure": "traction"},
    {"order": 12, "spins": "free", "rolling": 0.05},
]  # fmt: skip


def held_to_single_paths(loop, control, directions=3):
    """Strain and stress of the first loss of every kind beside those of `follow`; their number."""
    fan = programmes_along(loop, control, directions, friction=loop.phi_deg < 90.0)
    limits = limits_along(fan)
    compared = 0
    for row, angle in enumerate(fan.programme):
        end = 0.95 * (1.0 if control == "strain" else STRESS_REACH)
        path = path_of(loop.graph(), loop.law(), control, angle, end, closure=loop.closure,
                       spins=loop.spins)  # fmt: skip
        begins = stability_measures(path.A[0])
        for (event, subspace), kind in KIND.items():
            if kind not in SPECTRAL or not limits.found[kind][row]:
                continue
            H = limits.states[kind].H[row]
            if (H == path.H[0]).all():
                # Lost by the first tangent, or nowhere to go from it: no event says so.
                assert not begins[SPECTRAL.index(kind)] > 1e-12
            else:
                first = next(e for e in path.events if (e.kind, e.subspace) == (event, subspace))
                np.testing.assert_allclose(H, path.H[first.index], rtol=0, atol=1e-12)
                told = limit_rows(fan, limits, kind, {}).set_index("programme_deg")
                s = told.loc[np.degrees(angle), ["s1", "s2"]].to_numpy(float)
                np.testing.assert_allclose(s, path.P[first.index, [0, 3]], rtol=0, atol=1e-12)
            compared += 1
    return compared


@pytest.mark.slow
@pytest.mark.parametrize("control", ["strain", "stress"])
@pytest.mark.parametrize("words", OTHER_LOOPS, ids=lambda w: "-".join(map(str, w.values())))
def test_other_spins_and_laws_against_single_paths(words, control):
    loop = PolygonOptions(**{"kappa": KAPPA, "phi_deg": 90.0} | words)
    assert held_to_single_paths(loop, control) >= 1


@pytest.mark.slow
@pytest.mark.parametrize(("order", "closure"), [(5, "affine"), (5, "traction"), (12, "affine")])
def test_stress_programmes_against_single_paths(order, closure):
    fan, limits, law, loop = fan_of(order, closure, "stress", (33.0,))
    wanted = by_follow(loop, law, closure, "stress", fan.programme[0])
    for kind in SPECTRAL:
        assert limits.found[kind][0]
        np.testing.assert_allclose(limits.states[kind].H[0], wanted[kind], rtol=0, atol=1e-12)


def yield_under_stress(order, angle):
    """Row of a path of proportional stress in which a contact first comes to its strength."""
    loop, law = regular_polygon(order), LinearFrictional(1.0, KAPPA, 0.364)
    path = path_of(loop, law, "stress", np.radians(angle), 5.0, closure="traction")
    first = next(event for event in path.events if event.kind in ("yield", "control_limit"))
    at = first.index
    found = SimpleNamespace(
        x=path.x[at], normal_force=path.normal_force[at], shear_force=path.shear_force[at],
        P=path.P[at],
    )  # fmt: skip
    return found, loop.reference_branches


def test_contacts_of_even_loops_carry_their_own_force():
    """Traction, stress programme, even order: f = -P m alone; N of a contact has a closed form."""
    from scipy.integrate import quad

    path, d0 = yield_under_stress(6, 30.0)
    d, N, T = np.roll(path.x, -1, axis=0) - path.x, path.normal_force, path.shear_force
    for c in range(6):
        # The force turns by beta from the branch: N sin^k tan = k int sin^k from the first beta.
        beta = np.arctan2(abs(T[c]), N[c])
        turned = np.arctan2(*d[c][::-1])
        start = abs(np.mod(turned - np.arctan2(*d0[c][::-1]) + np.pi, 2 * np.pi) - np.pi)
        if beta < 1e-9:
            continue
        integral = quad(lambda b: np.sin(b) ** KAPPA, beta - start, beta, epsabs=1e-14)[0]
        wanted = KAPPA * integral / (np.sin(beta) ** KAPPA * np.tan(beta))
        assert N[c] == pytest.approx(wanted, abs=1e-11)


@pytest.mark.parametrize(
    ("order", "angle"),
    [(8, 40.0), *(pytest.param(n, 40.0, marks=pytest.mark.slow) for n in (6, 10, 12, 64))],
)
def test_even_loops_lose_det_K_with_their_first_contact(order, angle):
    """Traction: at `N/l = kt` of the first branch off the axes, which has `l = l0/(1 + kappa)`."""
    fan, limits, *_ = fan_of(order, "traction", "strain", (angle,))
    assert limits.found["det_K_zero"][0]
    d0, x = fan.loop.graph.reference_branches, limits.states["det_K_zero"].x[0]
    length = np.hypot(*(np.roll(x, -1, axis=0) - x).T)
    off_axes = (np.abs(d0) > 1e-9).all(axis=1)
    assert length[off_axes].min() == pytest.approx(1.0 / (1.0 + KAPPA), rel=0, abs=3e-13)


def test_even_loops_keep_det_K_on_straight_programmes_of_stress():
    """Under a force of one direction a sticking contact never comes to `N/l = kt`."""
    _, limits, *_ = fan_of(8, "traction", "stress", (25.0, 35.0, 60.0))
    assert not limits.found["det_K_zero"].any()


def test_measures_are_the_smallest_eigenvalues():
    rng = np.random.default_rng(3)
    for A in rng.normal(size=(40, 4, 4)):
        whole, plane = restrict(A, "symmetric"), restrict(A, "diagonal")
        sizes = np.linalg.norm(whole), np.linalg.norm(plane), np.linalg.norm(plane)
        Ks = (np.linalg.eigvalsh(symmetric_part(K))[0] for K in (whole, plane))
        wanted = *Ks, np.linalg.eigvals(plane).real.min()
        np.testing.assert_allclose(stability_measures(A) * sizes, wanted, atol=1e-13)


def affine_fan(overlap, mu, angles, T=0.0, **units):
    """Of six grains of radius (1 + overlap) / 2 whose branches have length 1."""
    loop, law = regular_polygon(6), LinearFrictional(1.0, KAPPA, mu)
    loop = GrainGraph(x=loop.x, radii=(1.0 + overlap) * loop.radii, contacts=loop.contacts)
    loop = loop.replace(
        normal_force=law.normal_force(contact_state(loop)), shear_force=np.zeros(6) + T
    )
    return Fan(Scene(loop, law), "affine", "blocked", "strain", np.radians(angles), 0.3)


@pytest.mark.parametrize("overlap", [0.0, 1e-13, 1e-3])
def test_contacts_that_just_touch_part_at_once(overlap):
    """Others part where the stretch of their branch, `-H11` of its length 1, is their overlap."""
    limits = limits_of(affine_fan(overlap, np.inf, [-135.0]))
    wanted = -overlap if overlap > 1e-11 else 0.0
    assert limits.found["opening"][0]
    assert limits.states["opening"].H[0, 0] == pytest.approx(wanted, rel=1e-11, abs=0)


def test_sticking_contacts_of_relaxed_loops_part_with_their_shear_force():
    """Of a triangle, which is affine: where `|d| = |d0|` of a branch, without friction's limit."""
    angles = np.degrees(loop_fan(regular_polygon(3).reference_branches, 31)[-1:])
    found = [fan_of(3, closure, "strain", angles)[1] for closure in ("affine", "traction")]
    for limits in found:
        assert limits.found["opening"].all()
    np.testing.assert_allclose(
        found[0].states["opening"].H, found[1].states["opening"].H, rtol=0, atol=1e-12
    )


@pytest.mark.slow
def test_free_spins_are_unstable_from_the_first_load():
    loop = PolygonOptions(5, kappa=KAPPA, closure="traction", spins="free", phi_deg=90.0)
    limits = limits_along(programmes_along(loop, "strain", 3, friction=False))
    assert limits.found["cone_opening"].all()
    assert np.abs(limits.states["cone_opening"].H).max() < 1e-6


@pytest.mark.slow
def test_rolling_springs_reach_the_contacts(tmp_path, capsys):
    """Free spins: the isotropic loss is that of both springs in series."""
    asked = "domain --directions 3 --order 6 --closure traction --spins free --rolling 0.05"
    more = ("--phi", 90, "--kappa", 0.3, "--json", "--out", tmp_path / "out")
    assert run(*asked.split(), *more) == 0
    summary = json.loads(capsys.readouterr().out)
    assert summary["provenance"]["configuration"]["loops"][0]["rolling"] == 0.05
    table = pd.read_parquet(tmp_path / "out" / "domain.parquet")
    (E1,) = table[(table.kind == "det_Ks_zero") & (table.programme_deg.round(9) == 45.0)].E1
    assert E1 == pytest.approx(rolling_threshold(6, KAPPA, 0.05), abs=1e-12)


@pytest.mark.slow
def test_study_of_two_orders(tmp_path):
    loops = tuple(PolygonOptions(n, phi_deg=20.0, closure="affine") for n in (4, 6))
    summary = run_domain(LoopDomainParameters(loops, directions=5), tmp_path / "out")
    names = {path.name for path in (tmp_path / "out").iterdir()}
    assert {"domain.parquet", "domain.png", "summary.json"} <= names
    assert [row["order"] for row in summary["loops"]] == [4, 4, 6, 6]
    assert opposite_gap(regular_polygon(4)) > 0


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--order", "2"], "--order: got 2, expected a whole number from 3 to 60"),
        (["--compare", "3-99"], "--compare: got 61, expected a whole number from 3 to 60 for each"),
        (["--compare", "2-4"], "--compare: got 2, expected a whole number from 3 to 60 for each"),
        (["--radii", "1,1"], "number of --radii: got 2, expected a whole number from 3 to 60"),
        (["--order", "400"], "--order: got 400, expected a whole number from 3 to 60"),
        (["--order", "5", "--kappa", "0"], "--kappa: got 0, expected positive ratios"),
        (["--order", "5", "--compare", "3-4"], "--order and --compare"),
        (
            ["--order", "5", "--rolling", "0.1"],
            "--rolling: got spins blocked, expected --spins",
        ),
        (["--order", "5", "--law", "hertz", "--kappa", "0.3"], "--kappa: got 0.29999999999999999"),
        (["--rolling", "0.1"], "--rolling, --programmes: got given without a loop"),
        (["--order", "5", "--closure", "packing"], "--closure: got 'packing'"),
        (["--order", "5", "--alpha0", "40"], "--alpha0: got given with --order"),
        (["--closure", "traction"], "--order, --compare, --radii or --snapshot with them"),
    ],
)
def test_bad_input_gives_one_line(tmp_path, capsys, arguments, message):
    assert message in refusal(capsys, "domain", "--out", tmp_path / "out", *arguments)


def test_loop_of_a_snapshot(tmp_path, capsys, undrawn):
    from patterns import sample_path

    asked = ("domain", "--out", tmp_path / "out", "--directions", 3, "--closure", "traction")
    asked += ("--snapshot", sample_path(), "--json", "--loop")
    assert run(*asked, 5) == 0
    (found,) = json.loads(capsys.readouterr().out)["loops"]
    # The sample's contacts, whatever the options' defaults are.
    assert found["limits"] and found["kappa"] == pytest.approx(0.5, abs=1e-12)
    assert found["phi_deg"] == pytest.approx(np.degrees(np.arctan(0.5)), abs=1e-12)
    assert run(*asked, 100_000) == 2


def test_an_unknown_control_is_refused():
    with pytest.raises(InputError, match="--programmes"):
        LoopDomainParameters((PolygonOptions(5),), control="force")


def test_restriction_has_the_plane_first():
    assert restrict(np.diag([1.0, 2, 3, 4]), "symmetric")[1, 1] == 4.0


def first_yield_of_even_loops(directions, ratio, kappa, phi):
    """Least `p1` over branch directions: force `(p1 cos, p2 sin)`, yield where it turns by phi."""
    from scipy.integrate import quad

    found = []
    for theta in directions:
        force = np.array([np.cos(theta), ratio * np.sin(theta)])
        first = abs(np.arctan2(force[1], force[0]) - theta)
        turned = quad(lambda b: np.sin(b) ** kappa, first, phi, epsabs=1e-14)[0]
        carried = kappa * turned / np.sin(phi) ** (1.0 + kappa)
        found.append(max(carried, 0.0) / np.hypot(*force))
    return min(found)


@pytest.mark.parametrize("order", [6, pytest.param(12, marks=pytest.mark.slow)])
def test_first_yield_of_even_loops_under_stress_is_closed(order):
    phi = np.arctan(0.364)
    path, d0 = yield_under_stress(order, 35.0)
    p1 = path.P[0] / (2.0 * np.tan(np.pi / order))
    theta = np.arctan(np.abs(d0[:, 1] / d0[:, 0]))
    wanted = first_yield_of_even_loops(theta, np.tan(np.radians(35.0)), KAPPA, phi)
    assert p1 == pytest.approx(wanted, abs=1e-11)


def exact_share_of_the_diamond(kappa, phi, directions=20001):
    """Closed losses of the square diamond on a fine fan; its branches open at `|d| = |d0|`."""
    case = Case(np.pi / 4, kappa, phi, 0.0)
    losses = first_losses(case, directions, friction=phi < np.pi / 2)
    b, line = losses.programme, losses.line
    # Distance from the virgin corner in units of strain: X = X0 (1 - E).
    moved = (losses.det_Ks_zero - line.start)[:, None] * line.direction * np.sqrt(2.0)
    lost = np.hypot(*moved.T)
    c, s = np.cos(b), np.sin(b)
    end = np.minimum(2.0 * (c + s), 0.95)
    stable = np.fmin(lost, end)
    return 1.0 - np.trapezoid(stable**2, b) / np.trapezoid(end**2, b)


@pytest.mark.parametrize(
    ("phi", "closure"),
    [(20.0, "affine"), pytest.param(90.0, "traction", marks=pytest.mark.slow)],
)
def test_unstable_share_of_the_diamond_converges_to_the_closed_one(phi, closure):
    exact = exact_share_of_the_diamond(KAPPA, np.radians(phi))
    loop = PolygonOptions(4, kappa=KAPPA, phi_deg=phi, closure=closure)
    errors = []
    for directions in (11, 41):
        fan = programmes_along(loop, "strain", directions, friction=phi < 90.0)
        errors.append(abs(unstable_share(fan, limits_along(fan)) - exact))
    assert 0.2 < exact < 0.99 and errors[1] < 0.5 * errors[0] and errors[1] < 0.01
