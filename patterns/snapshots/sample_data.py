"""The snapshots that come with the project."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

SAMPLE = Path(__file__).parent / "sample"


def sample_path(name: str = "grains_biaxial.csv.gz") -> Path:
    """Path of a sample file: `grains_biaxial.csv.gz` or `grains_periodic.parquet`.

    Parameters
    ----------
    name : str
        File name in the sample folder.

    Returns
    -------
    Path
        Where it is installed.

    Examples
    --------
    >>> from patterns import sample_path
    >>> sample_path().name
    'grains_biaxial.csv.gz'
    """
    return SAMPLE / name


def sample_cell() -> NDArray[np.float64]:
    """Periodic cell of `grains_periodic.parquet`, columns are the cell vectors (m).

    Returns
    -------
    (2, 2) array
        Cell vectors.
    """
    return np.array(json.loads((SAMPLE / "macro.json").read_text())["cell"])
