"""Figures that are made, and neither drawn nor saved: that takes most of a figure's time."""

from pathlib import Path

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine


def leave_files_empty(patch: pytest.MonkeyPatch) -> None:
    """The names of the figures stay; a PNG has one pixel, an SVG is empty."""
    patch.setattr(ConstrainedLayoutEngine, "execute", lambda *_: None)
    patch.setattr(FigureCanvasAgg, "draw", lambda *_: None)
    patch.setattr(FigureCanvasAgg, "buffer_rgba", lambda _: np.zeros((1, 1, 4), dtype=np.uint8))
    for canvas, save in ((Figure, "savefig"), (FigureCanvasAgg, "print_png")):
        patch.setattr(canvas, save, lambda _, path, **how: Path(path).touch())
