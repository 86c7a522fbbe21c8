"""Does equation (8c) as printed hold for a diamond whose contacts slide?

Nicot et al. 2016 print the slip rule with `zeta_n = sign(un')`. A contact that slides outward while
its normal force falls then has `T' = -s mu N'`, `s = sign(T)`: |T| grows and leaves Coulomb's cone.
Coulomb's law, `T' = s mu N'`, keeps `|T|/(mu N)` at 1. Both rules are followed along the drained
test of the paper's two tables, and compared with the shear forces that they integrate to.
"""

from __future__ import annotations

from pathlib import Path as Folder
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from loops import LinearFrictional, Regime, Scene, boundary_of
from patterns.diamond import PrintedRule, diamond
from stability import Path, Stage, follow, programmes
from studies.examples import run_example, save
from studies.paths.options import TABLES
from studies.style import BLUE, GREY, LIGHT_GREY, VERMILION, new_panels, styled

RULES = {"coulomb": LinearFrictional, "printed": PrintedRule}
RULE_LOOKS: dict[str, Any] = {
    "coulomb": {"color": BLUE, "label": r"$\dot T = s\mu\dot N$, $s = \mathrm{sign}\,T$"},
    "printed": {"color": VERMILION, "linestyle": (0, (4, 3)), "label": "(8c) as printed"},
}
# Strain after B at which the rules are compared.
AFTER_YIELD = 0.1
# E1 at the end of the test.
LAST_STRAIN = 0.6


def drained_test(table: int, rule: str) -> tuple[pd.DataFrame, float]:
    """Rows from A on, `stage` 2 after the strain of comparison; largest error of T against (8).

    Beyond B `T = mu N`, as printed `T = 2 mu N_B - mu N`.
    """
    loop = TABLES[table]
    graph, law = diamond(loop.alpha0), RULES[rule](1.0, loop.kappa, loop.mu)
    scene = Scene(graph, law, boundary_of(graph, volume=2.0 * np.sin(2.0 * loop.alpha0)))
    confining = Stage(programmes.isotropic_strain(), "H11", loop.confinement)

    def along(*strains: float) -> Path:
        drained = [Stage(programmes.drained_biaxial(), "H11", E1) for E1 in strains]
        return follow(scene, [confining, *drained], closure="affine", rows=80)

    at_B = along(LAST_STRAIN).of_kind("yield")[0]
    path = along(at_B.H[0] + AFTER_YIELD, LAST_STRAIN)
    rows, N_B = path.stage > 0, path.normal_force[path.of_kind("yield")[0].index, 0]
    N, T = path.normal_force[rows, 0], np.abs(path.shear_force[rows, 0])
    slides = path.regime[rows, 0] == Regime.SLIDING
    exact = loop.mu * (2.0 * N_B - N if rule == "printed" else N)
    columns = {"table": table, "rule": rule, "stage": path.stage[rows], "E1": path.H[rows, 0]}
    columns |= {"shear_ratio": T / (loop.mu * N), "s1": path.P[rows, 0]}
    return pd.DataFrame(columns), float(np.abs(T - exact)[slides].max())


def compare_rules() -> tuple[pd.DataFrame, list[dict[str, Any]]]:
    """Curves of every table and rule; their values `AFTER_YIELD` beyond B and at the end."""
    curves, numbers = [], []
    for table in TABLES:
        for rule in RULES:
            curve, error = drained_test(table, rule)
            there, end = curve[curve.stage == 1].iloc[-1], curve.iloc[-1]
            row = {"table": table, "rule": rule, "shear_ratio": there.shear_ratio, "s1": there.s1}
            row |= {"shear_ratio_end": end.shear_ratio, "E1_end": end.E1, "error_of_T": error}
            curves.append(curve)
            numbers.append(row)
    return pd.concat(curves, ignore_index=True), numbers


@styled()
def draw(curves: pd.DataFrame) -> Figure:
    """Use of friction and axial stress from A on, Table 1."""
    figure, ((use, stress),) = new_panels(1, 2, 2.6)
    use.axhspan(1.0, 3.0, color=LIGHT_GREY, alpha=0.45, linewidth=0.0, zorder=0)
    for rule, curve in curves[curves.table == 1].groupby("rule"):
        use.plot(curve.E1, curve.shear_ratio, **RULE_LOOKS[rule])
        stress.plot(curve.E1, curve.s1, **RULE_LOOKS[rule])
    highest = 1.08 * curves[curves.table == 1].shear_ratio.max()
    use.set(xlabel="axial strain $E_1$ (–)", ylabel=r"$|T|/(\mu N)$ (–)", ylim=(0.0, highest))
    said: Any = {"va": "top", "color": GREY, "fontsize": 7}
    use.text(0.03, 0.97, "outside Coulomb's cone", transform=use.transAxes, **said)
    stress.set(xlabel="axial strain $E_1$ (–)", ylabel="axial stress $s_1$ (–)")
    use.legend(loc="lower right")
    return figure


def main(out: Folder) -> dict[str, Any]:
    """Follow both rules; write curves, numbers and the figure."""
    curves, numbers = compare_rules()
    told = {"strain_after_yield": AFTER_YIELD, "rules": numbers}
    return save(out, "printed_rule", draw(curves), told, curves)


if __name__ == "__main__":
    run_example(main)
