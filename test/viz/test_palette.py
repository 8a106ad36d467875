# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Colours are told apart with every kind of colour vision, and a kerb beside a ramp is seen."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml
from matplotlib.colors import Normalize
from PIL import Image
from repository import ROOT

from heightmap25d_ros.grid.height_map import HeightMap
from heightmap25d_ros.viz import map_figures, palette

# Machado, Oliveira and Fernandes 2009, severity 1.0: of linear red, green and blue.
VISION = {
    "normal": np.eye(3),
    "protanopia": np.array([
        [0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216],
        [-0.003882, -0.048116, 1.051998],
    ]),
    "deuteranopia": np.array([
        [0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413],
        [-0.011820, 0.042940, 0.968881],
    ]),
    "tritanopia": np.array([
        [1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602],
        [0.004733, 0.691367, 0.303900],
    ]),
}  # fmt: skip
XYZ = np.array([
    [0.4124564, 0.3575761, 0.1804375], [0.2126729, 0.7151522, 0.0721750],
    [0.0193339, 0.1191920, 0.9503041],
])  # fmt: skip


def lab(rgb: np.ndarray, vision: str = "normal") -> np.ndarray:
    """CIELAB (..., 3) of sRGB colours 0 .. 255, as someone sees them."""
    share = np.asarray(rgb, float) / 255.0
    linear = np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)
    seen = np.clip(linear @ VISION[vision].T, 0.0, 1.0) @ XYZ.T / (0.95047, 1.0, 1.08883)
    x, y, z = np.moveaxis(np.where(seen > 0.008856, np.cbrt(seen), 7.787 * seen + 16 / 116), -1, 0)
    return np.stack([116 * y - 16, 500 * (x - y), 200 * (y - z)], axis=-1)


def heights() -> np.ndarray:
    return 255.0 * palette.HEIGHTS(np.linspace(0.0, 1.0, 256))[:, :3]


@pytest.mark.parametrize("vision", VISION)
def test_heights_are_ordered_by_lightness(vision: str) -> None:
    steps = np.diff(lab(heights()[::8], vision)[:, 0])
    assert (steps > 0.5).all()


def test_heights_are_perceptually_uniform() -> None:
    steps = np.linalg.norm(np.diff(lab(heights()[::16]), axis=0), axis=-1)
    assert steps.max() < 2.0 * steps.min()


@pytest.mark.parametrize("vision", VISION)
@pytest.mark.parametrize("colour", [palette.UNKNOWN, palette.OCCUPIED, palette.FRONTIER])
def test_cells_are_told_from_every_height(vision: str, colour: str) -> None:
    away = np.linalg.norm(lab(heights(), vision) - lab(palette.rgb(colour), vision), axis=-1)
    assert away.min() > 18.0


@pytest.mark.parametrize("vision", VISION)
@pytest.mark.parametrize(
    "line",
    [
        palette.DRIVEN_LINE, palette.PLANNED_LINE, palette.CORRECTED_LINE, palette.ODOMETRY_LINE,
        palette.TRUTH_LINE,
    ],
    ids=lambda line: line["label"],
)  # fmt: skip
def test_lines_or_their_rims_are_told_from_every_height(vision: str, line: dict) -> None:
    rim = line["path_effects"][0]._gc["foreground"]
    away = [
        np.linalg.norm(lab(heights(), vision) - lab(palette.rgb(colour), vision), axis=-1)
        for colour in (line["color"], rim)
    ]
    assert np.max(away, axis=0).min() > 20.0


def test_level_ground_keeps_the_colours_of_the_scale() -> None:
    metres = np.full((5, 7), 0.4)
    metres[0, :3] = np.nan
    np.testing.assert_array_equal(palette.hillshade(metres, 0.1), np.ones((5, 7)))
    picture = palette.relief(metres, 0.1, Normalize(0.0, 1.0))
    colour = np.rint(255.0 * np.array(palette.HEIGHTS(0.4)))
    np.testing.assert_array_equal(picture[np.isfinite(metres)], np.tile(colour, (32, 1)))
    assert not picture[np.isnan(metres)].any()


def test_slopes_towards_the_light_are_brighter() -> None:
    west_to_east = np.arange(9.0) * np.ones((9, 1)) * 0.03
    for metres in (west_to_east, -west_to_east.T):  # face west, face north
        assert palette.hillshade(metres, 0.1)[4, 4] > 1.05
        assert palette.hillshade(-metres, 0.1)[4, 4] < 0.95


@pytest.mark.parametrize("resolution", [0.0625, 0.125, 0.25])
@pytest.mark.parametrize("turns", range(4))
@pytest.mark.parametrize("is_diagonal", [False, True])
def test_a_step_of_10_cm_is_seen_in_every_direction(
    resolution: float, turns: int, is_diagonal: bool
) -> None:
    row, column = np.indices((12, 12))
    is_high = row + column >= 12 if is_diagonal else column >= 6
    brightness = palette.hillshade(np.rot90(np.where(is_high, 0.1, 0.0), turns), resolution)
    edge = brightness[3:9, 3:9]  # without the map's border
    assert np.abs(edge - 1.0).max() > 0.15


def test_noise_of_a_centimetre_is_not_terrain() -> None:
    noise = 0.01 * np.round(np.random.default_rng(1).normal(0.0, 0.5, (50, 50)))
    assert np.abs(palette.hillshade(noise, 0.125) - 1.0).mean() < 0.03


def test_kerb_of_10_cm_is_seen_beside_a_ramp_of_150_cm(tmp_path: Path) -> None:
    metres = np.zeros((40, 160))
    metres[:12] = np.clip((np.arange(160) * 0.125 - 5.0) / 10.0, 0.0, 1.0) * 1.5  # along x
    metres[24:] = 0.1  # the pavement beyond the kerb
    map_figures.height_map(tmp_path / "kerb.png", HeightMap.from_metres(metres, resolution=0.125))
    with Image.open(tmp_path / "kerb.png") as image:
        seen = np.asarray(image.convert("RGB"))
    column = lab(seen[:, seen.shape[1] // 4])
    is_road = np.linalg.norm(column - lab(255 * np.array(palette.HEIGHTS(0.0)[:3])), axis=-1) < 1.0
    level = 255 * np.array(palette.HEIGHTS(0.1 / 1.5)[:3])
    is_pavement = np.linalg.norm(column - lab(level), axis=-1) < 1.0
    road, pavement = np.flatnonzero(is_road), np.flatnonzero(is_pavement)
    assert len(road) > 50
    assert len(pavement) > 50
    kerb = column[pavement.max() + 1 : road.min()]
    assert len(kerb) > 5  # pixels
    against_road = np.linalg.norm(kerb - column[road[0]], axis=-1)
    against_pavement = np.linalg.norm(kerb - column[pavement[0]], axis=-1)
    assert np.minimum(against_road, against_pavement).max() > 10.0
    assert np.ptp(kerb[:, 0]) > 15.0  # lightness: its upper edge bright, its lower edge dark


def test_rviz_has_the_same_colours() -> None:
    config = yaml.safe_load((ROOT / "rviz" / "heightmap25d.rviz").read_text())
    displays = {display["Name"]: display for display in config["Visualization Manager"]["Displays"]}
    for name, colour in (
        ("Frontier of the known", palette.FRONTIER),
        ("Plan", palette.PLANNED),
    ):
        assert displays[name]["Color"] == "; ".join(map(str, palette.rgb(colour)))
    for name, colour in (("Pose in the map", palette.CORRECTED),):
        assert displays[name]["Color"] == "; ".join(map(str, palette.rgb(colour)))
    odometry = displays["Pose by odometry"]["Shape"]["Color"]
    assert odometry == "; ".join(map(str, palette.rgb(palette.ODOMETRY)))
    for key, at in (("Min Color", 0.0), ("Max Color", 1.0)):
        ends = "; ".join(str(round(255 * part)) for part in palette.HEIGHTS(at)[:3])
        assert displays["Heights (height_points)"][key] == ends
