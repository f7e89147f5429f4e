"""Figures as files: each is a readable picture of its own, made the same way every time."""

from __future__ import annotations

from pathlib import Path

from flex_payload_estimator.tools import figures
from flex_payload_estimator.tools.figures import FIGURES
from matplotlib.figure import Figure
from matplotlib.image import imread
import numpy as np
import pytest


def test_tool_draws_them_all(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert figures.main(['--out', str(tmp_path / 'new' / 'folder')]) == 0
    made = sorted((tmp_path / 'new' / 'folder').iterdir())
    assert [path.stem for path in made] == sorted(FIGURES)
    pictures = [imread(path) for path in made]
    for picture in pictures:
        assert picture.shape[:2] == (672, 960)
        # Drawn over: neither blank nor black.
        assert 0.5 < np.mean(picture[..., :3]) < 0.99
    assert len({picture.tobytes() for picture in pictures}) == len(FIGURES)
    assert capsys.readouterr().out.count('.png') == len(FIGURES)


def test_a_figure_is_the_same_every_time(tmp_path: Path) -> None:
    first = figures.write_figure('figure_18', tmp_path).read_bytes()
    assert figures.write_figure('figure_18', tmp_path).read_bytes() == first


def test_figure_13_shows_modes_with_one_zero_more_each() -> None:
    """Mode i crosses zero i - 1 times between clamp and tip, and ends at +-1."""
    figure = Figure()
    figures.figure_13(figure)
    lines = figure.axes[0].get_lines()
    for i, line in enumerate(lines):
        values = np.asarray(line.get_ydata())
        assert np.sum(np.diff(np.sign(values[5:])) != 0) == i
        assert abs(values[-1]) == pytest.approx(1.0)


def test_figure_18_crosses_at_the_roots() -> None:
    figure = Figure()
    figures.figure_18(figure)
    cosine, other, roots = figure.axes[0].get_lines()
    x = np.asarray(cosine.get_xdata())
    difference = np.asarray(cosine.get_ydata()) - np.asarray(other.get_ydata())
    crossings = x[1:][difference[1:] * difference[:-1] < 0.0]
    np.testing.assert_allclose(crossings, np.asarray(roots.get_xdata()), atol=0.03)


def test_delta_figure_says_what_the_text_says() -> None:
    """At T = 1e-6 the delta form keeps 15 digits of A-bar's size, the shift form under 12."""
    figure = Figure()
    figures.figure_delta(figure)
    shift, delta = figure.axes[0].get_lines()[:2]
    at = int(np.argmin(np.abs(np.log10(np.asarray(shift.get_xdata())) + 6.0)))
    assert np.asarray(delta.get_ydata())[at] < 1e-15
    assert np.asarray(shift.get_ydata())[at] > 1e-12
    assert np.asarray(shift.get_ydata())[at] > 1e3 * np.asarray(delta.get_ydata())[at]


def test_no_folder_can_be_made_in_a_file(tmp_path: Path,
                                         capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / 'file').write_text('')
    assert figures.main(['--out', str(tmp_path / 'file' / 'out')]) == 2
    shown = capsys.readouterr().err
    assert shown.startswith(f'error: --out: {tmp_path / "file" / "out"}: expected a folder')
    assert shown.count('\n') == 1
