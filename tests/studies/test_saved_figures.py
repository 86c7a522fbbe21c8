"""Figures saved with one layout are those that matplotlib saves, one by one."""

from io import BytesIO

import numpy as np
import pytest
from PIL import Image

from studies import style


def drawn(panels):
    figure = style.new_figure(2.0, 1.5)
    with style.styled():
        for k, ax in enumerate(figure.subplots(1, panels, squeeze=False)[0]):
            ax.plot([0, 10.0**k], label="$K_s$")
            ax.set(title="title", xlabel="strain $E_1$ (–)")
            ax.legend()
    return figure


@pytest.mark.parametrize("panels", [1, 2])
def test_pictures_are_matplotlib_s_own(tmp_path, panels):
    style.save_figure(drawn(panels), tmp_path, "a", {})
    saved, own = Image.open(tmp_path / "a.png"), BytesIO()
    with style.styled():
        drawn(panels).savefig(own, format="png")
    assert np.array_equal(np.asarray(saved), np.asarray(Image.open(own)))
    assert saved.info["dpi"] == pytest.approx((300, 300), abs=0.1)
    assert saved.text["Title"] == "a"


def test_the_same_numbers_give_the_same_files(tmp_path):
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
        for panels, figure in ((2, "a"), (1, "b")):
            style.save_figure(drawn(panels), tmp_path / name, figure, {"command": "here"})
    files = sorted(file.name for file in (tmp_path / "one").iterdir())
    assert files == ["a.png", "a.svg", "b.png", "b.svg"]
    for file in files:
        assert (tmp_path / "one" / file).read_bytes() == (tmp_path / "two" / file).read_bytes()
    assert "<dc:title>a</dc:title>" in (tmp_path / "one" / "a.svg").read_text()
