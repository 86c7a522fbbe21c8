"""A followed packing beside the later snapshots of its simulation: rate, drops, errors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd

from loops import InputError
from patterns import Snapshot
from stability import COMPONENTS, Stage
from stability import Path as FollowedPath
from stability.programmes import NOTHING, nominal
from studies.output import Summary, components
from studies.series.evolution import sample_strain
from studies.series.loading import stress_of
from studies.series.packing import DEFAULT_RATE, Following, Rate, interval_rate

# Share of itself by which the driven stress falls in a drop: a definition (docs/knobs.md).
DROP = 1e-4
# Snapshots beyond the end of a path by less than this share of it are at its end: strains over the
# first cell of a compression differ by that from those over the first cell of the forecast.
AT_THE_END = 5e-3


def replay_rate(
    snapshot: Snapshot,
    after: Sequence[Snapshot],
    times: Sequence[float | None],
    known: Following,
    stage: Stage,
) -> Rate:
    """Rate of the replay of a stage: that of the code until the next snapshot."""
    if known.inertial_number is None and not after:
        return Rate.from_rest(DEFAULT_RATE, "no later snapshot")
    H = np.eye(2) if not after else sample_strain(snapshot, after[0])[0]
    found = interval_rate(snapshot, after[0] if after else snapshot, H, times[:2], known)
    if "duration" not in found.options:
        return found
    # The driven strains of the stage, in the time that the code takes for them.
    driven = stage.programme.equations(NOTHING, NOTHING)[1].T @ stage.programme.rate
    ahead = float(driven @ H.ravel()) / float(driven @ driven) if driven.any() else 0.0
    if ahead > 0:
        duration = found.options["duration"] * stage.target / ahead
        return found._replace(options=found.options | {"duration": duration})
    return found._replace(options={"inertial_number": found.inertial_number})


def dem_table(snapshot: Snapshot, names: Sequence[str], later: Sequence[Snapshot]) -> pd.DataFrame:
    """Strain and nominal stress of the later snapshots, over the cell of the first."""
    strains, stresses = [], []
    for name, after in zip(names, later, strict=True):
        after.mechanics()
        H, source = sample_strain(snapshot, after)
        if source not in ("cell", "walls"):
            raise InputError(name, "no cell", "the cell of a later state", "Give --cells.")
        strains.append(H)
        stresses.append(nominal(stress_of(after), H))
    return pd.DataFrame(
        {
            "snapshot": names,
            **components("H", np.array(strains)),
            **components("P", np.array(stresses)),
        }
    )


def dem_comparison(
    ways: Mapping[str, FollowedPath], dem: pd.DataFrame, driven: str, sense: float
) -> pd.DataFrame:
    """One row per snapshot of the DEM: its driven stress and volume, and those of each way there.

    Empty beyond the end of a way. `persistence` is the stress of the start.
    """
    stress, at = f"P{driven[1:]}", COMPONENTS.index(driven[1:])
    start = next(iter(ways.values()))
    table = pd.DataFrame(
        {
            "snapshot": dem["snapshot"],
            "driven": dem[driven],
            "stress_dem": dem[stress],
            "volume_dem": dem["H11"] + dem["H22"],
            "stress_persistence": start.P[0, at],
        }
    )
    for name, way in ways.items():
        # Ascending, as interpolation wants it.
        strain, reached = sense * way.H[:, at], sense * dem[driven]
        for quantity, values in (("stress", way.P[:, at]), ("volume", way.H[:, [0, 3]].sum(1))):
            told = np.interp(reached, strain, values)
            beyond = (reached > strain[-1] * (1 + AT_THE_END)) | (reached < 0)
            table[f"{quantity}_{name}"] = np.where(beyond, np.nan, told)
    before = np.append(start.P[0, at], table["stress_dem"][:-1])
    table["drop"] = table["stress_dem"] - before < -DROP * np.abs(before)
    return table


def dem_comparison_summary(table: pd.DataFrame, ways: Sequence[str]) -> Summary:
    """Errors of each way and of persistence, drops of stress predicted and missed, and how far.

    `holds_to` is the driven strain up to which the error, over all snapshots until there, is less
    than half of that of persistence; `lead` that of the last drop predicted.
    """
    told, start = {}, table["stress_persistence"].iloc[0]
    rest = start - table["stress_dem"].to_numpy()
    for name in ways:
        stress = table[f"stress_{name}"].to_numpy()
        known = np.isfinite(stress)
        error = (stress - table["stress_dem"].to_numpy())[known]
        better = np.cumsum(error**2) < 0.25 * np.cumsum(rest[known] ** 2)
        ahead = int(np.argmin(better)) if not better.all() else len(better)
        before = np.append(start, stress[:-1])
        falls = known & (stress - before < -DROP * np.abs(before))
        drops = table["drop"].to_numpy() & known
        found = np.flatnonzero(falls & drops)
        told[name] = {
            "snapshots": int(known.sum()),
            "error": float(np.sqrt(np.mean(error**2))) if len(error) else None,
            "persistence_error": float(np.sqrt(np.mean(rest[known] ** 2))) if len(error) else None,
            "holds_to": float(table["driven"].iloc[ahead - 1]) if ahead else 0.0,
            "drops": int(drops.sum()),
            "drops_predicted": len(found),
            "drops_missed": int((drops & ~falls).sum()),
            "drops_false": int((falls & ~drops).sum()),
            "lead": float(table["driven"].iloc[found[-1]]) if len(found) else None,
        }
    return told
