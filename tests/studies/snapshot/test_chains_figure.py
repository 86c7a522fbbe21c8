"""The figure of force chains: many links are drawn as few lines, and look the same."""

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection

from loops import find_faces, force_chains
from studies.snapshot import figures
from studies.snapshot.figures import chain_segments, loop_drawer
from studies.snapshot.table import loop_columns
from tests.studies.snapshot.test_table import synthetic_snapshot


@pytest.fixture(scope="module")
def drawn_with():
    snapshot = synthetic_snapshot(2000)
    faces, chains = find_faces(snapshot.graph), force_chains(snapshot.graph)
    table = loop_columns(snapshot)
    table["chain_contacts"] = chains.on_loops(faces)
    links, draw = chain_segments(snapshot, chains), loop_drawer(snapshot)
    assert len(links) > 150

    def pixels(limit):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(figures, "VECTOR_LIMIT", limit)
            patch.setattr(figures, "JOINED", 20)
            figure = figures.places_figure(table, draw, links)
        lines = [c for c in figure.axes[0].collections if isinstance(c, LineCollection)]
        canvas = FigureCanvasAgg(figure)
        canvas.draw()
        return lines, np.asarray(canvas.buffer_rgba())[..., :3].astype(float)

    return links, pixels


def test_each_link_is_there_once(drawn_with, monkeypatch):
    monkeypatch.setattr(figures, "JOINED", 20)
    links, _ = drawn_with
    points = np.concatenate(figures._joined(links)).reshape(-1, 3, 2)
    assert np.isnan(points[:, 2]).all()
    order = [np.lexsort(ends.reshape(-1, 4).T) for ends in (points[:, :2], links)]
    assert np.array_equal(points[order[0], :2], links[order[1]])
