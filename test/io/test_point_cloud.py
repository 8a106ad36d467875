# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""PointCloud2 of many layouts into arrays; what is refused; how times of points are read."""

from contextlib import suppress

import numpy as np
import pytest
from bag_writer import point_cloud, rclpy_type, rosbags_type
from hypothesis import given
from hypothesis import strategies as st
from properties import draws

from heightmap25d_ros.errors import InputError
from heightmap25d_ros.io import point_cloud as reader

STAMP = 1_700_000_000 * 10**9 + 250_000_000
XYZ = np.array([(1.0, 2.0, 3.0), (-4.0, 5.5, 0.25), (0.0, 0.0, 0.0), (7.0, -8.0, 9.0)])


def records(extra=(), shape=(4,), kind="<f4", size=None, **values):
    """Points of `XYZ` with further fields after x, y and z."""
    names, kinds = [*"xyz", *(name for name, _ in extra)], [kind] * 3 + [k for _, k in extra]
    layout = {"names": names, "formats": kinds}
    if size is not None:
        layout |= {"itemsize": size}
    made = np.zeros(4, np.dtype(layout))
    for axis, name in enumerate("xyz"):
        made[name] = XYZ[:, axis]
    for name, value in values.items():
        made[name] = value
    return made.reshape(shape)


@st.composite
def layouts(draw):
    """A layout: type, byte order and place of each field, and padding after points and rows."""
    order = draw(st.sampled_from("<>"))
    names = draw(st.permutations(["x", "y", "z", "intensity", "ring"]))
    kinds = {n: order + draw(st.sampled_from(["f4", "f8"])) for n in "xyz"}
    kinds |= {"intensity": f"{order}f4", "ring": f"{order}u2"}
    offsets, end = [], 0
    for name in names:
        end += draw(st.integers(0, 5))
        offsets.append(end)
        end += np.dtype(kinds[name]).itemsize
    size = end + draw(st.integers(0, 7))
    made = {"names": names, "formats": [kinds[n] for n in names], "offsets": offsets}
    shape = draw(st.sampled_from([(4,), (2, 2), (4, 1), (1, 4)]))
    return np.dtype(made | {"itemsize": size}), shape, draw(st.integers(0, 9))


@draws(60)
@given(layouts(), st.sampled_from([rosbags_type, rclpy_type]))
def test_every_layout_gives_the_same_points(layout, type_of):
    dtype, shape, row_padding = layout
    made = np.zeros(4, dtype)
    for axis, name in enumerate("xyz"):
        made[name] = XYZ[:, axis]
    message = point_cloud(STAMP, made.reshape(shape), "lidar", row_padding, type_of)
    cloud = reader.cloud(message)
    np.testing.assert_array_equal(cloud.points, XYZ.astype(np.float32))
    assert cloud.lines.tolist() == [0] * 4
    assert (cloud.stamp_ns, cloud.frame_id, cloud.offsets_ns) == (STAMP, "lidar", None)


def test_neighbours_lie_in_rings_or_else_in_rows():
    rings = reader.cloud(point_cloud(STAMP, records([("ring", "<u2")], ring=[1, 0, 0, 1])))
    assert rings.lines is None, "two points are no ring"
    rings = reader.cloud(point_cloud(STAMP, records([("ring", "<u2")], ring=0)))
    assert (rings.lines.tolist(), rings.has_gaps) == ([0] * 4, True)
    rows = reader.cloud(point_cloud(STAMP, records(shape=(2, 2))))
    assert (rows.lines.tolist(), rows.has_gaps) == ([0, 0, 1, 1], False)
    neither = reader.cloud(point_cloud(STAMP, records()))
    assert neither.lines is None
    assert "outliers are not found" in neither.told


# How drivers write the times of a sweep of 0.1 s that begins at the stamp.
SECONDS = np.array([0.0, 0.03, 0.06, 0.1])
BEGIN = STAMP * 1e-9


@pytest.mark.parametrize(
    ("name", "kind", "values", "told", "tolerance_ns"),
    [
        ("t", "<u4", SECONDS * 1e9, "t, nanoseconds after", 0),
        ("offset_time", "<u4", SECONDS * 1e9, "offset_time, nanoseconds after", 0),
        ("time", "<f4", SECONDS, "time, seconds after", 5),
        ("time", "<f4", SECONDS - 0.1, "time, seconds after", 5),
        ("time", "<f4", SECONDS * 1e9, "time, nanoseconds after", 5),
        ("timestamp", "<f8", BEGIN + SECONDS, "timestamp, seconds absolute", 500),
        ("timestamp", ">f8", BEGIN + SECONDS, "timestamp, seconds absolute", 500),
        ("timestamp", "<f8", STAMP + SECONDS * 1e9, "timestamp, nanoseconds absolute", 500),
        ("time_stamp", "<f8", BEGIN - 0.1 + SECONDS, "time_stamp, seconds absolute", 500),
    ],
)
def test_times_are_read_by_type_and_span(name, kind, values, told, tolerance_ns):
    made = records([(name, kind)], kind=f"{kind[0]}f4", **{name: values})
    cloud = reader.cloud(point_cloud(STAMP, made))
    assert told in cloud.told
    begin = -1e8 if values[-1] == 0.0 or name == "time_stamp" else 0.0
    np.testing.assert_allclose(
        cloud.offsets_ns, begin + SECONDS * 1e9, rtol=0, atol=tolerance_ns + 1
    )


def test_a_simulated_clock_that_has_just_begun_is_no_reason_for_doubt():
    """At half a second both readings of 0.5 .. 0.6 are possible, one comes nearer."""
    early = 500_000_000
    absolute = records([("time", "<f8")], time=0.5 + SECONDS)
    offsets = reader.cloud(point_cloud(early, absolute)).offsets_ns
    np.testing.assert_allclose(offsets, SECONDS * 1e9, atol=1)
    relative = records([("time", "<f8")], time=SECONDS)
    np.testing.assert_allclose(reader.cloud(point_cloud(early, relative)).offsets_ns, offsets)


def test_times_that_are_all_the_same_or_of_no_return_are_no_times():
    same = records([("t", "<u4")], t=0)
    assert reader.cloud(point_cloud(STAMP, same)).offsets_ns is None
    made = records([("time", "<f4")], time=[0.0, np.nan, 0.05, 0.1])
    made["x"][1] = np.nan
    cloud = reader.cloud(point_cloud(STAMP, made))
    assert np.isfinite(cloud.offsets_ns).all()
    assert cloud.beam_stamps_ns()[[0, -1]].tolist() == [STAMP, STAMP + 100_000_001]


def test_a_sweep_has_its_poses_every_millisecond():
    cloud = reader.cloud(point_cloud(STAMP, records([("t", "<u4")], t=SECONDS * 1e9)))
    stamps = cloud.beam_stamps_ns()
    assert (len(stamps), stamps[0], stamps[-1]) == (101, STAMP, STAMP + 100_000_000)
    assert set(np.diff(stamps).tolist()) == {1_000_000}


@pytest.mark.parametrize(
    ("made", "changes", "told"),
    [
        (records()[["y", "z"]], {}, "fields: no x, only y, z"),
        (records(), {"fields": []}, "fields: no x, only none"),
        (records(kind="<u4"), {}, "fields: x is of type UINT32, not FLOAT32 or FLOAT64"),
        (records(), {"width": 0}, "width: 0 x 1 points are no cloud"),
        (records(), {"width": 170_000_000}, "width: 170000000 x 1 points are more than 4000000"),
        (records(), {"point_step": 0}, "point_step: 0 bytes"),
        (records(), {"point_step": 11}, "fields: z at byte 8 is not within the 11 of a point"),
        (records(shape=(2, 2)), {"row_step": 23}, "row_step: 23 bytes for 2 points of 12"),
        (records(), {"data": np.zeros(47, np.uint8)}, "data: 47 bytes, 4 x 1 points need 48"),
        (records(), {"data": np.zeros(0, np.uint8)}, "data: 0 bytes, 4 x 1 points need 48"),
        (records([("t", "<u4")], t=[0, 1, 2, 4e9]), {}, "t: 0 to 4000000000 are neither seconds"),
        (records([("time", "<f4")], time=SECONDS * 1e4), {}, "time: 0 to 1000 are neither"),
        (
            records([("timestamp", "<f8")], timestamp=BEGIN - 3600 + SECONDS),
            {},
            "neither seconds nor nanoseconds of a sweep at the stamp 1700000000.250 s",
        ),
    ],
)
def test_what_contradicts_itself_is_refused_by_name(made, changes, told):
    with pytest.raises(InputError, match=told):
        reader.cloud(point_cloud(STAMP, made, **changes))


@draws(60)
@given(st.data())
def test_no_numbers_in_the_fields_do_harm(data):
    numbers = st.sampled_from([0, 1, 3, 4, 11, 12, 48, 255, 2**16, 2**31, 2**32 - 1])
    names = ["width", "height", "point_step", "row_step"]
    changes = {n: data.draw(numbers) for n in data.draw(st.sets(st.sampled_from(names)))}
    made = records([("t", "<u4"), ("ring", "<u2")])
    message = point_cloud(STAMP, made, **changes)
    for field in message.fields:
        field.offset = data.draw(st.sampled_from([field.offset, 0, 13, 2**32 - 1]))
        field.datatype = data.draw(st.sampled_from([field.datatype, 0, 8, 9, 255]))
    with suppress(InputError):
        assert reader.cloud(message).points.shape == (message.width * message.height, 3)
