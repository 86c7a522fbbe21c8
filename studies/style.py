"""The look of every figure: one palette, one size of type, and its source in every file."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from functools import wraps
from io import BytesIO
from itertools import chain
from pathlib import Path
from typing import Any, cast

import matplotlib as mpl
import numpy as np
from matplotlib.animation import AbstractMovieWriter, FFMpegWriter, PillowWriter
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.image import imsave
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.patheffects import AbstractPathEffect, withStroke
from matplotlib.projections.polar import PolarAxes

from loops import InputError
from studies.output import as_json

# Okabe and Ito's palette, told apart with any colour vision, but for yellow: too light for lines.
BLACK, ORANGE, SKY, GREEN = "#000000", "#E69F00", "#56B4E9", "#009E73"
BLUE, VERMILION, PURPLE = "#0072B2", "#D55E00", "#CC79A7"
GREY, LIGHT_GREY = "#767676", "#D9D9D9"
# Colours of the loops by order, from 3 on; the last one stands for all larger orders.
ORDER_COLOURS = (BLUE, SKY, GREEN, ORANGE, VERMILION, PURPLE)
LINE_COLOURS = (BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY, BLACK)
# Continuous maps that keep their order with any colour vision and in grey.
SEQUENTIAL = "cividis"
DIVERGING = "PuOr"

# A white edge around letters over lines.
WHITE_EDGE: list[AbstractPathEffect] = [withStroke(linewidth=2.0, foreground="white")]

# Widths of one and of two columns of a journal, 86 and 178 mm, in inches.
ONE_COLUMN = 86 / 25.4
TWO_COLUMNS = 178 / 25.4
# Height of a page, in inches.
PAGE = 9.3
WIDTHS = {"single": ONE_COLUMN, "double": TWO_COLUMNS}
FRAMES_PER_SECOND = 4
FRAME_DPI = 110
# Least height of a figure (inches): in a lower one the labels of the axes are cut.
LOWEST = 2.4
# Largest number of panels that fit on a page one below the other.
STACKED = 6

# Keys of title, program and provenance by the format of a figure, and the date that is left out.
METADATA = {
    "png": ("Title", "Software", "Description"),
    "svg": ("Title", "Creator", "Description", "Date"),
    "pdf": ("Title", "Creator", "Subject", "CreationDate"),
}

# Settings of matplotlib.
SHEET = Path(__file__).with_name("figures.mplstyle")
STYLE = mpl.rc_params_from_file(SHEET, use_default_template=False)


@contextmanager
def styled() -> Iterator[None]:
    """Apply the platform's settings of matplotlib, as a context or as a decorator `@styled()`.

    Artists take their settings when they are created: the whole drawing function is decorated.
    Other figures of the caller keep the caller's settings.
    """
    with mpl.rc_context(STYLE):
        yield


# The one setting of a session, as matplotlib's own: the front door offers `figure_width` to set it.
_journal_width: str | None = None


def figure_width(name: str | None) -> None:
    """Give figures from now on the width of one or of two columns of a journal.

    Letters keep their size. In one column panels stand below one another; figures of more than
    six panels keep two columns.

    Parameters
    ----------
    name : str or None
        single (86 mm) or double (178 mm); None: each figure as wide as what it shows.

    Raises
    ------
    InputError
        For another word.

    Examples
    --------
    >>> figure_width("single")
    >>> round(float(new_figure().get_figwidth() * 25.4), 1)
    86.0
    >>> figure_width(None)
    """
    global _journal_width
    if name not in (None, *WIDTHS):
        raise InputError("figure width", repr(name), "single or double", "Pick one of these.")
    _journal_width = name


@styled()
def new_figure(width: float = ONE_COLUMN, height: float = 2.5, *, fixed: bool = False) -> Figure:
    """An empty figure without global state, whose layout keeps labels apart.

    Unless `fixed` it has the width set by `figure_width`; its height changes by half as much.
    """
    asked = width if fixed else WIDTHS.get(_journal_width or "", width)
    tall = max(height * (asked / width) ** 0.5, min(height, LOWEST))
    return Figure(figsize=(asked, tall), layout="constrained")


@styled()
def new_panels(
    rows: int, columns: int, height: float, width: float = TWO_COLUMNS, **how: Any
) -> tuple[Figure, Any]:
    """A figure and its (rows, columns) panels, one below the other in a single column."""
    count = rows * columns
    if _journal_width != "single" or count > STACKED:
        fixed = _journal_width == "single" or columns > 1
        figure = new_figure(width, height, fixed=fixed)
        return figure, figure.subplots(rows, columns, squeeze=False, **how)
    how.pop("width_ratios", None)
    tall = min(0.8 * height / rows * count, PAGE) if columns > 1 else height
    figure = new_figure(ONE_COLUMN, tall)
    return figure, figure.subplots(count, 1, squeeze=False, **how).reshape(rows, columns)


def panel_width(columns: int) -> float:
    """Width in inches of a panel of a figure that has so many side by side in two columns."""
    return ONE_COLUMN if _journal_width == "single" else TWO_COLUMNS / columns


@styled()
def axes_or_new(
    ax: Axes | None,
    width: float = ONE_COLUMN,
    height: float = 2.5,
    projection: str = "rectilinear",
) -> Axes:
    """The axes to draw into: the caller's, or those of a new figure."""
    return new_figure(width, height).add_subplot(projection=projection) if ax is None else ax


def panel(
    width: float = ONE_COLUMN, height: float = 2.5, projection: str = "rectilinear"
) -> Callable[[Callable[..., None]], Callable[..., Axes]]:
    """A drawing in the platform's style, into the axes `ax`, else into a new figure of this size.

    It returns the axes; `size` is that of the new figure, with the projection.
    """

    def decorate(draw: Callable[..., None]) -> Callable[..., Axes]:
        @wraps(draw)
        def drawn(*given: Any, ax: Axes | None = None, **how: Any) -> Axes:
            ax = axes_or_new(ax, width, height, projection)
            with styled():
                draw(*given, ax=ax, **how)
            return ax

        vars(drawn)["size"] = width, height, projection
        return drawn

    return decorate


def figure_of(ax: Axes) -> Figure:
    """The figure that axes belong to."""
    return cast(Figure, ax.figure)


def outer_legend(ax: Axes, loc: Any, at: tuple[float, float], pad: float, **how: Any) -> None:
    """A key outside of axes, `pad` letters away from the place `at` of the axes.

    A figure without a layout gets the one that keeps the key on the page.
    """
    ax.legend(loc=loc, bbox_to_anchor=at, borderaxespad=pad, **how)
    if figure_of(ax).get_layout_engine() is None:
        figure_of(ax).set_layout_engine("constrained")


def figure_key(figure: Figure, *axes: Axes, at: str = "lower center", **how: Any) -> None:
    """One key outside of a figure, of all panels or of these, each label once."""
    shown: dict[str, Artist] = {}
    for ax in axes or figure.axes:
        for handle, label in zip(*ax.get_legend_handles_labels(), strict=True):
            shown.setdefault(label, handle)
    how["loc"] = f"outside {at}"
    figure.legend(list(shown.values()), list(shown), **how)


def polar_grid(ax: PolarAxes, rings: Any, labels: Any = None, at: float = 22.5) -> None:
    """Angles and rings of polar axes, the values of the rings along the direction `at`."""
    ax.set_thetagrids(range(0, 360, 45))
    ax.set_rticks(rings, labels)
    ax.set_rlabel_position(at)
    ax.grid(color=LIGHT_GREY, linewidth=0.5)


def shade_sectors(ax: PolarAxes, ranges: Any, reach: float, alpha: float) -> None:
    """Shade ranges of angles, such as cones."""
    for begin, end in ranges:
        arc = np.linspace(begin, end, 181)
        ax.fill_between(arc, 0.0, reach, color=ORANGE, alpha=alpha, linewidth=0)


def tick_labels(ticks: Any) -> list[str]:
    """Numbers with a minus sign, not a hyphen; powers of ten that are large or small as such."""
    power = re.compile(r"(?<![\d.])1e\+?(-?)0*(\d+)")
    written = (power.sub(r"$10^{\1\2}$", f"{tick:.4g}") for tick in ticks)
    return [text.replace("-", "\N{MINUS SIGN}") for text in written]


def key_columns(figure: Figure, wide: int) -> int:
    """Columns of a key below a figure: so many in two columns of a journal, two in one."""
    return wide if figure.get_figwidth() > 1.5 * ONE_COLUMN else min(wide, 2)


def edge_ticks(ax: Axes, at: Any, label: str = "", colour: str = GREY) -> None:
    """Mark places on the lower edge of axes; nothing, which would upset the layout, if none."""
    if len(at):
        look: Any = {"color": colour, "markersize": 8, "label": label or "_", "clip_on": False}
        ax.plot(at, np.zeros(len(at)), "|", transform=ax.get_xaxis_transform(), **look)


def drawn_file(
    fig: Figure, name: str, source: Mapping[str, Any], kind: str = "png"
) -> Callable[[], bytes]:
    """Draw a figure; return what packs it as PNG (300 dpi), SVG or PDF, in any thread.

    The provenance is in the metadata as JSON. No date is written: the same numbers give the same
    bytes.
    """
    made_by = f"{source.get('command', 'grainloops')}, version {source.get('version', 'unknown')}"
    keys = METADATA[kind]
    said = dict(zip(keys, (name, made_by, as_json(source), None), strict=False))
    file: Any = BytesIO()
    with styled():
        fig.set_dpi(mpl.rcParams["savefig.dpi"])
        canvas = FigureCanvasAgg(fig)
        if (engine := fig.get_layout_engine()) is not None:
            # By `savefig` everything would be drawn once more for the layout.
            if any(ax.get_aspect() == 1.0 and ax.name == "rectilinear" for ax in fig.axes):
                # With room for what axes of equal units need: their labels would be cut.
                fig.set_layout_engine(engine := ConstrainedLayoutEngine(compress=True))
            engine.execute(fig)
            fig.set_layout_engine(None)
        if kind != "png":
            fig.savefig(file, format=kind, metadata=said)
            return cast(Callable[[], bytes], file.getvalue)
        canvas.draw()
    # The file is a tenth larger than by default, and takes two thirds of the time.
    how: Any = {"metadata": said, "dpi": fig.dpi, "pil_kwargs": {"compress_level": 3}}

    def pack() -> bytes:
        imsave(file, canvas.buffer_rgba(), format="png", origin="upper", **how)
        return bytes(file.getvalue())

    return pack


def write_animation(
    folder: Path, figure: Figure, changes: Iterable[None], source: Mapping[str, Any]
) -> list[Path]:
    """Write `animation.gif`, and `animation.mp4` if the program ffmpeg is installed.

    The first frame is the figure as it is; one more follows each of the changes to it.
    """
    writers: dict[str, AbstractMovieWriter] = {"animation.gif": PillowWriter(FRAMES_PER_SECOND)}
    if FFMpegWriter.isAvailable():
        metadata = {"comment": as_json(source)}
        writers["animation.mp4"] = FFMpegWriter(FRAMES_PER_SECOND, metadata=metadata)
    with ExitStack() as stack:
        for name, writer in writers.items():
            stack.enter_context(writer.saving(figure, str(folder / name), FRAME_DPI))
        for _ in chain([None], changes):
            for writer in writers.values():
                writer.grab_frame()
    return [folder / name for name in writers]
