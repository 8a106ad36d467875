# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The buffer against hand-computed values and a slow literal reference."""

import math

import numpy as np
import pytest
from bag_writer import tf_message
from hypothesis import given
from hypothesis import strategies as st
from properties import draws
from scipy.spatial.transform import Rotation, Slerp

from heightmap25d_ros import se3
from heightmap25d_ros.errors import InputError
from heightmap25d_ros.io.decode import Transform
from heightmap25d_ros.pipelines.drops import Drops
from heightmap25d_ros.pipelines.transform_buffer import Missing, TransformBuffer

SECOND = 10**9
EPOCH = 1_700_000_000 * SECOND


def transform(parent, child, seconds=0.0, xyz_rpy=(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)):
    return Transform(
        parent=parent, child=child, stamp_ns=at(seconds)[0].item(), T=se3.from_xyz_rpy(xyz_rpy)
    )


def at(*seconds):
    return EPOCH + np.rint(np.multiply(seconds, 1e9)).astype(np.int64)


def buffer_of(*transforms, static=(), max_gap=1.0, history=30.0):
    buffer = TransformBuffer(max_gap=max_gap, history=history)
    buffer.add(static, is_static=True)
    buffer.add(transforms)
    return buffer


def test_a_static_mount_holds_at_all_times():
    buffer = buffer_of(static=[transform("base", "laser", 100.0, (1, 2, 3, 0, 0, math.pi / 2))])
    for stamps in (at(0.0), at(-1e6, 1e6)):
        T_base_laser = buffer.lookup("base", "laser", stamps)
        # A point 2 m ahead of a laser that looks to the left.
        point = T_base_laser @ (2.0, 0.0, 0.0, 1.0)
        np.testing.assert_allclose(point, [(1.0, 4.0, 3.0, 1.0)], atol=1e-12)


def test_a_path_up_and_down_the_tree():
    # odom -> base -> (mast -> laser, camera); everything one step along x, the mast turned.
    quarter = math.pi / 2
    buffer = buffer_of(
        static=[
            transform("base", "mast", 0.0, (1, 0, 0, 0, 0, quarter)),
            transform("mast", "laser", 0.0, (1, 0, 0, 0, 0, 0)),
            transform("base", "camera", 0.0, (0, 5, 0, 0, 0, -quarter)),
        ]
    )
    T_base_laser = buffer.lookup("base", "laser", at(0.0))[0]
    np.testing.assert_allclose(se3.to_xyz_rpy(T_base_laser), (1, 1, 0, 0, 0, quarter), atol=1e-12)
    T_laser_base = buffer.lookup("laser", "base", at(0.0))[0]
    np.testing.assert_allclose(se3.to_xyz_rpy(T_laser_base), (-1, 1, 0, 0, 0, -quarter), atol=1e-12)
    # The laser at (1, 1) in base is 1 along base's x and -4 along its y from the camera,
    # whose x axis is base's -y and whose y axis is base's x.
    T_camera_laser = buffer.lookup("camera", "laser", at(0.0))[0]
    np.testing.assert_allclose(T_camera_laser[:3, 3], (4, 1, 0), atol=1e-12)


def test_a_frame_is_where_it_is_in_itself():
    np.testing.assert_array_equal(buffer_of().lookup("a", "a", at(0.0)), [np.eye(4)])


def test_a_moving_mount_is_interpolated_at_each_stamp():
    buffer = buffer_of(
        transform("base", "laser", 1.0, (0, 0, 1, 0, 0.2, 0)),
        transform("base", "laser", 1.5, (0, 0, 2, 0, 0.6, 0)),
        transform("base", "laser", 2.0, (0, 0, 2, 0, 0.6, 0)),
    )
    T = buffer.lookup("base", "laser", at(1.0, 1.125, 1.5, 1.75, 2.0))
    expected = [(0, 0, z, 0, pitch, 0) for z, pitch in
                ((1, 0.2), (1.25, 0.3), (2, 0.6), (2, 0.6), (2, 0.6))]  # fmt: skip
    np.testing.assert_allclose(se3.to_xyz_rpy(T), expected, atol=1e-9)


@pytest.mark.parametrize(
    ("stamps", "reason"),
    [
        ((0.999,), Missing.TOO_EARLY),
        ((0.9, 1.1), Missing.TOO_EARLY),
        ((2.001,), Missing.NOT_YET),
        ((1.9, 2.1), Missing.NOT_YET),
        ((0.5, 2.5), Missing.TOO_EARLY),
    ],
)
def test_nothing_is_extrapolated(stamps, reason):
    buffer = buffer_of(*(transform("base", "laser", s) for s in (1.0, 1.5, 2.0)))
    assert buffer.lookup("base", "laser", at(*stamps)) is reason


def test_gaps_are_not_bridged_but_their_ends_are_known():
    buffer = buffer_of(*(transform("base", "laser", s) for s in (1.0, 1.5, 4.5, 5.0)))
    assert buffer.lookup("base", "laser", at(1.6)) is Missing.GAP
    assert buffer.lookup("base", "laser", at(1.2, 4.4)) is Missing.GAP
    for known in ((1.5,), (4.5,), (1.0, 1.3, 1.5), (4.5, 4.9), (1.2, 4.8), (1.5, 4.5)):
        assert not isinstance(buffer.lookup("base", "laser", at(*known)), Missing)


def test_a_gap_as_wide_as_the_limit_is_bridged():
    buffer = buffer_of(transform("a", "b", 1.0), transform("a", "b", 2.0), max_gap=1.0)
    assert not isinstance(buffer.lookup("a", "b", at(1.5)), Missing)


def test_frames_without_connection():
    buffer = buffer_of(static=[transform("a", "b"), transform("c", "d")])
    for target, source in (("a", "d"), ("b", "d"), ("a", "unheard"), ("unheard", "b")):
        assert buffer.lookup(target, source, at(0.0)) is Missing.UNCONNECTED


def test_of_several_reasons_a_final_one_is_given():
    buffer = buffer_of(
        transform("a", "b", 1.0), transform("a", "b", 2.0), transform("b", "c", 5.0),
        transform("a", "other", 5.0),
    )  # fmt: skip
    assert buffer.lookup("a", "c", at(4.0)) is Missing.TOO_EARLY
    assert buffer.lookup("b", "other", at(4.0)) is Missing.TOO_EARLY
    assert buffer.lookup("other", "b", at(4.0)) is Missing.TOO_EARLY
    assert buffer.lookup("a", "c", at(5.0)) is Missing.NOT_YET


def test_out_of_order_stamps_are_sorted_in():
    buffer = buffer_of(*(transform("a", "b", s, (s, 0, 0, 0, 0, 0)) for s in (1.0, 2.0, 1.5, 1.25)))
    T = buffer.lookup("a", "b", at(1.25, 1.4, 1.9))
    np.testing.assert_allclose(T[:, 0, 3], (1.25, 1.4, 1.9))


def test_of_equal_stamps_the_first_stays():
    buffer = buffer_of(transform("a", "b", 1.0, (1, 0, 0, 0, 0, 0)), transform("a", "b", 1.0))
    assert buffer.lookup("a", "b", at(1.0))[0, 0, 3] == 1.0


def test_a_jump_back_starts_the_frame_over():
    buffer = buffer_of(*(transform("a", "b", s, (s, 0, 0, 0, 0, 0)) for s in (10.0, 10.5, 3.0)))
    assert buffer.lookup("a", "b", at(3.0))[0, 0, 3] == 3.0
    assert buffer.lookup("a", "b", at(10.0)) is Missing.NOT_YET


def test_what_is_older_than_the_history_is_forgotten():
    stamps = np.arange(0.0, 10.0, 0.5)
    buffer = buffer_of(*(transform("a", "b", s) for s in stamps), history=2.0)
    assert buffer.lookup("a", "b", at(7.5, 9.5)).shape == (2, 4, 4)
    assert buffer.lookup("a", "b", at(7.4)) is Missing.TOO_EARLY


def test_a_new_parent_takes_the_frame_with_it():
    buffer = buffer_of(transform("a", "b", 1.0), transform("c", "b", 1.0, (7, 0, 0, 0, 0, 0)))
    assert buffer.lookup("a", "b", at(1.0)) is Missing.UNCONNECTED
    assert buffer.lookup("c", "b", at(1.0))[0, 0, 3] == 7.0


LASER = transform("base", "laser", 0.0, (3, 0, 0, 0, 0, 0))
BAD = {
    "the wrong way round": ("laser", "base"),
    "another parent": ("arm", "laser"),
    "another pose": ("base", "laser"),
}


def mount(buffer, seconds):
    T = buffer.lookup("base", "laser", at(seconds))
    return T if isinstance(T, Missing) else T[0, 0, 3]


@pytest.mark.parametrize("bad", BAD.values(), ids=BAD)
def test_a_static_mount_stays_whatever_is_said_of_it_as_a_moving_one(bad):
    dropped = Drops()
    buffer = TransformBuffer(max_gap=1.0, dropped=dropped)
    buffer.add([LASER], is_static=True)
    assert mount(buffer, 1.0) == 3.0
    for step in range(20):
        buffer.take(message(*bad, 0.1 * step, 5.0), is_static=False)
        assert mount(buffer, 0.1 * step) == 3.0
    (reason,) = dropped
    assert f"{bad[0]} -> {bad[1]}" in dropped.examples[reason]
    if bad[1] == "laser":
        assert dropped == {"transforms: contradict a static one": 1}


def test_what_says_the_same_as_a_static_one_is_no_contradiction():
    dropped = Drops()
    buffer = TransformBuffer(max_gap=1.0, dropped=dropped)
    buffer.add([LASER], is_static=True)
    buffer.take(message("base", "laser", 1.0, 3.0), is_static=False)
    assert mount(buffer, 9.0) == 3.0
    assert not dropped


@pytest.mark.parametrize("is_bad_static", [False, True])
@pytest.mark.parametrize("bad", BAD.values(), ids=BAD)
def test_a_static_mount_takes_effect_after_a_bad_one(bad, is_bad_static):
    buffer = buffer_of()
    buffer.add([transform(*bad, 1.0, (5, 0, 0, 0, 0, 0))], is_static=is_bad_static)
    assert mount(buffer, 1.0) != 3.0
    buffer.add([LASER], is_static=True)
    assert mount(buffer, 9.0) == 3.0


@pytest.mark.parametrize("bad", BAD.values(), ids=BAD)
def test_a_moving_mount_takes_effect_after_a_bad_one(bad):
    buffer = buffer_of()
    mount(buffer, 0.0)
    buffer.take(message(*bad, 0.0, 5.0), is_static=False)
    for step in range(1, 12):
        buffer.take(message("base", "laser", 0.1 * step, 3.0), is_static=False)
    assert mount(buffer, 1.05) == 3.0


def test_a_moving_mount_that_is_heard_stays_beside_its_reverse():
    buffer = buffer_of()
    mount(buffer, 0.0)
    for step in range(12):
        buffer.take(message("base", "laser", 0.1 * step, 3.0), is_static=False)
        if step % 2:
            buffer.take(message("laser", "base", 0.1 * step, 5.0), is_static=False)
    assert mount(buffer, 1.05) == 3.0
    np.testing.assert_array_equal(buffer.lookup("base", "laser", at(0.15))[0, 0, 3], 3.0)


def test_a_loop_that_is_read_in_a_lookup_displaces_nothing():
    buffer = TransformBuffer(max_gap=1.0)
    for step in range(3):
        for parent, child in (("a", "b"), ("b", "c"), ("c", "a")):
            buffer.take(message(parent, child, 0.1 * step), is_static=False)
    for target, source in (("a", "other"), ("c", "a"), ("b", "c"), ("a", "b")):
        buffer.lookup(target, source, at(0.1))
    assert not isinstance(buffer.lookup("c", "a", at(0.1)), Missing)


@pytest.mark.parametrize(
    ("loop", "is_static"),
    [
        (("b", "a"), False), (("c", "a"), False), (("c", "a"), True), (("a", "a"), False),
        (("a", "a"), True), (("new", "new"), False), (("new", "new"), True),
    ],
)  # fmt: skip
def test_a_loop_is_refused_and_the_rest_is_taken(loop, is_static):
    buffer = buffer_of(static=[transform("a", "b"), transform("b", "c", 0.0, (1, 0, 0, 0, 0, 0))])
    with pytest.raises(InputError, match=f"{loop[0]} -> {loop[1]}"):
        buffer.add(
            [transform(*loop), transform("c", "d", 0.0, (1, 0, 0, 0, 0, 0))], is_static=is_static
        )
    assert buffer.lookup("a", "d", at(0.0))[0, 0, 3] == 2.0


def test_forgetting_what_lies_ahead_keeps_static_frames():
    buffer = buffer_of(
        transform("a", "moving", 5.0), transform("a", "past", 1.0), static=[transform("a", "fixed")]
    )
    buffer.forget_after(at(2.0)[0])
    assert buffer.lookup("a", "moving", at(5.0)) is Missing.UNCONNECTED
    for kept in ("past", "fixed"):
        assert not isinstance(buffer.lookup("a", kept, at(1.0)), Missing)


FRAMES = ("map", "odom", "base", "mast", "laser", "arm", "tool")
coordinate = st.floats(-10.0, 10.0)
angle = st.floats(-1.2, 1.2)


@st.composite
def trees(draw):
    """Parent and knots (stamp [ns] -> pose) of each frame but the root."""
    tree = {}
    for index, child in enumerate(FRAMES[1:], start=1):
        parent = FRAMES[draw(st.integers(0, index - 1))]
        stamps = draw(st.lists(st.integers(0, 50), min_size=1, max_size=6, unique=True))
        pose = st.tuples(coordinate, coordinate, coordinate, angle, angle, angle)
        tree[child] = (
            parent,
            {EPOCH + stamp * SECOND // 10: se3.from_xyz_rpy(draw(pose)) for stamp in stamps},
        )
    return tree


def literal_edge(knots, stamp, max_gap):
    """One frame in its parent at one stamp, by scipy; None where it is not known."""
    if stamp in knots:
        return knots[stamp]
    before = max((known for known in knots if known < stamp), default=None)
    after = min((known for known in knots if known > stamp), default=None)
    if before is None or after is None or after - before > max_gap * SECOND:
        return None
    part = (stamp - before) / (after - before)
    pair = Rotation.from_matrix([knots[before][:3, :3], knots[after][:3, :3]])
    T = np.eye(4)
    T[:3, :3] = Slerp([0, 1], pair)(part).as_matrix()
    T[:3, 3] = (1 - part) * knots[before][:3, 3] + part * knots[after][:3, 3]
    return T


def literal_lookup(tree, target, source, stamp, max_gap):
    """Both frames in the root, so that their common ancestor needs no search."""

    def to(frame, ancestors):
        chain = []
        while frame not in ancestors:
            chain.insert(0, literal_edge(tree[frame][1], stamp, max_gap))
            frame = tree[frame][0]
        return chain, frame

    def ancestors_of(frame):
        return [frame] + (ancestors_of(tree[frame][0]) if frame in tree else [])

    up, common = to(source, ancestors_of(target))
    down, _ = to(target, [common])
    if any(T is None for T in up + down):
        return None
    T_common_source, T_common_target = np.eye(4), np.eye(4)
    for T in up:
        T_common_source = T_common_source @ T
    for T in down:
        T_common_target = T_common_target @ T
    return np.linalg.inv(T_common_target) @ T_common_source


@given(
    trees(),
    st.sampled_from(FRAMES),
    st.sampled_from(FRAMES),
    st.lists(st.integers(0, 500), min_size=1, max_size=4),
    st.sampled_from([0.5, 1.0, 5.0]),
    st.randoms(),
)
def test_lookup_equals_the_literal_reference(tree, target, source, hundredths, max_gap, random):
    transforms = [
        Transform(parent=parent, child=child, stamp_ns=stamp, T=T)
        for child, (parent, knots) in tree.items()
        for stamp, T in knots.items()
    ]
    # Sorted in steps of a second, at most a second out of order.
    transforms.sort(key=lambda t: t.stamp_ns + random.randint(0, SECOND // 2))
    buffer = buffer_of(*transforms, max_gap=max_gap)
    stamps = EPOCH + np.array(hundredths) * (SECOND // 100)
    expected = [literal_lookup(tree, target, source, stamp, max_gap) for stamp in stamps.tolist()]
    got = buffer.lookup(target, source, stamps)
    if any(T is None for T in expected):
        assert isinstance(got, Missing)
    else:
        assert not isinstance(got, Missing)
        np.testing.assert_allclose(np.broadcast_to(got, (len(stamps), 4, 4)), expected, atol=1e-8)


def message(parent, child, seconds=0.0, x=0.0):
    return tf_message((at(seconds)[0].item(), parent, child, (x, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)))


def test_foreign_frames_are_put_aside_and_read_when_they_are_asked_for():
    dropped = Drops()
    buffer = TransformBuffer(max_gap=1.0, dropped=dropped)
    assert buffer.lookup("base", "laser", at(0.0)) is Missing.UNCONNECTED
    for step in range(10):
        assert not buffer.take(message("arm", "tool", 0.1 * step, step), is_static=False)
        assert buffer.take(message("base", "laser", 0.1 * step, step), is_static=False)
        assert not buffer.take(message("base", "arm", 0.1 * step, step), is_static=False)
    assert buffer.lookup("base", "laser", at(0.45))[0, 0, 3] == pytest.approx(4.5)
    assert buffer.lookup("base", "tool", at(0.45))[0, 0, 3] == pytest.approx(9.0)
    assert buffer.take(message("arm", "tool", 1.0, 10.0), is_static=False)
    assert buffer.take(message("base", "arm", 1.0, 10.0), is_static=False)
    assert buffer.lookup("base", "tool", at(1.0))[0, 0, 3] == pytest.approx(20.0)
    assert not dropped


@draws(100)
@given(trees(), st.sampled_from(FRAMES), st.sampled_from(FRAMES), st.booleans(), st.randoms())
def test_whatever_comes_first_a_lookup_says_the_same(tree, target, source, is_asked, random):
    """Messages that were put aside, in any order, and transforms that were used at once."""
    sent = [
        Transform(parent=parent, child=child, stamp_ns=stamp, T=T)
        for child, (parent, knots) in tree.items()
        for stamp, T in knots.items()
    ]
    sent.sort(key=lambda t: t.stamp_ns + random.randint(0, SECOND // 2))
    at_once, dropped = buffer_of(*sent, max_gap=5.0), Drops()
    put_aside = TransformBuffer(max_gap=5.0, dropped=dropped)
    if is_asked:
        put_aside.lookup(target, source, at(0.0))
    for t in sent:
        entry = t.stamp_ns, t.parent, t.child, t.T[:3, 3], se3.to_quaternion(t.T)
        put_aside.take(tf_message(entry), is_static=False)
    for stamp in (EPOCH, EPOCH + SECOND, EPOCH + 3 * SECOND):
        expected = at_once.lookup(target, source, np.array([stamp]))
        got = put_aside.lookup(target, source, np.array([stamp]))
        if isinstance(expected, Missing):
            assert got is expected
        else:
            np.testing.assert_allclose(got, expected, atol=1e-12)
    assert not dropped


def test_malformed_transforms_are_counted_when_they_are_read():
    dropped = Drops()
    buffer = TransformBuffer(max_gap=1.0, dropped=dropped)
    buffer.lookup("base", "laser", at(0.0))
    bad = math.nan
    assert not buffer.take(message("base", "laser", 0.0, bad), is_static=False)
    assert dropped == {"transforms: bad transforms": 1}
    assert not buffer.take(message("base", "arm", 0.0, bad), is_static=False)
    assert dropped.total() == 1
    assert buffer.lookup("base", "arm", at(0.0)) is Missing.UNCONNECTED
    assert dropped == {"transforms: bad transforms": 2}


@pytest.mark.parametrize("is_static", [False, True])
@pytest.mark.parametrize("is_backwards", [False, True])
def test_a_chain_of_many_frames_is_followed_only_so_far(is_static, is_backwards):
    """Work grows with the chain, not with its square, which took 8 s for 12,000 frames."""
    dropped = Drops()
    buffer = TransformBuffer(max_gap=1.0, dropped=dropped)
    frames = list(range(9000))
    for frame in reversed(frames) if is_backwards else frames:
        buffer.take(message(f"f{frame}", f"f{frame + 1}"), is_static=is_static)
    last = 500 if is_backwards else 9000  # of moving strangers the newest are kept
    assert not isinstance(buffer.lookup(f"f{last - 90}", f"f{last}", at(0.0)), Missing)
    assert len(buffer.chain(f"f{last - 90}", f"f{last}")) == 90
    assert buffer.lookup(f"f{last - 110}", f"f{last}", at(0.0)) is Missing.UNCONNECTED
    assert not dropped


def test_frames_of_strangers_do_not_fill_the_memory():
    dropped = Drops()
    buffer = TransformBuffer(max_gap=1.0, dropped=dropped)
    for number in range(30_000):
        buffer.take(message("base", f"stranger {number}"), is_static=False)
        buffer.lookup("base", f"unheard {number}", at(0.0))
    for number in range(12_000):
        buffer.take(message("base", f"static {number}"), is_static=True)
    assert dropped == {"transforms: too many frames": 2000}
    kept = [
        not isinstance(buffer.lookup("base", f"stranger {number}", at(0.0)), Missing)
        for number in range(28_000, 30_000)
    ]
    assert sum(kept) == 0  # there are as many frames as there may be


def test_a_loop_among_frames_that_were_put_aside():
    dropped = Drops()
    buffer = TransformBuffer(max_gap=1.0, dropped=dropped)
    for parent, child in (("a", "b"), ("b", "c"), ("c", "a")):
        buffer.take(message(parent, child), is_static=False)
    assert buffer.lookup("a", "other", at(0.0)) is Missing.UNCONNECTED
    assert len(buffer.chain("c", "a")) <= 2
    assert dropped == {"transforms: closes a loop": 1}
