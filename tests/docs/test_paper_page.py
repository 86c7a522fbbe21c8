"""`docs/paper.md`: every number of it, computed again."""

import json
import re

import numpy as np
import pandas as pd
import pytest

import grainloops as gl
from loops import LinearFrictional, Regime, Scene, boundary_of
from patterns import diamond
from stability import Stage, bromwich_margin, follow, programmes
from studies.commands.loops import diamond_command
from studies.examples import printed_rule
from studies.paths.options import TABLES
from tests.docs.pages import DOCS, of_size, page, says, section, tables, unsaid
from tests.golden.answers import run
from tests.golden.test_golden import stored
from tests.oracles.diamond import (
    TABLE_1,
    PrintedRule,
    isotropic_tangent,
    work_compress_then_shear,
    work_shear_then_compress,
)
from tests.oracles.paper_contact_equations import contact_residuals
from tests.oracles.paper_tangent_equations import appendix_one, tangent_residuals

TEXT = page("paper")
TITLES = {
    1: "## Table 1: α0 = 45°, s0 = 0.3, κ = 0.2, φg = 5°",
    2: "## Table 2: α0 = 35°, s0 = 0.35, κ = 0.24, φg = 14°",
}
B = {
    1: (0.40973434897033423289, 0.164934999828385506, 0.25400990008305293503),
    2: (0.41619122318013548716, -0.072382919123994869769, 0.31215593602737202138),
}


def equation_numbers(text):
    """Every number named, ranges filled: (14), (17)-(20) are 14, 17, 18, 19, 20."""
    named = set()
    for first, last in re.findall(r"\((\d+)[a-z]?\)(?:–\((\d+)\))?", text):
        named |= set(range(int(first), int(last or first) + 1))
    return named


def test_every_equation_holds():
    found = contact_residuals() | tangent_residuals()
    (rows,) = tables(section(TEXT, "## Equations"))
    assert len(rows) == len(found)
    for row, (key, residual) in zip(rows, found.items(), strict=True):
        assert of_size(residual, float(row["largest difference"])), key
        assert residual < 1e-11
        assert equation_numbers(row["equation"]) >= {int(n) for n in re.findall(r"\d+", key)}
    assert set(range(1, 58)) <= equation_numbers(TEXT)


def test_appendix_one_is_a_congruence_and_no_similarity():
    found = appendix_one()
    assert found["signs_differ"] == 0 and "differ on 0 of 1,000" in TEXT
    assert found["gap_at_45_degrees"] < 1e-12
    assert f"{found['largest_relative_gap']:.6g} times the larger one" in TEXT


@pytest.mark.parametrize("table", TITLES)
def test_states_and_checks_of_a_table(table):
    """Against the stored answers, which `tests/golden` compares with those of today."""
    summary = stored(f"diamond-table{table}")["summary"]
    states, checks = tables(section(TEXT, TITLES[table]))
    for row in states:
        key, _, sliding = row[""].replace("`", "").partition(", ")
        for point in "IAB":
            if row[point]:
                state = summary["states"][point]
                value = (state["beyond"] if sliding else state)[key]
                # Ten digits of what vanishes are rounding: written as 0.
                value = 0.0 if abs(value) < 1e-14 else value
                assert says(row[point], value), (key, point)
    events = ", ".join(f"`{e['kind']}` {e['E1']:.10g}" for e in summary["events"])
    assert events in " ".join(section(TEXT, TITLES[table]).split())
    found = summary["verification"]
    at_B = [summary["states"]["B"][key] for key in ("E1", "E2", "s1")]
    measured = [
        max(abs(a - b) for a, b in zip(at_B, B[table], strict=True)),
        found["det_K_zero_by_root_difference"],
        found["slope_at_A"]["difference"],
        found["generic_vs_closed_form_max_relative"],
        found["det_K_max_difference"],
        found["energy_balance_max_relative"],
    ]
    for row, value in zip(checks, measured, strict=False):
        assert of_size(value, float(row["measured"])), row
    assert says(checks[-1]["measured"], found["slope_at_A"]["closed_form"])


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """Summary and path of both tables, with opposite grains ignored and added."""
    found = {}
    for table in TITLES:
        for touch in ("ignore", "add"):
            folder = tmp_path_factory.mktemp(f"{touch}{table}")
            out = run(folder, "diamond", "--table", table, "--contact-on-touch", touch)
            summary = json.loads((out / "summary.json").read_text())
            found[table, touch] = summary, pd.read_parquet(out / "path.parquet")
    return found


def path_values(summary, path):
    """What the text quotes of a path: slopes, gaps of eigenvalues, loading, cone."""
    drained, slides = path.stage == "drained", path.regime == "sliding"
    at_B = int(np.flatnonzero(slides)[0]) - 1
    slope = path.det_K / path.K22
    K = path[["eigenvalue_1_real", "eigenvalue_2_real"]].to_numpy()
    gap = np.abs(np.sort(K, axis=1) - path[["lambda_1", "lambda_2"]].to_numpy()).max(axis=1)
    states = summary["states"]
    return {
        "slopes": [slope[at_B], slope[at_B + 1], slope[drained].max()],
        "gaps": [gap[~slides].max(), gap[slides].max()],
        "loading": [path.w2_loading[~drained].min(), path.w2_loading[drained].max()],
        "opening": [states[p]["cone"]["opening_deg"] for p in "AB"]
        + [states["B"]["beyond"]["cone"]["opening_deg"]],
        "states": [states[p][k] for p in "IAB" for k in ("E1", "s1", "s2", "det_K", "alpha_deg")],
        "beyond": [states["B"]["beyond"][k] for k in ("det_K", "det_Ks")],
        "slope_at_A": [summary["verification"]["slope_at_A"]["closed_form"]],
    }


def added_values(summary, path):
    drained = path.stage == "drained"
    added = summary["added_contact"]
    intervals = np.ravel(added["definite_added"] + added["definite_ignored"]).tolist()
    at_A = int(np.flatnonzero(drained)[0]) - 1
    s1, E1 = path.s1.to_numpy(), path.E1.to_numpy()
    least = path.lambda_1[drained].min()
    return [*intervals, *added["touching_strains"], least, s1[at_A], s1[-1], E1[-1]]


def cone_opening(K):
    """Angle of directions with negative work of a K of one negative eigenvalue, degrees."""
    low, high = np.linalg.eigvalsh(0.5 * (K + K.T))
    return 2.0 * np.degrees(np.arctan(np.sqrt(-low / high)))


def beyond_yield(table, law):
    """What Figs. 9 to 12 show beyond B to the end of the command's path, by a rule of sliding."""
    loop, graph = TABLES[table], diamond(TABLES[table].alpha0)
    end = {1: 0.6, 2: B[2][0] + 0.15}[table]
    box = boundary_of(graph, volume=2.0 * np.sin(2.0 * loop.alpha0))
    stages = [Stage(programmes.isotropic_strain(), "H11", loop.confinement),
              Stage(programmes.drained_biaxial(), "H11", end)]  # fmt: skip
    scene = Scene(graph, law(1.0, loop.kappa, loop.mu), box)
    path = follow(scene, stages, closure="affine", rows=80)
    assert path.status == "finished"
    K = path.A[path.regime[:, 0] == Regime.SLIDING][:, [0, 3]][:, :, [0, 3]]
    Ks = 0.5 * (K + np.swapaxes(K, 1, 2))
    gap = np.sort(np.linalg.eigvals(K).real, axis=1) - np.linalg.eigvalsh(Ks)
    E = np.stack([np.ones(len(K)), -K[:, 1, 0] / K[:, 1, 1]], axis=1)
    s = np.einsum("kij,kj->ki", K, E)
    work = (s * E).sum(axis=1) / np.linalg.norm(s, axis=1) / np.linalg.norm(E, axis=1)
    return {
        "det_K": np.linalg.det(K),
        "det_Ks": np.linalg.det(Ks),
        "gap": [np.abs(gap).max()],
        "cone": np.array([cone_opening(each) for each in K]),
        "loading": [work.max()],
    }


@pytest.mark.slow
def test_the_cone_follows_the_determinant_but_beyond_B_of_table_2():
    (rows,) = tables(section(TEXT, "### (8c)"))
    claim = section(TEXT, "### Fig. 12")
    for table in TITLES:
        found = [beyond_yield(table, law) for law in (LinearFrictional, PrintedRule)]
        for each in found:
            assert np.all(np.diff(np.abs(each["det_K"])) < 0.0)
            assert each["cone"][-1] > each["cone"][0] if table == 2 else each["cone"][-1] < 60.0
        ends = [abs(found[0]["det_K"][i]) for i in (0, -1)] + [found[0]["cone"][i] for i in (0, -1)]
        assert all(any(says(n, v) for n in re.findall(r"[\d.]*\d", claim)) for v in ends)
    for row, key in zip(rows, found[0], strict=True):
        for title, each in zip(("Coulomb's law", "(8c) as printed"), found, strict=True):
            quoted = re.findall(r"-?[\d.]*\d", row[title])
            ends = [each[key][0], each[key][-1]][-len(quoted):]  # fmt: skip
            assert all(says(n, v) for n, v in zip(quoted, ends, strict=True)), (key, title)


def slopes_of_s0():
    """Slope (33) at A of Table 2, where 0.35 is s1, s2 or their mean."""
    loop = TABLES[2]
    t0 = np.tan(loop.alpha0)
    K = [isotropic_tangent(E, loop.alpha0, loop.kappa)
         for E in (0.35 * t0, 0.35 / t0, 0.7 / (t0 + 1.0 / t0))]  # fmt: skip
    return [np.linalg.det(each) / each[1, 1] for each in K]


def cones_of_appendix_one():
    """Openings at A of Table 2 in K^ and in K~ = A^-1 K^ B^-1."""
    loop = TABLES[2]
    t0 = np.tan(loop.alpha0)
    K = isotropic_tangent(loop.confinement, loop.alpha0, loop.kappa)
    return [cone_opening(K), cone_opening(np.diag([t0, 1.0]) @ K @ np.diag([1.0, 1.0 / t0]))]


def test_readings_of_s0_and_cones_of_appendix_one():
    places = ("### Table 2 is isotropic in strain, not in stress", "### Appendix I")
    for title, values in zip(places, (slopes_of_s0(), cones_of_appendix_one()), strict=True):
        quoted = re.findall(r"-?\d+\.\d{4,}", section(TEXT, title))
        assert all(any(says(n, value) for n in quoted) for value in values), title


def test_bromwichs_inequality_is_not_strict():
    """The two matrices of the page: nonsymmetric, with the real part of an eigenvalue of Ks."""
    for K in ([[1, 1], [-1, 1]], [[-1, 0, 0], [0, 2, 1], [0, 0, 2]]):
        assert str(K[0]) in section(TEXT, "### Bromwich")
        assert bromwich_margin(np.array(K, float)) == 0.0


def test_loops_become_fewer_from_four_grains_on():
    files = ("grains_biaxial.csv.gz", "contacts_biaxial.csv.gz")
    sample = gl.read_snapshot(*(gl.sample_path(name) for name in files))
    orders = gl.loop_table(sample).order.value_counts()
    said = section(TEXT, "### Other loops")
    names = ("loops of three grains", "of four", "of five", "of six")
    for order, name in zip((3, 4, 5, 6), names, strict=True):
        assert f"{orders[order]} {name}" in " ".join(said.split())
    assert orders[3] < orders[4] > orders[5] > orders[6] > orders[7]


def test_thresholds_of_other_loops():
    (rows,) = tables(section(TEXT, "### Other loops"))
    kappa = 0.2
    late, early = (1.0 + kappa) / (2.0 + kappa), kappa / (1.0 + kappa)
    expected = [(late, late, 0.5), (early, early, early), (late, early, 0.0)]
    for row, values in zip(rows, expected, strict=True):
        cells = list(row.values())[1:]
        assert all(says(n, v) for n, v in zip(cells, values, strict=True)), row


def test_claims_lead_to_sections_of_the_page():
    (rows,) = tables(section(TEXT, "## The paper's claims"))
    slugs = {re.sub(r"[^\w -]", "", line).strip().lower().replace(" ", "-")
             for line in re.findall(r"^#+ (.*)", TEXT, re.M)}  # fmt: skip
    assert len(rows) == 16
    for row in rows:
        links = re.findall(r"\(#([\w-]+)\)", row["where"])
        assert links and set(links) <= slugs, row


@pytest.mark.slow
def test_every_number_of_the_page_is_computed(runs):
    values = [appendix_one()["largest_relative_gap"], np.tan(np.radians(14)), 8.0, 2016.0]
    # The reference's year and volume; angles of the tables.
    values += slopes_of_s0() + cones_of_appendix_one() + [1.2 / 2.2, 0.2 / 1.2, B[2][0] + 0.15]
    for table, law in ((1, LinearFrictional), (2, LinearFrictional), (2, PrintedRule)):
        beyond = np.concatenate([np.ravel(each) for each in beyond_yield(table, law).values()])
        values += [*beyond, *np.abs(beyond)]
    values += [-1 / np.tan(np.radians(70))]
    for (table, touch), (summary, path) in runs.items():
        if touch == "ignore":
            for found in path_values(summary, path).values():
                values += found
            for state in summary["states"].values():
                values += [v for v in state.values() if isinstance(v, float)]
            values += [event["E1"] for event in summary["events"]]
        else:
            values += added_values(summary, path)
        assert table in TITLES
    for row in printed_rule.compare_rules()[1]:
        values += [row["shear_ratio"], row["s1"]]
    D, kappa, turn = TABLE_1.confinement, TABLE_1.kappa, np.pi / 4
    routes = [w(1.0, turn, D, 1.0, kappa) for w in
              (work_shear_then_compress, work_compress_then_shear)]  # fmt: skip
    values += [float(work) for work in routes] + [float(routes[0] / routes[1])]
    assert unsaid(TEXT, values) == []


@pytest.mark.slow
def test_what_the_page_states_as_facts(runs):
    for table in TITLES:
        found = path_values(*runs[table, "ignore"])
        before, after, largest = found["slopes"]
        assert largest < 0.0 and after < before
        assert found["loading"][0] > 0.0 > found["loading"][1]
        assert found["opening"][2] > found["opening"][1]
        *_, least, s1_A, s1_end, _ = added_values(*runs[table, "add"])
        assert least > 0.0 and s1_end > s1_A
    one, two = (path_values(*runs[k, "ignore"])["slope_at_A"][0] for k in TITLES)
    assert one < two < 0.0


def test_figures_of_the_page_exist_and_are_small():
    names = re.findall(r"figures/(paper-[\w-]+\.png)", TEXT)
    assert len(names) == 12
    assert sum((DOCS / "figures" / name).stat().st_size for name in names) < 1_500_000


def test_a_number_that_nothing_computes_is_seen():
    assert unsaid("reaches 1.18643 at 0.1", [1.18643]) == []
    assert unsaid("reaches 1.18653 at 0.1", [1.18643]) == ["1.18653"]


def test_the_help_names_the_file_of_each_figure():
    """`grainloops diamond --help` against the pictures on the page."""
    said = " ".join(diamond_command.__doc__.split()).partition("with --table 1")[2]
    for number, part in zip((1, 2), said.split("with --table 2"), strict=True):
        for name, figure in re.findall(r"(\w+) \((?:Fig\. )?(\d+)\)", part):
            shown = section(page("paper"), f"### Fig. {figure}")
            assert f"figures/paper-table{number}-{name.replace('_', '-')}.png" in shown
    figures = [int(number) for number in re.findall(r"\((?:Fig\. )?(\d+)\)", said)]
    assert figures == [4, 6, 7, 8, 9, 10, 11, 12]
    assert figures == [int(n) for n in re.findall(r"^### Fig\. (\d+)", page("paper"), re.M)]
