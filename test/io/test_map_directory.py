# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Map directories: golden files, map_server's own rules, round trips, damage, crashes."""

from __future__ import annotations

import io
import os
import textwrap
import zipfile
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import yaml
from hypothesis import HealthCheck, assume, given
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst
from PIL import Image
from properties import draws

from heightmap25d_ros.errors import InputError
from heightmap25d_ros.grid.height_map import Geometry, HeightMap
from heightmap25d_ros.grid.levels import UpperSurfaces
from heightmap25d_ros.io import map_directory, trajectory

GEOMETRY = Geometry(resolution=0.125, origin=(-2.0, -4.25), shape=(2, 3))
OCCUPANCY = np.array([[0, 100, -1], [-1, 0, 0]], np.int8)


def height_map(**changes: Any) -> HeightMap:
    values = {
        "geometry": GEOMETRY,
        "height": np.array([[1, -200, 0], [0, 32700, -32700]], np.int16),
        "probability": np.array([[40000, 65535, 0], [1, 52428, 33000]], np.uint16),
        "probability_threshold": 0.5,
    }
    return HeightMap(**(values | changes))


def obstacle_map(
    occupancy: np.ndarray = OCCUPANCY, geometry: Geometry = GEOMETRY
) -> SimpleNamespace:
    return SimpleNamespace(geometry=geometry, occupancy=occupancy)


def map_server(directory: Path) -> SimpleNamespace:
    """What map_server publishes of a map, by the rules of its documentation.

    The lightness of a pixel is its value of 255; how occupied it is, is one minus that (negate
    false). Trinary: above occupied_thresh 100, below free_thresh 0, otherwise -1. The image's
    first row is the grid's last one. The origin is the pose of the lower left pixel.
    """
    facts = yaml.safe_load((directory / "map.yaml").read_text())
    assert facts["mode"] == "trinary"
    assert facts["negate"] == 0
    with Image.open(directory / facts["image"]) as image:
        assert image.mode == "L"
        shade = np.asarray(image) / 255.0
    occupied = 1.0 - shade
    data = np.full(shade.shape, -1)
    data[occupied > facts["occupied_thresh"]] = 100
    data[occupied < facts["free_thresh"]] = 0
    return SimpleNamespace(
        data=data[::-1], resolution=facts["resolution"], origin=tuple(facts["origin"])
    )


def saved(directory: Path, **changes: Any) -> Path:
    map_directory.save(directory, height_map(**changes), obstacle_map(), "map")
    return directory


def test_golden_yaml_and_pgm(tmp_path: Path) -> None:
    directory = saved(tmp_path / "room")
    assert (directory / "map.yaml").read_text() == textwrap.dedent(
        """\
        image: map.pgm
        mode: trinary
        resolution: 0.125
        origin: [-2.0, -4.25, 0.0]
        negate: 0
        occupied_thresh: 0.65
        free_thresh: 0.196
        """
    )
    pixels = [205, 254, 254, 254, 0, 205]  # the row of larger y comes first
    assert (directory / "map.pgm").read_bytes() == b"P5\n3 2\n255\n" + bytes(pixels)
    assert sorted(path.name for path in directory.iterdir()) == [
        "height_grid.npz",
        "map.pgm",
        "map.yaml",
    ]


def test_npz_holds_what_the_format_names(tmp_path: Path) -> None:
    with np.load(saved(tmp_path / "room") / "height_grid.npz", allow_pickle=False) as archive:
        assert set(archive) == {
            "height",
            "probability",
            "probability_scale",
            "height_resolution",
            "resolution",
            "origin",
            "frame_id",
            "format_version",
        }
        assert archive["height"].dtype == np.int16
        np.testing.assert_array_equal(archive["height"], [[1, -200, 0], [0, 32700, -32700]])
        assert archive["probability"].dtype == np.float32
        expected = np.array([[40000, 65535, 0], [1, 52428, 33000]]) / 65535
        np.testing.assert_allclose(
            archive["probability"] * archive["probability_scale"], expected, rtol=1e-6
        )
        assert archive["height_resolution"] == 0.01
        assert archive["resolution"] == 0.125
        np.testing.assert_array_equal(archive["origin"], [-2.0, -4.25])
        assert archive["frame_id"] == "map"
        assert archive["format_version"] == 1


coordinates = st.integers(-10_000, 10_000)
shapes = st.tuples(st.integers(1, 12), st.integers(1, 12))


@given(
    shapes.flatmap(
        lambda shape: st.tuples(
            npst.arrays(np.int16, shape, elements=st.integers(-32700, 32700)),
            npst.arrays(np.uint16, shape),
            npst.arrays(np.int8, shape, elements=st.sampled_from([-1, 0, 100])),
        )
    ),
    st.sampled_from([0.01, 0.05, 0.125, 0.3, 1.0]),
    coordinates,
    coordinates,
    st.sampled_from(["map", "odom", "Karte_ä"]),
)
def test_round_trip(tmp_path_factory, arrays, resolution, ix, iy, frame_id) -> None:
    height, probability, occupancy = arrays
    geometry = Geometry(
        resolution=resolution, origin=(ix * resolution, iy * resolution), shape=height.shape
    )
    given_map = height_map(geometry=geometry, height=height, probability=probability)
    assume(given_map.known.any())
    directory = tmp_path_factory.mktemp("maps") / "room"
    map_directory.save(directory, given_map, obstacle_map(occupancy, geometry), frame_id)

    loaded = map_directory.load(directory, 0.5)
    assert loaded.frame_id == frame_id
    assert loaded.height_map.geometry == geometry
    np.testing.assert_array_equal(loaded.height_map.height, height)
    np.testing.assert_array_equal(loaded.height_map.probability, probability)
    np.testing.assert_array_equal(loaded.height_map.known, given_map.known)

    served = map_server(directory)
    np.testing.assert_array_equal(served.data, occupancy)
    assert served.resolution == resolution
    assert served.origin == (*geometry.origin, 0.0)


def test_same_map_gives_the_same_bytes(tmp_path: Path) -> None:
    first, second = saved(tmp_path / "a"), saved(tmp_path / "b")
    for path in first.iterdir():
        assert path.read_bytes() == (second / path.name).read_bytes()
    assert map_directory.digest(first) == map_directory.digest(second)
    changed = height_map(height=np.zeros((2, 3), np.int16))
    map_directory.save(second, changed, obstacle_map(), "map")
    assert map_directory.digest(first) != map_directory.digest(second)


def test_replacing_keeps_other_files(tmp_path: Path) -> None:
    directory = saved(tmp_path / "room")
    (directory / "plan.tum").write_text("0 0 0 0 0 0 0 1\n")
    map_directory.save(
        directory, height_map(probability_threshold=0.7), obstacle_map(-OCCUPANCY), "odom"
    )
    assert map_directory.load(directory, 0.5).frame_id == "odom"
    assert (directory / "plan.tum").read_text() == "0 0 0 0 0 0 0 1\n"
    assert [path.name for path in tmp_path.iterdir()] == ["room"]


def test_directory_that_is_no_maps_is_not_replaced(tmp_path: Path) -> None:
    (tmp_path / "home" / "photos").mkdir(parents=True)
    with pytest.raises(InputError, match="photos"):
        map_directory.save(tmp_path / "home", height_map(), obstacle_map(), "map")
    assert [path.name for path in tmp_path.rglob("*")] == ["home", "photos"]


def test_file_system_that_cannot_exchange_directories(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr("heightmap25d_ros.io.atomic_directory._exchange", lambda *_: False)
    directory = saved(tmp_path / "room")
    map_directory.save(directory, height_map(), obstacle_map(), "odom")
    assert map_directory.load(directory, 0.5).frame_id == "odom"
    assert [path.name for path in tmp_path.iterdir()] == ["room"]


def test_failing_to_write_is_reported_and_leaves_nothing(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    for target in (tmp_path / "file", tmp_path / "file" / "room"):
        with pytest.raises(InputError, match="cannot be written"):
            map_directory.save(target, height_map(), obstacle_map(), "map")
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_map_without_cells_is_not_saved(tmp_path: Path) -> None:
    geometry = Geometry(resolution=0.125, origin=(0.0, 0.0), shape=(0, 0))
    empty = height_map(
        geometry=geometry, height=np.zeros((0, 0), np.int16), probability=np.zeros((0, 0), "u2")
    )
    with pytest.raises(InputError, match="nothing has been mapped"):
        map_directory.save(
            tmp_path / "a", empty, obstacle_map(np.zeros((0, 0), "i1"), geometry), "map"
        )
    with pytest.raises(ValueError, match="same cells"):
        map_directory.save(tmp_path / "a", height_map(), obstacle_map(OCCUPANCY, geometry), "map")


def test_map_without_known_cells_replaces_none(tmp_path: Path) -> None:
    """Also where something was observed, but too little to know a height."""
    directory = saved(tmp_path / "room")
    for probability in (0, 30000):
        empty = height_map(probability=np.full((2, 3), probability, np.uint16))
        with pytest.raises(InputError, match=f"{6 * (probability > 0)} cells were observed"):
            map_directory.save(directory, empty, obstacle_map(), "odom")
    assert map_directory.load(directory, 0.5).frame_id == "map"


def test_names_of_maps(tmp_path: Path) -> None:
    root = tmp_path / "maps"
    (root / "inner").mkdir(parents=True)
    (root / "out").symlink_to(tmp_path)
    (root / "in").symlink_to(root / "inner")
    assert map_directory.map_path(root, "room") == root / "room"
    assert map_directory.map_path(root, "floor 1/room") == root / "floor 1" / "room"
    assert map_directory.map_path(root, "in/room") == root / "inner" / "room"
    for name in ("", ".", "..", "../maps", "a/../../b", "/etc", str(root / "room"), "out/room",
                 "out", "a\0b", "\0", ".hidden", "a/.git", "a\nb", "a/\x1b[2J", "\ud800",
                 "x" * 300 + "/", "x" * 300 + "/room", "a/" * 1900 + "b", "ä" * 101):  # fmt: skip
        with pytest.raises(InputError) as refusal:
            map_directory.map_path(root, name)
        assert "\n" not in str(refusal.value)


def test_the_longest_name_can_be_saved(tmp_path: Path) -> None:
    for name in ("x" * 200, "ä" * 100, "a/" * 99 + "bc"):
        path = saved(map_directory.map_path(tmp_path, name))
        assert map_directory.load(path).frame_id == "map"


@draws(300, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.text(max_size=300) | st.text(alphabet="a/.\0\n", max_size=50))
def test_any_name_is_inside_or_refused(tmp_path: Path, name: str) -> None:
    with suppress(InputError):
        assert tmp_path in map_directory.map_path(tmp_path, name).parents


def rewritten(directory: Path, **changes: Any) -> None:
    """Save the file again with some fields changed, or left out (None)."""
    path = directory / "height_grid.npz"
    with np.load(path) as archive:
        fields = {name: archive[name] for name in archive.files} | changes
    np.savez(path, **{name: value for name, value in fields.items() if value is not None})


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"height": None}, "height is missing"),
        ({"format_version": None}, "format_version is missing"),
        ({"format_version": 4}, "format_version is 4, not within 1 .. 3"),
        ({"format_version": 3, "z_offset": 0.0}, "upper_cell is missing"),
        ({"format_version": 2}, "z_offset is missing"),
        ({"format_version": 2, "z_offset": np.inf}, "not a place"),
        ({"format_version": np.array([1])}, "format_version is an array"),
        ({"height": np.zeros((2, 3), np.int32)}, "height is an array"),
        ({"height": np.zeros((2, 3, 1), np.int16)}, "height is an array"),
        ({"height": np.zeros((2, 4), np.int16)}, "differ in shape"),
        ({"height": np.full((2, 3), -32768, np.int16)}, "beyond the limit"),
        ({"height": np.zeros((0, 3), "i2"), "probability": np.zeros((0, 3), "f4")}, "is empty"),
        ({"height": np.array([[None] * 3] * 2)}, "height is an array"),
        ({"probability": np.full((2, 3), np.nan, np.float32)}, "outside of 0 .. 1"),
        ({"probability": np.full((2, 3), 1.5, np.float32)}, "outside of 0 .. 1"),
        ({"probability": np.ones((2, 3), np.uint16), "probability_scale": 2.0}, "outside of 0"),
        ({"probability": np.ones((2, 3), np.float64)}, "probability is an array"),
        ({"height_resolution": 0.02}, "height_resolution is not 0.01"),
        ({"resolution": 0.0}, "resolution: 0 m is not within"),
        ({"resolution": np.nan}, "resolution: nan m is not within"),
        ({"resolution": 1e-9}, "resolution: 1e-09 m is not within"),
        ({"origin": np.array([0.0, 1e18])}, "not a place"),
        ({"origin": np.array([0.0, -1e300])}, "not a place"),
        (
            {"frame_id": np.array([0x7FFFFFFF], np.uint32).view("U1")[0:1].reshape(())},
            "frame_id: is damaged",
        ),
        ({"frame_id": np.array("a\nb")}, "is not the name of a frame"),
        ({"frame_id": np.array("m" * 101)}, "is not the name of a frame"),
        ({"origin": np.array([0.0, np.inf])}, "origin is not"),
        ({"origin": np.zeros(3)}, "origin is not"),
        ({"origin": np.zeros(1000)}, "origin is too long"),
        ({"frame_id": np.array("")}, "frame_id is empty"),
        ({"frame_id": np.array("m" * 1000)}, "frame_id is too long"),
        ({"frame_id": np.array(b"map")}, "frame_id is an array"),
        ({"su\u2590pected": np.ones((2, 3), bool)}, "'su\u2590pected' is no array of this"),
        ({"upper_top": np.zeros(0, np.int16)}, "'upper_top' is no array of this format_version"),
    ],
)
def test_fields_that_are_not_a_maps(tmp_path: Path, changes: dict[str, Any], reason: str) -> None:
    directory = saved(tmp_path / "room")
    rewritten(directory, **changes)
    with pytest.raises(InputError, match=reason) as refusal:
        map_directory.load(directory, 0.5)
    assert str(refusal.value).startswith(str(directory / "height_grid.npz"))
    assert "\n" not in str(refusal.value)


def test_probability_scaled_to_integers_is_read(tmp_path: Path) -> None:
    directory = saved(tmp_path / "room")
    stored = np.array([[0, 1, 255], [128, 254, 3]], np.uint16)
    rewritten(directory, probability=stored, probability_scale=1.0 / 255.0)
    loaded = map_directory.load(directory, 0.5)
    np.testing.assert_array_equal(loaded.height_map.probability, stored * 257)
    np.testing.assert_array_equal(loaded.height_map.known, stored >= 128)


def bomb(path: Path, shape: tuple[int, int], content: bytes) -> None:
    """An archive whose height claims a shape."""
    header = io.BytesIO()
    np.lib.format.write_array_header_1_0(
        header, {"descr": "<i2", "fortran_order": False, "shape": shape}
    )
    with zipfile.ZipFile(path, "a", zipfile.ZIP_DEFLATED) as archive:
        version = io.BytesIO()
        np.save(version, np.int64(1))
        archive.writestr("format_version.npy", version.getvalue())
        archive.writestr("height.npy", header.getvalue() + content)


def test_huge_map_is_refused_unread(tmp_path: Path) -> None:
    bomb(tmp_path / "height_grid.npz", (1 << 16, 1 << 15), b"")
    with pytest.raises(InputError, match="65536 x 32768 cells, which is too large"):
        map_directory.load(tmp_path, 0.5)


def test_truncated_array(tmp_path: Path) -> None:
    bomb(tmp_path / "height_grid.npz", (100, 100), b"\0" * 100)
    with pytest.raises(InputError, match="height: is damaged"):
        map_directory.load(tmp_path, 0.5)


def test_missing_or_foreign_file(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="No such file"):
        map_directory.load(tmp_path / "nothing", 0.5)
    (tmp_path / "height_grid.npz").write_bytes(b"not a zip archive")
    with pytest.raises(InputError, match="is damaged, or another kind"):
        map_directory.load(tmp_path, 0.5)
    (tmp_path / "height_grid.npz").unlink()
    np.savez(tmp_path / "height_grid.npz", other=np.zeros(3))
    with pytest.raises(InputError, match="format_version is missing"):
        map_directory.load(tmp_path, 0.5)


@pytest.mark.parametrize("name", ["mkdir", "open", "fsync", "rename", "link"])
def test_failure_at_any_step_keeps_the_old_map(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    """The n-th call of a function fails, for every n, until saving succeeds."""
    directory = saved(tmp_path / "room")
    (directory / "notes.txt").write_text("kept")
    real: Callable[..., Any] = getattr(os, name)
    for failing in range(1, 50):
        calls = 0

        def fails_once(*args: Any, failing: int = failing, **keywords: Any) -> Any:
            nonlocal calls
            calls += 1
            if calls == failing:
                raise OSError(28, "No space left on device")
            return real(*args, **keywords)

        monkeypatch.setattr(os, name, fails_once)
        try:
            map_directory.save(directory, height_map(), obstacle_map(OCCUPANCY[::-1]), "odom")
            break
        except InputError:
            pass
        finally:
            monkeypatch.setattr(os, name, real)
        frame_id = map_directory.load(directory, 0.5).frame_id
        expected = OCCUPANCY if frame_id == "map" else OCCUPANCY[::-1]
        np.testing.assert_array_equal(map_server(directory).data, expected)
        assert (directory / "notes.txt").read_text() == "kept"
    assert map_directory.load(directory, 0.5).frame_id == "odom"
    if name != "open":  # with which removing the old map begins as well
        assert [path.name for path in tmp_path.iterdir()] == ["room"]


def test_trajectory_as_tum(tmp_path: Path) -> None:
    quarter_turn = np.array([[0, -1, 0, 1.5], [1, 0, 0, -2], [0, 0, 1, 0.25], [0, 0, 0, 1]], float)
    path = tmp_path / "trajectory.tum"
    trajectory.write_tum(
        path, [(1_000_000_000_000_000_001, np.eye(4)), (2_500_000_000, quarter_turn)]
    )
    zero, root = "0.000000000", "0.707106781"
    assert path.read_text() == (
        f"1000000000.000000001 {zero} {zero} {zero} {zero} {zero} {zero} 1.000000000\n"
        f"2.500000000 1.500000000 -2.000000000 0.250000000 {zero} {zero} {root} {root}\n"
    )
    np.testing.assert_allclose(
        trajectory.read_tum(path),
        [[1e9, 0, 0, 0, 0, 0, 0, 1], [2.5, 1.5, -2, 0.25, 0, 0, 0.5**0.5, 0.5**0.5]],
        atol=1e-9,
    )
    trajectory.write_tum(path, [])
    assert trajectory.read_tum(path).shape == (0, 8)
    path.write_text("# t x y z qx qy qz qw\n\n1 2 3 4 0 0 0 1\n")
    np.testing.assert_array_equal(trajectory.read_tum(path), [[1, 2, 3, 4, 0, 0, 0, 1]])


@pytest.mark.parametrize(
    "content",
    ["1 2 3\n", "1 2 3 4 0 0 0 nan\n", "a b c d e f g h\n", "1 2 3 4\n5 6 7 8\n", "\0\xff"],
)
def test_file_that_is_not_tum(tmp_path: Path, content: str) -> None:
    path = tmp_path / "trajectory.tum"
    path.write_text(content, encoding="latin-1")
    with pytest.raises(InputError) as refusal:
        trajectory.read_tum(path)
    assert "\n" not in str(refusal.value)
    with pytest.raises(InputError, match="No such file"):
        trajectory.read_tum(tmp_path / "nothing.tum")
    with pytest.raises(InputError, match="cannot be written"):
        trajectory.write_tum(tmp_path / "nothing" / "trajectory.tum", [])


DECK = UpperSurfaces.of(
    [(1, 2), (0, 0), (1, 2)], [500, 241, 240], [470, 210, 240], [65535, 60000, 33000]
)


def test_surfaces_above_the_lowest_ones_come_back(tmp_path: Path) -> None:
    directory = saved(tmp_path / "garage", upper=DECK)
    with np.load(directory / "height_grid.npz") as archive:
        assert archive["format_version"] == 3
    loaded = map_directory.load(directory).height_map
    for name in ("cell", "top", "bottom", "probability"):
        np.testing.assert_array_equal(getattr(loaded.upper, name), getattr(DECK, name))
    np.testing.assert_array_equal(loaded.height, height_map().height)


def test_a_map_of_one_level_is_the_file_that_it_was(tmp_path: Path) -> None:
    with np.load(saved(tmp_path / "room") / "height_grid.npz") as archive:
        assert not [name for name in archive.files if name.startswith("upper")]
        assert archive["format_version"] == 1


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"upper_cell": np.array([[0, 3]] * 3, np.int32)}, "upper_cell holds cells outside"),
        ({"upper_cell": np.array([[0, -1]] * 3, np.int32)}, "upper_cell holds cells outside"),
        ({"upper_cell": np.zeros((2, 2), np.int32)}, "differ in length"),
        ({"upper_cell": np.zeros((3, 2))}, "upper_cell is an array"),
        ({"upper_top": np.full(3, 32767, np.int16)}, "upper_top holds values beyond"),
        ({"upper_bottom": np.full(3, 600, np.int16)}, "upper_bottom holds values beyond"),
        ({"upper_probability": np.full(3, np.nan, np.float32)}, "upper_probability holds"),
    ],
)
def test_upper_surfaces_that_are_none(tmp_path: Path, changes: dict[str, Any], reason: str) -> None:
    directory = saved(tmp_path / "garage", upper=DECK)
    rewritten(directory, **changes)
    with pytest.raises(InputError, match=reason):
        map_directory.load(directory)
