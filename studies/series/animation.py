"""An animation of a series: its loops by order and by stability."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from contextlib import ExitStack
from io import BytesIO
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib as mpl
import numpy as np
from matplotlib.animation import AbstractMovieWriter, FFMpegWriter
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Colormap, ListedColormap, Normalize, TwoSlopeNorm
from matplotlib.figure import Figure
from numpy.typing import NDArray
from PIL import Image

from loops.arrays import Floats
from patterns import Snapshot
from studies.output import as_json
from studies.snapshot.loop_map import ORDER_SCALE, loop_drawer, order_bar
from studies.snapshot.statistics import LAST_ORDER
from studies.style import DIVERGING, ORDER_COLOURS, figure_of, new_figure, styled

# Bounds of the file: at most so many pictures of so many dots each way.
MOST = 60
PANEL, DPI = 4.6, 110  # inches, dots per inch
FRAMES_PER_SECOND = 4


class Picture(NamedTuple):
    """One picture of an animation."""

    state: Snapshot
    title: str
    smallest: Floats | None = None


def picked_snapshots(count: int, most: int = MOST) -> list[int]:
    """Places of the snapshots to show: all of a short series, evenly spread ones of a long one."""
    return np.unique(np.linspace(0, count - 1, min(count, most)).round()).astype(int).tolist()


@styled()
def animate_series(
    folder: Path, pictures: Iterable[Picture], source: Mapping[str, Any]
) -> list[str]:
    """The animation of a series, one snapshot in memory at a time.

    Colours keep their meaning, those of the eigenvalues from the first frame on.
    """
    drawn = iter(pictures)
    scene = _Scene(next(drawn))
    return write_animation(folder, scene.figure, map(scene.show, drawn), source)


def write_animation(
    folder: Path, figure: Figure, changes: Iterable[None], source: Mapping[str, Any]
) -> list[str]:
    """Write `animation.gif`, and `animation.mp4` where the program ffmpeg is at hand.

    The first frame is the figure as it is, another one follows each of the changes to it.
    """
    partial = {folder / f".partial-{name}": folder / name for name in _names()}
    try:
        with ExitStack() as stack:
            writers = [_writer(path, source) for path in partial]
            for path, writer in zip(partial, writers, strict=True):
                stack.enter_context(writer.saving(figure, str(path), DPI))
            _grab(writers)
            for _ in changes:
                _grab(writers)
        for path, final in partial.items():
            os.replace(path, final)
    finally:
        for path in partial:
            path.unlink(missing_ok=True)
    return [final.name for final in partial.values()]


def _grab(writers: list[AbstractMovieWriter]) -> None:
    for writer in writers:
        writer.grab_frame()


def _names() -> list[str]:
    return ["animation.gif", *(["animation.mp4"] if FFMpegWriter.isAvailable() else [])]


def _writer(path: Path, source: Mapping[str, Any]) -> AbstractMovieWriter:
    if path.suffix == ".gif":
        return _Gif(FRAMES_PER_SECOND, as_json(source))
    return FFMpegWriter(fps=FRAMES_PER_SECOND, metadata={"comment": as_json(source)})


class _Gif(AbstractMovieWriter):
    """A GIF with its provenance in the comment, which matplotlib's own writer leaves out."""

    def __init__(self, fps: int, comment: str) -> None:
        super().__init__(fps=fps)
        self._comment = comment
        self._pictures: list[Image.Image] = []

    def setup(self, fig: Figure, outfile: str | Path, dpi: float | None = None) -> None:
        super().setup(fig, outfile, dpi)

    def grab_frame(self, **savefig_kwargs: Any) -> None:
        pixels = BytesIO()
        self.fig.savefig(pixels, format="rgba", dpi=self.dpi, **savefig_kwargs)
        picture = Image.frombytes("RGBA", self.frame_size, pixels.getvalue())
        self._pictures.append(picture.convert("RGB").quantize(256))

    def finish(self) -> None:
        first, *rest = self._pictures
        first.save(
            self.outfile,
            save_all=True,
            append_images=rest,
            duration=1000 // self.fps,
            loop=0,
            comment=self._comment,
        )


class _Scene:
    """The figure that frames are drawn into, one after the other."""

    def __init__(self, frame: Picture) -> None:
        panels = 1 if frame.smallest is None else 2
        extent = np.ptp(frame.state.graph.x, axis=0)
        # A panel less its colour bar, with room for the title.
        height = float(np.clip((PANEL - 1.2) * extent[1] / extent[0] + 0.9, 2.0, 1.5 * PANEL))
        self.figure: Figure = new_figure(PANEL * panels, height)
        self._axes = list(self.figure.subplots(1, panels, squeeze=False)[0])
        colours: list[tuple[Colormap, Normalize]] = [(ListedColormap(ORDER_COLOURS), ORDER_SCALE)]
        if frame.smallest is not None:
            colours.append((mpl.colormaps[DIVERGING], _stability_scale(frame.smallest)))
        self._colours = colours
        self._drawn: list[Any] = []
        self.show(frame)
        for (palette, scale), ax in zip(colours, self._axes, strict=True):
            _colour_bar(ScalarMappable(scale, palette), ax)

    def show(self, frame: Picture) -> None:
        """Replace the loops by those of a frame."""
        for artist in self._drawn:
            artist.remove()
        state = frame.state
        draw = loop_drawer(state)
        values: list[NDArray[Any]] = [np.minimum(state.faces.order[state.faces.loops], LAST_ORDER)]
        if frame.smallest is not None:
            values.append(frame.smallest)
        self._drawn = [
            draw(ax, value, *colours)
            for ax, value, colours in zip(self._axes, values, self._colours, strict=True)
        ]
        self.figure.suptitle(frame.title)


def _stability_scale(smallest: Floats) -> Normalize:
    """Zero in the middle; the negative side, often empty at first, reaches a quarter as far."""
    known = smallest[np.isfinite(smallest) & (smallest > 0)]
    high = float(np.percentile(known, 95)) if len(known) else 1.0
    return TwoSlopeNorm(0.0, vmin=-0.25 * high, vmax=high)


def _colour_bar(colours: ScalarMappable, ax: Axes) -> None:
    if colours.norm is ORDER_SCALE:
        order_bar(colours, ax)
        return
    bar = figure_of(ax).colorbar(colours, ax=ax, shrink=0.75, extend="both")
    low, high = colours.get_clim()
    ticks = [low, 0.0, 0.5 * high, high]
    bar.set_ticks(ticks, labels=[f"{tick:.2g}" for tick in ticks])
    bar.set_label(r"smallest eigenvalue of $K_s$ / mean $k_n$")
