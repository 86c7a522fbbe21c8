"""Which loops of a packing does its own rate problem predict?

Four snapshots of a slow biaxial compression (Yade, 2000 discs, steps of 2e-5), by the functions
behind `grainloops series --in-packing`. The rate problem of the packing under the strain of its
cell predicts the work of every loop until the next snapshot. Its skill is compared with that of
loops cut out of the packing, of their order, and of their work in the step before.
"""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pandas as pd

from studies.examples import run_example, save
from studies.examples.indicators import sample_series
from studies.series.figures import skill_by_predictor
from studies.series.skill import SKILL_COLUMNS


def main(out: Path) -> dict[str, Any]:
    """Follow the series; write the skill of every predictor and the figure."""
    with TemporaryDirectory() as folder:
        summary = sample_series(Path(folder) / "series", in_packing=True)
        skill = pd.read_parquet(Path(folder) / "series" / "skill.parquet")
    kept = ("packing", "skill", "skill_of_targets", "skill_by_order")
    numbers = {name: summary[name] for name in kept}
    table = skill[list(SKILL_COLUMNS)]
    return save(out, "packing_skill", skill_by_predictor(skill), numbers, table)


if __name__ == "__main__":
    run_example(main)
