"""Forces of Yade in the diamond, those of the closed forms.

Thirteen straight strain paths of four discs computed with Yade, with either shear increment,
sticking and sliding. They agree to Yade's own step: each step adds the displacement of a step at
the geometry it finds, the first one too, so its error is of first order, and replaying that rule
gives Yade's forces to rounding.
"""

from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from patterns import sample_path
from tests.oracles.strain_lines import (
    StrainLine,
    half_diagonals,
    line_states,
    strain_line,
)

# kt/kn of the simulation.
KAPPA = 0.2
# kn l0 in newton.
UNIT = 1e5 * 0.02
CONFINING_STEPS = 3000
COLUMNS = {"F1": "Fx_right", "F2": "Fy_top", "N": "Fn_RT", "T": "Fs_RT"}
# Coefficient of friction at which nothing slides.
NO_SLIDING = 1e6


class DiamondProbe(NamedTuple):
    """A path of Yade beside the exact states at its strains; forces over `kn l0`."""

    line: StrainLine
    u: Any
    forces: dict[str, tuple[Any, Any]]  # Yade's, exact
    steps: Any
    mu: float
    increment: str


def probe_of(rows):
    """The records of one path, without its isotropic stage."""
    first = rows.step[rows.step <= CONFINING_STEPS + 1].max()
    rows = rows[rows.step >= first].sort_values("step")
    key = rows.iloc[0]
    mu = float(key.mu) if key.mu < NO_SLIDING else np.inf
    increment = "radii" if key.agr else "branch"
    line, u = line_through(key.a0_deg, key.probe_deg, rows.E1.to_numpy(), rows.E2.to_numpy())
    exact = line_states(line, u, KAPPA, mu, increment)
    sides = 2 * np.sin(line.alpha0) * exact.s1, 2 * np.cos(line.alpha0) * exact.s2
    forces = {
        name: (rows[column].fillna(0.0).to_numpy() / UNIT, ours)
        for (name, column), ours in zip(COLUMNS.items(), (*sides, exact.N, exact.T), strict=True)
    }
    return DiamondProbe(line, u, forces, (rows.step - first).to_numpy(), mu, increment)


def line_through(a0_deg, probe_deg, E1, E2):
    """The straight line from the first of these strains, and their places on it."""
    alpha0 = np.radians(a0_deg)
    line = strain_line(alpha0, np.ravel(E1)[0], np.ravel(E2)[0], np.radians(probe_deg))
    return line, half_diagonals(alpha0, E1, E2) @ line.direction


def probes():
    """All paths of the sample."""
    keys = ["a0_deg", "mu", "agr", "E0", "probe_deg"]
    tables = (pd.read_csv(sample_path("yade_diamond") / f"{name}.csv.gz")
              for name in ("probes", "probes_large"))  # fmt: skip
    return [probe_of(own) for table in tables for _, own in table.groupby(keys)]


def error(probe, name):
    """Largest difference of a force over its largest value; 0 on lines that do not turn."""
    yade, ours = probe.forces[name]
    size, largest = np.abs(ours).max(), probe.forces["N"][1].max()
    return float(np.abs(yade - ours).max() / size) if size > 1e-9 * largest else 0.0


def replayed_shear(line, rise, steps, mu, increment):
    """Yade's shear force by its own rule and step: cut back to Coulomb's cone once a step."""
    u = line.start + rise * np.arange(steps + 1) / steps
    length = np.hypot(line.distance, u)
    angle = line.sense * np.arctan(u / (line.distance if line.sense else 1.0))
    turn = np.diff(angle, prepend=angle[0])
    swept = KAPPA * line.sense * line.distance * rise / steps / length
    added = swept / length if increment == "radii" else swept
    cone = np.full_like(length, np.inf) if np.isinf(mu) else mu * np.maximum(1.0 - length, 0.0)
    # Turned by subtracting its cross product with the turn, then projected.
    factor, T, shear = np.cos(turn) + np.sin(turn) ** 2, 0.0, np.empty(steps + 1)
    for k, (growth, step, limit) in enumerate(zip(factor, added, cone, strict=True)):
        T = min(max(T * growth + step, -limit), limit)
        shear[k] = T
    return shear


def replay_error(probe):
    """Yade's rule replayed against Yade, over the largest N."""
    rise, steps = float(probe.u[-1] - probe.u[0]), int(probe.steps[-1])
    shear = replayed_shear(probe.line, rise, steps, probe.mu, probe.increment)[probe.steps]
    return float(np.abs(shear - probe.forces["T"][0]).max() / probe.forces["N"][1].max())


def step_errors():
    """Relative error of T at the end of one path, by its number of steps."""
    found = {}
    for one in pd.read_csv(sample_path("yade_diamond") / "convergence.csv").itertuples():
        ends = [one.E0, one.E1], [one.E0, one.E2]
        line, u = line_through(one.a0_deg, one.probe_deg, *map(np.array, ends))
        exact = float(line_states(line, u[1], KAPPA).T)
        found[int(one.n_probe_steps)] = abs(one.Fs_RT / UNIT / exact - 1.0)
    return found


# Yade's own first-order error at its step of 1e-5 in strain: one shear increment too many.
YADE = {"F1": 3e-5, "F2": 3e-5, "T": 4e-4, "N": 1e-11}


def test_forces_of_yade_are_those_of_the_closed_forms():
    found = probes()
    assert len(found) == 13
    assert sum(bool(np.isfinite(probe.mu)) for probe in found) >= 6
    for name, bound in YADE.items():
        worst = max(error(probe, name) for probe in found)
        # The comparison is not with itself.
        assert bound / 1e4 < worst < bound
    # 5000 to 35,000 steps replayed from records with 15 digits.
    assert max(replay_error(probe) for probe in found) < 2e-12
    steps, errors = np.array(list(step_errors().items())).T
    np.testing.assert_allclose(np.diff(np.log(errors)) / np.diff(np.log(steps)), -1, atol=1e-3)
