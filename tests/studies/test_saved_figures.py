"""Figures saved by two processes are those that one saves, and what goes wrong is said."""

import pytest

from studies import style


@pytest.fixture
def figures():
    drawn = {name: style.new_figure(2.0, 1.5) for name in "abc"}
    for k, figure in enumerate(drawn.values()):
        for ax in figure.subplots(1, k + 1, squeeze=False)[0]:
            ax.plot([0, k])
    return drawn


@pytest.mark.parametrize("cores", [1, 2])
def test_all_are_saved_as_one_by_one(figures, cores, tmp_path, monkeypatch):
    monkeypatch.setattr(style, "available_cores", lambda: cores)
    (tmp_path / "one").mkdir()
    style.save_figures(figures, tmp_path, {})
    for name, figure in figures.items():
        style.save_figure(figure, tmp_path / "one", name, {})
        for file in (f"{name}.png", f"{name}.svg"):
            assert (tmp_path / file).read_bytes() == (tmp_path / "one" / file).read_bytes(), file


def test_what_the_copy_could_not_save_is_told(figures, tmp_path, monkeypatch):
    monkeypatch.setattr(style, "available_cores", lambda: 2)
    (tmp_path / "b.png").mkdir()  # of three panels, two and one: the second
    with pytest.raises(IsADirectoryError):
        style.save_figures(figures, tmp_path, {})
    assert (tmp_path / "c.png").is_file() and (tmp_path / "a.png").is_file()
