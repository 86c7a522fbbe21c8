"""Figures that are drawn, and whose files stay empty: saving takes most of a figure's time."""

from pathlib import Path

import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine


def leave_files_empty(patch: pytest.MonkeyPatch) -> None:
    """The names of the figures stay."""
    patch.setattr(ConstrainedLayoutEngine, "execute", lambda *_: None)
    for canvas, save in ((Figure, "savefig"), (FigureCanvasAgg, "print_png")):
        patch.setattr(canvas, save, lambda _, path, **how: Path(path).touch())
