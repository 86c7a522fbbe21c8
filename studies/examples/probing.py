"""Is a packing's response in every direction predicted from one state?

States of a biaxial compression (Yade, 2000 discs) were strained along 24 directions, each from a
fork of the running simulation. Their stress increments, direction by direction, against the rate
problem of the state alone.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from loops import Regime, contact_state, love_weber_stress
from loops.arrays import Floats
from patterns import Snapshot, read_snapshot, sample_path
from stability.packing import probe, rate_problem
from stability.programmes import component_control
from studies.examples import run_example, save
from studies.output import components
from studies.style import BLUE, GREY, VERMILION, new_panels, styled

STATES = ("before", "after", "moving")
BANDS = {"0.999": 0.999, "0.99": 0.99, "elastic": None}
COLOURS = dict(zip(BANDS, (BLUE, VERMILION, GREY), strict=True))
STRESS = ["sig2d_xx", "sig2d_xy", "sig2d_yx", "sig2d_yy"]


def state(name: str) -> tuple[Snapshot, pd.DataFrame]:
    """A state, and the stress increments of Yade's probes from it, compression positive."""
    table = pd.read_csv(sample_path(f"probe/probes_{name}.csv.gz"))
    start, rows = table.iloc[0], table.iloc[1:].sort_values(["amplitude", "theta_deg"])
    rows[STRESS] = start[STRESS].to_numpy(float) - rows[STRESS]
    cell = np.diag([start["h_xx"], start["h_yy"]])
    path = sample_path(f"probe/grains_{name}.parquet")
    return read_snapshot(path, cell=cell, shear_increment="radii"), rows


def convected(H: Floats, stress: Floats) -> Floats:
    """Difference of the rates of Cauchy and nominal stress: `tr(H') S - S H'^T`."""
    return np.trace(H, axis1=1, axis2=2)[:, None, None] * stress - stress @ np.swapaxes(H, 1, 2)


def increments(rows: pd.DataFrame) -> tuple[Floats, Floats]:
    """Sizes (D,) of the strains of Yade's probes, and the stress increments (D, 2, 2) over them."""
    size = np.hypot(rows["H11"], rows["H22"]).to_numpy()
    return size, rows[STRESS].to_numpy().reshape(-1, 2, 2) / size[:, None, None]


def compared_state(name: str) -> pd.DataFrame:
    """One row per band, amplitude and direction: measured and predicted stress, error, both W2."""
    (snapshot, measured), parts = state(name), list[pd.DataFrame]()
    stress, theta = love_weber_stress(snapshot.graph), measured["theta_deg"].unique()
    wanted = np.column_stack([np.cos(np.radians(theta)), np.sin(np.radians(theta))])
    for label, band in BANDS.items():
        if band is not None:
            found = probe(snapshot, wanted, yield_band=band)
        P = found.elastic_stress if label == "elastic" else found.stress_rate
        H, more = found.elastic_strain, convected(found.elastic_strain, stress)
        for amplitude, rows in measured.groupby("amplitude"):
            size, actual = increments(rows)
            error = np.linalg.norm(P + more - actual, axis=(1, 2))
            length = np.linalg.norm(actual, axis=(1, 2))
            parts.append(pd.DataFrame({
                **{"state": name, "band": label, "amplitude": amplitude, "theta_deg": theta},
                **components("measured_", actual),
                **components("predicted_", P + more),
                "error": error / length,
                "error_of_largest": error / length.max(),
                "error_of_state": error * size / np.linalg.norm(stress),
                "measured_W2": np.sum((actual - more) * H, axis=(1, 2)),
                "predicted_W2": np.sum(P * H, axis=(1, 2)),
                "unbalanced": rows["unbalanced"].to_numpy(),
            }))  # fmt: skip
    return pd.concat(parts)


def reached(name: str, amplitudes: Floats) -> dict[str, list[float]]:
    """Number of contacts that yield and that open by an amplitude, if the first rates went on.

    Means over the directions.
    """
    snapshot, measured = state(name)
    mu = np.asarray(snapshot.mechanics()[0].mu)[:, None]
    rates = rate_problem(snapshot.scene, yield_band=0.999)
    now, counts = contact_state(snapshot.graph), []
    force = now.forces
    for angle in np.radians(measured["theta_deg"].unique()):
        found = rates.solved(component_control(np.diag([np.cos(angle), np.sin(angle)]))).response
        # Forces turn with the branches.
        turn = np.sum(now.t * found.branch_rate, axis=1) / now.length
        rate = found.force_rate - turn[:, None] * np.stack([-force[:, 1], force[:, 0]], axis=1)
        grown = force + amplitudes[:, None, None] * rate
        N, T = (np.sum(grown * axis, axis=2).T for axis in (now.n, now.t))
        over = (found.regime != Regime.SLIDING)[:, None] & (N > 0) & (np.abs(T) > mu * N)
        counts.append([np.count_nonzero(over, axis=0), np.count_nonzero(N <= 0, axis=0)])
    yields, opens = np.mean(counts, axis=0).tolist()
    return {"amplitude": amplitudes.tolist(), "reach_yield": yields, "open": opens}


def summed(rows: pd.DataFrame) -> list[dict[str, Any]]:
    """Errors over the directions in per cent, and the share of right signs of W2."""
    out = []
    names = ["state", "band", "amplitude"]
    for key, part in rows.groupby(names, sort=False):
        error, negative = 100 * part["error"], part[["measured_W2", "predicted_W2"]] < 0
        out.append({
            **dict(zip(names, key, strict=True)),
            "median": error.median(), "q90": error.quantile(0.9), "largest": error.max(),
            "largest_of_largest": 100 * part["error_of_largest"].max(),
            "of_state": part["error_of_state"].median(),
            "worst_theta_deg": part["theta_deg"][error.idxmax()],
            "signs": int((negative["measured_W2"] == negative["predicted_W2"]).sum()),
            "negative": int(negative["measured_W2"].sum()),
            "unbalanced": part["unbalanced"].median(),
        })  # fmt: skip
    return out


@styled()
def draw(rows: pd.DataFrame, sums: pd.DataFrame, kn: float = 1e6) -> Figure:
    """Envelopes, measured and predicted, and the errors over the amplitude."""
    figure, (panels,) = new_panels(1, 4, 3.0, width_ratios=[1, 1, 1, 1.5])
    for ax, name in zip(panels, STATES, strict=False):
        for label, near in (("elastic", 2e-6), ("0.999", 2e-6), ("0.99", 2e-5)):
            part = rows[(rows["state"] == name) & (rows["band"] == label)]
            part = part[np.isclose(part["amplitude"], near)]
            loop = np.append(np.arange(len(part)), 0)
            values = part[["predicted_11", "predicted_22"]].to_numpy()[loop] / kn
            look = {"color": COLOURS[label], "linewidth": 1.0}
            ax.plot(*values.T, "-" if BANDS[label] else "--", label=f"predicted, {label}", **look)
            if BANDS[label]:
                points = part[["measured_11", "measured_22"]].to_numpy() / kn
                look = {"color": COLOURS[label], "markersize": 3.0, "fillstyle": "none"}
                ax.plot(*points.T, "os"[near > 5e-6], **look, label=f"Yade, {near:.0e}")
        ax.set(title=name, aspect="equal", xlabel=r"$\Delta\sigma_{11}/(a\,k_n)$")
    panels[0].set_ylabel(r"$\Delta\sigma_{22}/(a\,k_n)$")
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=5)
    marks, look = dict(zip(STATES, "os^", strict=True)), {"fillstyle": "none", "markersize": 3.5}
    for (name, label), part in sums.groupby(["state", "band"], sort=False):
        look |= {"color": COLOURS[label], "marker": marks[name]}
        panels[3].loglog(part["amplitude"], part["median"], linewidth=0.9, **look)
    panels[3].set(title="before o, after □, moving △", xlabel="$a$", ylabel="median error (%)")
    return figure


def main(out: Path) -> dict[str, Any]:
    """Compare both states, write the table and the figure."""
    rows = pd.concat(map(compared_state, STATES), ignore_index=True)
    sums = summed(rows)
    amplitudes = rows["amplitude"].unique()
    numbers = {"errors": sums, "on_the_way": {name: reached(name, amplitudes) for name in STATES}}
    return save(out, "probing", draw(rows, pd.DataFrame(sums)), numbers, rows, "as Yade's: N, m")


if __name__ == "__main__":
    run_example(main)
