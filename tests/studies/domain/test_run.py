"""The bifurcation domain: exact losses along strain programmes, and what the study writes."""

import numpy as np
import pandas as pd
import pytest
from mpmath import mp, mpf

from loops import InputError, LinearFrictional, affine_tangent
from patterns import diamond
from stability import restrict, symmetric_part
from studies.domain import (
    PAPER_CASES,
    DomainParameters,
    domain_table,
)
from tests.command import refusal
from tests.oracles.diamond import DiamondParameters as Case
from tests.oracles.diamond import sliding_moduli, tangent
from tests.oracles.diamond_domain import first_losses, programme_fan, sticking_det_Ks
from tests.oracles.strain_lines import line_states

# The paper's diamonds, flat and tall ones, soft and stiff shear.
CASES = (
    *PAPER_CASES,
    Case(0.2, 0.05, 0.3, 0.0),
    Case(1.3, 1.0, 0.6, 0.0),
    Case(0.9, 4.0, 0.2, 0.0),
)
KINDS = ("det_Ks_zero", "det_K_zero")
# Those that are followed, each along so many programmes.
SOME, PROGRAMMES = (*PAPER_CASES, CASES[-1]), 9


@pytest.fixture(scope="module")
def table():
    return domain_table(SOME, PROGRAMMES)


def of(table, case):
    return table[
        np.isclose(table.alpha0_deg, np.degrees(case.alpha0)) & (table.kappa == case.kappa)
    ]


def loss_in_many_digits(case, programme, kind, guess):
    """E1, E2, s1, s2 at the loss of a sticking diamond, T by quadrature of `l d(alpha)`."""
    with mp.workdps(30):
        a0, kappa, b = mpf(case.alpha0), mpf(case.kappa), mpf(programme)

        def point(t):
            return (1 - t * mp.cos(b)) * mp.cos(a0), (1 - t * mp.sin(b)) * mp.sin(a0)

        def shear_rate(t):  # kappa l alpha' = kappa (X Y' - Y X')/l
            (X, Y), X1, Y1 = point(t), -mp.cos(b) * mp.cos(a0), -mp.sin(b) * mp.sin(a0)
            return kappa * (X * Y1 - Y * X1) / mp.hypot(X, Y)

        def determinant(t):
            length = mp.hypot(*point(t))
            T = mp.quad(shear_rate, [0, t]) if kind == "det_Ks_zero" else 0
            return kappa - (1 - length) / length - (T / (2 * length)) ** 2

        t = mp.findroot(determinant, mpf(guess))
        (X, Y), T = point(t), mp.quad(shear_rate, [0, t])
        length = mp.hypot(X, Y)
        N, c, s = 1 - length, X / length, Y / length
        s1, s2 = (N * c + T * s) / mp.sin(a0), (N * s - T * c) / mp.cos(a0)
        return [float(x) for x in (t * mp.cos(b), t * mp.sin(b), s1, s2)]


@pytest.mark.parametrize("case", SOME)
def test_isotropic_programme_loses_both_at_kappa(table, case):
    rows = of(table, case)
    isotropic = rows[np.isclose(rows.programme_deg, 45.0, atol=1e-9)]
    assert len(isotropic) == 4  # sticking and with friction, det Ks and det K
    np.testing.assert_allclose(isotropic.E1 / (1 - isotropic.E1), case.kappa, rtol=2e-14)
    np.testing.assert_allclose(isotropic.E2, isotropic.E1, rtol=4e-15)
    assert (isotropic.regime == "elastic").all()


@pytest.mark.parametrize("case", PAPER_CASES)
def test_losses_against_mpmath(table, case):
    rows = of(table, case)
    sticking = rows[rows.contacts == "sticking"]
    for kind, own in sticking.groupby("kind"):
        for row in own.iloc[:: len(own) // 4].itertuples():
            guess = np.hypot(row.E1, row.E2)
            exact = loss_in_many_digits(case, np.radians(row.programme_deg), kind, guess)
            found = [row.E1, row.E2, row.s1, row.s2]
            # The angle goes through degrees; near grazing lines the root amplifies that.
            np.testing.assert_allclose(found, exact, atol=1e-13)


@pytest.mark.parametrize("case", SOME)
@pytest.mark.parametrize("contacts", ["sticking", "frictional"])
@pytest.mark.parametrize("kind", KINDS)
def test_losses_are_those_in_closed_form(table, case, contacts, kind):
    """On every programme that has one, and on no other."""
    losses = first_losses(case, PROGRAMMES, friction=contacts == "frictional")
    found = of(table, case)
    found = found[(found.contacts == contacts) & (found.kind == kind)]
    u = getattr(losses, kind)
    known = np.isfinite(u)
    np.testing.assert_allclose(found.programme_deg, np.degrees(losses.programme[known]), rtol=1e-15)
    line, mu = losses.line.take(known), losses.mu
    state = line_states(line, u[known], case.kappa, mu)
    for name in ("E1", "E2", "s1", "s2", "N", "T"):
        np.testing.assert_allclose(found[name], getattr(state, name), rtol=0, atol=1e-12)
    by_yielding = (u == losses.yields)[known]
    assert ((found.regime == "sliding") == by_yielding).all()


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("friction", [False, True])
def test_det_Ks_is_lost_no_later_than_det_K(case, friction):
    losses = first_losses(case, 201, friction=friction)
    with_K = np.isfinite(losses.det_K_zero)
    assert with_K.sum() > 20
    assert np.all(losses.det_Ks_zero[with_K] <= losses.det_K_zero[with_K])


@pytest.mark.parametrize("case", CASES)
def test_no_earlier_loss_is_missed(case):
    losses = first_losses(case, 201, friction=False)
    end = np.fmin(losses.det_Ks_zero, np.minimum(losses.line.opening, losses.line.folding))
    for share in np.linspace(0.0, 1.0 - 1e-6, 1_000):
        u = losses.line.start + share * (end - losses.line.start)
        assert np.all(sticking_det_Ks(losses.line, u, case.kappa) > 0.0)


def test_det_Ks_is_lost_alone_where_shear_is_stiff():
    # det K never vanishes on these lines: only the shear force takes det Ks below zero.
    losses = first_losses(Case(0.9, 4.0, 0.2, 0.0), 201, friction=False)
    alone = np.isfinite(losses.det_Ks_zero) & np.isnan(losses.det_K_zero)
    assert alone.sum() > 3


def test_closed_determinants_of_the_table(table):
    elastic = table[table.regime == "elastic"]
    for kind, name in (("det_Ks_zero", "det_Ks"), ("det_K_zero", "det_K")):
        own = elastic[elastic.kind == kind]
        np.testing.assert_allclose(own[name], 0.0, atol=2e-12)
    sliding = table[table.regime == "sliding"]
    assert len(sliding) > 30
    mu, length = np.tan(np.radians(sliding.phi_deg)), 1.0 - sliding.N
    np.testing.assert_allclose(np.abs(sliding["T"]), mu * sliding.N, atol=2e-14)
    np.testing.assert_allclose(sliding.det_K, -(1 + mu**2) * sliding.N / length, atol=1e-14)
    sense = np.where(sliding.programme_deg < 45.0, 1.0, -1.0)  # alpha grows where E1 leads
    moduli = sliding_moduli(np.radians(sliding.alpha_deg), mu, sense)
    measures = (sliding.E1, sliding.E2, sliding.s1, sliding.s2, np.radians(sliding.alpha0_deg))
    Ks = symmetric_part(tangent(*measures, *moduli))
    np.testing.assert_allclose(sliding.det_Ks, np.linalg.det(Ks), atol=1e-12)


def test_generic_operator_is_singular_there(table):
    for row in table[table.regime == "elastic"].iloc[::7].itertuples():
        alpha0 = np.radians(row.alpha0_deg)
        graph = diamond(alpha0, E1=row.E1, E2=row.E2, T=row.T)
        law, box = LinearFrictional(1.0, row.kappa), 2 * np.sin(2 * alpha0)
        K = restrict(affine_tangent(graph, law, volume=box).matrix, "diagonal")
        matrix = symmetric_part(K) if row.kind == "det_Ks_zero" else K
        assert abs(np.linalg.det(matrix)) < 1e-11 * np.linalg.norm(K) ** 2


def test_programmes_are_spread_evenly_about_the_isotropic_one():
    """By the angle between line and branch, measured in half diagonals."""
    alpha0 = 0.6
    programme, _ = programme_fan(alpha0, 7)
    across, along = np.sin(programme) * np.sin(alpha0), np.cos(programme) * np.cos(alpha0)
    angle = np.arctan2(across, along)
    np.testing.assert_allclose(angle - alpha0, 0.5 * np.pi * np.arange(-3, 4) / 4, atol=1e-14)
    assert programme[3] == pytest.approx(np.pi / 4)


def test_friction_cuts_the_domain_of_sticking_contacts():
    sticking = first_losses(PAPER_CASES[0], 201, friction=False)
    frictional = first_losses(PAPER_CASES[0], 201, friction=True)
    both = np.isfinite(sticking.det_Ks_zero)
    assert np.all(frictional.det_Ks_zero[both] <= sticking.det_Ks_zero[both])
    by_yielding = frictional.det_Ks_zero == frictional.yields
    assert 100 < by_yielding.sum() < 201
    np.testing.assert_array_equal(
        frictional.det_Ks_zero[by_yielding], frictional.det_K_zero[by_yielding]
    )


def test_forces_along_the_fan_are_those_of_every_diamond():
    flat, tall = (first_losses(Case(a, 0.3, 0.2, 0.0), 101, friction=True) for a in (0.6, 0.9))
    inside = (np.minimum(flat.line.folding, tall.line.folding) > 0.0)[30:71]
    for name in ("det_Ks_zero", "det_K_zero", "yields"):
        left, right = (getattr(losses, name)[30:71][inside] for losses in (flat, tall))
        np.testing.assert_allclose(left, right, atol=1e-12)


def test_fan_holds_the_isotropic_programme_and_only_compression():
    programme, line = programme_fan(0.6, 51)
    assert programme[25] == pytest.approx(np.pi / 4, abs=1e-15)
    assert np.all(np.diff(programme) > 0.0)
    assert np.all(line.start < 0.0)
    assert line.sense.tolist() == [1.0] * 25 + [0.0] + [-1.0] * 25


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--alpha0", "45,95"], "--alpha0: got 95, expected degrees in (0, 90)"),
        (["--kappa", "0.2,x"], "--kappa: got '0.2,x', expected numbers separated by commas"),
        (["--kappa", "0"], "--kappa: got 0, expected positive ratios"),
        (["--phi", "0"], "--phi: got 0, expected degrees in (0, 90]"),
        (["--directions", "10"], "--directions: got 10, expected an odd number"),
    ],
)
def test_bad_input_gives_one_line(tmp_path, capsys, arguments, message):
    assert message in refusal(capsys, "domain", "--out", tmp_path / "out", *arguments)


def test_empty_list_is_refused():
    with pytest.raises(InputError, match="--kappa: got an empty list"):
        DomainParameters(kappa=())


def test_tables_are_the_default():
    assert DomainParameters().cases() == PAPER_CASES
    assert isinstance(domain_table(PAPER_CASES[:1], 3), pd.DataFrame)
