"""`docs/theory`: its equations name code that exists, code cites equations that exist, and the
numbers and closed forms that it states are computed again.
"""

import re
import subprocess
import sys

import numpy as np
import pytest

from loops import LinearFrictional, affine_tangent, traction_tangent
from patterns import regular_polygon
from stability import restrict, symmetric_spectrum
from tests.docs.pages import DOCS, page, says, section, tables, unsaid
from tests.docs.test_citations import PAGES, SOURCES
from tests.docs.test_paper_page import equation_numbers
from tests.oracles.diamond import (
    TABLE_1,
    TABLE_2,
    isotropic_strain_of_stress,
    opposite_contact_strain,
    stress_of_isotropic_strain,
)
from tests.oracles.drained import drained_path, printed_states_after_turn
from tests.oracles.stability_fraction import imhof_fraction

sys.path.insert(0, str(DOCS / "site"))
try:
    from numbered import CITED, NUMBER, equations, named, shown
finally:
    sys.path.pop(0)

EQUATIONS = {number: said for _, number, said in equations()}
FACES = sorted(
    face for path in PAGES for face in re.findall(r"^```{names} (\S+)", path.read_text(), re.M)
)


def test_numbers_run_from_one_on_every_page():
    order = re.findall(r"^([\w-]+)$", page("theory/index"), re.MULTILINE)
    for k, name in enumerate(order, start=1):
        text = page(f"theory/{name}")
        assert text.startswith(f"# {k}. ")
        found = re.findall(r"^```{equation} (.*)$", text, re.MULTILINE)
        assert found == [f"{k}.{n}" for n in range(1, len(found) + 1)]
    assert len(EQUATIONS) > 90


def test_equations_name_code_that_the_reference_shows():
    in_reference = {f"{face}.{name}" for face in FACES for name, _ in shown(face)}
    in_reference |= set(re.findall(r"autofunction:: (\S+)", page("rooms/behind")))
    for number, said in EQUATIONS.items():
        for path in said.get("code", ()):
            assert callable(named(path)), (number, path)
            assert {path, path.rpartition(".")[0]} & in_reference, path
    # Steps of a derivation, and statements on any code.
    unnamed = {number for number, said in EQUATIONS.items() if "code" not in said}
    assert unnamed == {"2.7", "3.2", "5.4", "5.23", "5.24", "5.25", "8.3", "11.9"}


def test_citations_of_equations_lead_somewhere():
    cited = []
    for source in SOURCES:
        text = " ".join(source.read_text().split())
        cited += [number for found in CITED.findall(text) for number in NUMBER.findall(found)]
    for path in PAGES:
        cited += re.findall(r"{eq}`eq-([\d.]+)`", path.read_text())
    assert len(cited) > 120 and set(cited) <= set(EQUATIONS)


def test_every_equation_of_the_paper_is_one_hop_away():
    (rows,) = tables(section(page("notation"), "## The paper's equations"))
    for row in rows:
        first, *others = re.findall(r"eq-([\d.]+)", row["theory"])
        theirs = equation_numbers("; ".join(
            part for n in (first, *others) for part in EQUATIONS[n].get("paper", ())
        ))  # fmt: skip
        assert equation_numbers(row["paper"]) <= theirs, row
    held = set().union(*(equation_numbers(row["paper"]) for row in rows))
    assert held == set(range(1, 58))
    said = "; ".join(part for said in EQUATIONS.values() for part in said.get("paper", ()))
    assert equation_numbers(said) == held


@pytest.mark.parametrize("order", [3, 4, 5, 6, 7, 8, 11, 12])
def test_moduli_of_regular_loops(order):
    """(7.2)-(7.4)."""
    kappa, E = 0.3, 0.1
    graph = regular_polygon(order, strain=E)
    law, nu = LinearFrictional(kn=1.0, kt=kappa), E / (1 - E)
    tau, ratio = kappa - nu, 2.0 * np.tan(np.pi / order)
    vertex = order == 4
    affine = ratio * (tau if vertex else (1 + tau) / 2)
    relaxed = affine if order <= 4 else ratio * 2 * tau / (1 + tau)
    free = {3: ratio * (1 - nu) / 2, 4: affine}.get(order, -ratio * 2 * nu / (1 - nu))
    for tangent, wanted in (
        (affine_tangent(graph, law), affine),
        (traction_tangent(graph, law), relaxed),
        (traction_tangent(graph, law, spins="free"), free),
    ):
        A = restrict(tangent, "diagonal")
        np.testing.assert_allclose(A[0, 0] + A[0, 1], ratio, rtol=1e-12)
        np.testing.assert_allclose(A[0, 0] - A[0, 1], wanted, rtol=1e-11)


@pytest.mark.parametrize("order", [3, 4, 5, 6, 8, 9])
def test_table_of_thresholds(order):
    """At the strain that the table says Ks of (11, 22) has a zero; before it none."""
    kappa, law = 0.3, LinearFrictional(kn=1.0, kt=0.3)
    column = {3: "$n = 3$", 4: "$n = 4$, vertex on axis 1"}.get(order, r"$n \ge 5$")
    (rows,) = tables(page("theory/polygons"))
    closures = (affine_tangent, {}), (traction_tangent, {}), (traction_tangent, {"spins": "free"})
    for row, (closure, how) in zip(rows, closures, strict=True):
        formula = row[column].strip("$").replace(r"\kappa", "kappa")
        first = 0.0 if formula == "from the first load" else eval(formula, {"kappa": kappa})
        least = [symmetric_spectrum(restrict(closure(regular_polygon(order, strain=E), law, **how),
                                             "diagonal"))[0]
                 for E in (first, 0.9 * first)]  # fmt: skip
        assert least[0] == pytest.approx(0.0, abs=1e-12), (row, formula)
        assert first == 0.0 or least[1] > 1e-3


def test_points_B():
    (rows,) = tables(section(page("theory/diamond"), "## The drained biaxial path"))
    for row, p in zip(rows, (TABLE_1, TABLE_2), strict=True):
        state = drained_path(p).end
        found = [float(state.E1), float(state.E2), float(state.s1)]
        quoted = [float(row[f"${name}$"]) for name in ("E_1", "E_2", "s_1")]
        np.testing.assert_allclose(found, quoted, rtol=0, atol=2e-15)


def unsaid_decimals(name, values):
    """Decimal numbers of a page that are none of the values; equations' own numbers aside."""
    text = re.sub(r"{equation} [\d.]+|eq-[\d.]+|\(\d+\.\d+\)", "", page(f"theory/{name}"))
    return [token for token in unsaid(text, values, least=1) if "." in token]


def test_numbers_of_stability():
    fraction = float(imhof_fraction([1.0, 0.4, -0.2]))
    assert says("0.12640", fraction)
    assert unsaid_decimals("stability", [fraction, 0.4, -0.2]) == []


def test_numbers_of_the_open_points():
    path = drained_path(TABLE_1)
    turn = path.end.alpha - TABLE_1.alpha0 + np.linspace(0.0, 0.3, 3001)
    states = printed_states_after_turn(path, turn)
    ratio = np.interp(path.end.E1 + 0.1, states.E1, np.abs(states.T) / (TABLE_1.mu * states.N))
    E = float(isotropic_strain_of_stress(0.35, TABLE_2.alpha0))
    # Equal stresses on the diamond as it barely touches.
    F1, F2 = np.sin(TABLE_2.alpha0), np.cos(TABLE_2.alpha0)
    N, T = F1 * F2 + F2 * F1, F1 * F1 - F2 * F2
    touch = [float(opposite_contact_strain(p.alpha0)) for p in (TABLE_1, TABLE_2)]
    values = [ratio, E, stress_of_isotropic_strain(E, TABLE_2.alpha0)[1], T / N, TABLE_2.mu, *touch,
              0.24 / 1.24, 0.35, 0.3]  # fmt: skip
    assert unsaid_decimals("open-points", [*values, 0.1]) == []


@pytest.mark.parametrize(
    "name", [path.stem for path in PAGES if path.parent.name == "theory"
             if path.stem not in ("diamond", "stability", "open-points")]
)  # fmt: skip
def test_other_pages_quote_no_numbers(name):
    assert unsaid_decimals(name, []) == []


@pytest.mark.slow
def test_the_site_builds(tmp_path):
    """Every warning an error, the gallery run; no page asks the network for anything."""
    pytest.importorskip("sphinx")
    command = [sys.executable, "-m", "sphinx", "-q", "-W", "-E", "-b", "html"]
    done = subprocess.run([*command, DOCS, tmp_path], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    built = list(tmp_path.rglob("*.html"))
    assert len(built) > 40
    asks = re.compile(r"<(?:script|link|img)[^>]*(?:src|href)=\"https?:")
    assert [html.name for html in built if asks.search(html.read_text())] == []
    # A function leads back to the equations that name it, as equations lead to functions.
    room, name = (tmp_path / "rooms" / "loops.html").read_text(), "stress-and-tangent.html"
    assert f'href="../theory/{name}#equation-eq-4-4"' in room
    assert "rooms/loops.html#loops.affine_tangent" in (tmp_path / "theory" / name).read_text()
