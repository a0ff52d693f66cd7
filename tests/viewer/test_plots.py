"""Plots of lines: nothing is cut off at the edge."""

from __future__ import annotations

import numpy as np
import pytest
from PIL import Image

from posecast.errors import ConfigError
from posecast.viewer.plots import lines

WORDS = {"across": "minutes", "upright": "speed", "title": "a title"}


@pytest.mark.parametrize(
    "name", ["a", "mean-pose-of-all", "amass-seq2seq-sampling-dropout-spl-small"]
)
def test_the_longest_name_fits_beside_the_plot(name, tmp_path):
    curves = {name: [(0.0, 0.1), (1.0, 0.5)], "b": [(0.0, 0.2), (1.0, 0.9)]}
    lines(curves, tmp_path / "a.png", levels={"frozen below": 0.1}, **WORDS)
    with Image.open(tmp_path / "a.png") as picture:
        pixels = np.asarray(picture.convert("L"))
    assert pixels[:, -4:].min() == 255
    assert pixels[:, -pixels.shape[1] // 4 :].min() < 255  # names are there, not left out


def test_nothing_to_plot_is_refused(tmp_path):
    with pytest.raises(ConfigError, match="give at least one curve"):
        lines({"a": []}, tmp_path / "a.png", **WORDS)
    assert not (tmp_path / "a.png").exists()
