# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The animation of the closed loop is small enough for a page, and its labels can be read."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from types import SimpleNamespace

import matplotlib.text
import numpy as np
from PIL import Image
from repository import ROOT

from heightmap25d_ros.grid.height_map import HeightMap
from heightmap25d_ros.viz import palette


def load():
    path = ROOT / "studies" / "closed_loop_picture.py"
    spec = importlib.util.spec_from_file_location("closed_loop_picture", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def a_map() -> HeightMap:
    metres = np.zeros((40, 120))
    metres[10:14, 50:54] = 0.6
    metres[:, 100:] = np.nan
    return HeightMap.from_metres(metres, resolution=0.125)


def a_run() -> SimpleNamespace:
    poses = np.tile(np.eye(4), (4, 1, 1))
    poses[:, 0, 3] = 2.0, 3.0, 4.0, 5.0
    poses[:, 1, 3] = 2.0
    return SimpleNamespace(
        maps=[(0.0, a_map())],
        plans=[(0.0, np.array([[2.0, 2.0], [9.0, 3.0]]))],
        driven=[(i * 10**9, T) for i, T in enumerate(poses)],
        seconds=3.0,
        sent_at=[0.0],
    )


def test_animation_is_small_and_has_all_colours(tmp_path: Path) -> None:
    picture = load()
    picture.animate(tmp_path / "run.gif", a_run(), [(9.0, 3.0)])
    assert (tmp_path / "run.gif").stat().st_size < 1_500_000
    with Image.open(tmp_path / "run.gif") as image:
        assert image.n_frames >= 3  # equal ones are merged
        assert image.size[0] <= 900
        seen = np.asarray(image.convert("RGB")).astype(int)
    for colour in (palette.OCCUPIED, palette.DRIVEN, palette.WALL, palette.UNKNOWN):
        assert (np.abs(seen - palette.rgb(colour)).max(axis=-1) < 12).sum() > 20


def test_labels_are_at_least_9_points_and_name_everything() -> None:
    picture = load()
    figure, _ = picture._stage(a_map(), palette.height_norm(a_map().metres))
    texts = [t for t in figure.findobj(matplotlib.text.Text) if t.get_text().strip()]
    assert min(text.get_fontsize() for text in texts) >= 9.0
    assert picture.DPI >= 96  # points at their size on a screen
    labels = {text.get_text() for text in texts}
    assert labels >= {
        "driven path", "planned path", "robot", "goal", "occupied", "unknown",
        "wall or ledge without known ground", "height [m]", "x [m]", "y [m]",
    }  # fmt: skip
