# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The simulated lidar and depth camera, against surfaces whose ranges follow from geometry."""

import numpy as np
import pytest

from heightmap25d_ros.errors import InputError
from heightmap25d_ros.io import point_cloud
from heightmap25d_ros.localization.tracking_state import State
from heightmap25d_ros.params.by_name import with_values
from heightmap25d_ros.params.sections import Params
from heightmap25d_ros.pipelines.localization import Localizer
from heightmap25d_ros.pipelines.mapping import Mapping
from heightmap25d_ros.pipelines.replay import feed
from heightmap25d_ros.simulation import messages, recording
from heightmap25d_ros.simulation.cloud_sensors import DepthCamera, Lidar
from heightmap25d_ros.simulation.lasers import EXACT_RANGES, RangeNoise, measured, take_scan
from heightmap25d_ros.simulation.scene import Scene, box
from heightmap25d_ros.simulation.simulation import NOISE_FREE, Simulation
from heightmap25d_ros.simulation.worlds import floor

WALL = box((4.0, 4.2), (-20.0, 20.0), (-1.0, 6.0))
STILL = np.random.default_rng(0)


def taken(sensor, scene, noise=EXACT_RANGES):
    poses = np.broadcast_to(np.eye(4), (len(sensor.beam_times(0.0)), 4, 4))
    return take_scan(sensor, scene, 0.0, poses, noise, STILL)


@pytest.mark.parametrize("sensor", [Lidar(rings=16, columns=128), DepthCamera()])
def test_points_lie_on_floor_and_wall(sensor):
    """Placed by the mount that is published, after the way through a message."""
    scan = taken(sensor, Scene([floor(), WALL]))
    cloud = point_cloud.cloud(messages.scan(sensor, scan))
    T = sensor.T_base_sensor(np.zeros(1))[0]
    is_return = np.isfinite(cloud.points).all(axis=1) & cloud.points.any(axis=1)
    places = cloud.points[is_return] @ T[:3, :3].T + T[:3, 3]
    on_floor = np.abs(places[:, 2]) < 1e-4
    on_wall = np.abs(places[:, 0] - 4.0) < 1e-4
    assert (on_floor | on_wall).all()
    assert on_floor.sum() > 300
    assert on_wall.sum() > 30
    np.testing.assert_allclose(places, scan.ends[is_return], atol=1e-4)


def test_a_lidar_turns_once_a_sweep_and_a_frame_is_of_one_time():
    lidar = Lidar(rings=16, columns=128)
    cloud = point_cloud.cloud(messages.scan(lidar, taken(lidar, Scene([floor()]))))
    assert cloud.lines.reshape(lidar.shape)[:, 0].tolist() == list(range(16))
    offsets = cloud.offsets_ns.reshape(lidar.shape)
    np.testing.assert_allclose(offsets, np.tile(np.arange(128) * 1e8 / 128, (16, 1)), atol=1)
    camera = DepthCamera()
    frame = point_cloud.cloud(messages.scan(camera, taken(camera, Scene([floor()]))))
    assert frame.offsets_ns is None
    assert frame.told == "neighbours in rows; all points at the stamp of the header"


def test_the_cameras_error_grows_with_the_square_of_the_range():
    camera, rng = DepthCamera(), np.random.default_rng(5)
    noise = RangeNoise(step=0.0, dropout=0.0, short=0.0, mixed=0.0)
    for distance in (1.0, 2.0, 4.0):
        errors = measured(np.full(20_000, distance), noise, rng, camera) - distance
        assert errors.std() == pytest.approx(0.002 * distance**2, rel=0.05)
    assert np.isinf(measured(np.full(100, 9.0), noise, rng, camera)).all()


@pytest.mark.parametrize(
    ("values", "told"),
    [
        ({"lidar_rings": 4}, "lidar: 4 rings are not within 8 .. 128"),
        ({"lidar_rings": 16, "has_nodding": True}, "nodding: there are no lasers beside a lidar"),
        ({"scan_rate": 100.0}, "scan rate 100: is not within"),
    ],
)
def test_sensors_that_there_are_not(values, told):
    with pytest.raises(InputError, match=told):
        recording.mounted_sensors(**values)


def test_a_drive_with_lidar_and_camera_is_mapped_and_localized():
    """Four seconds on a floor with posts; the odometry of the second time is 0.15 m off."""
    mounted = Lidar(rings=16, columns=128), DepthCamera(rows=20, columns=36)
    world = recording.world_of("pillars", 1)
    simulation = Simulation(world, 1, NOISE_FREE, mounted)
    events = [*simulation.begin()]
    while simulation.seconds < 4.0:
        events += simulation.step(0.5, 0.1)
    topics = {"intake.cloud_topics": [sensor.topic for sensor in mounted]}
    params = with_values(Params(), topics)
    mapping = Mapping(params)
    for event in events:
        feed(mapping, event.topic, event.message)
    mapping.flush()
    assert mapping.merged["scans"] > 80
    # Rings high on a pillar may be more surfaces than a cell holds: counted, and of no other kind.
    assert set(mapping.dropped) <= {"return: above levels.max_surfaces"}
    assert sum(mapping.dropped.values()) < 10
    height_map, _ = mapping.maps()
    iy, ix = np.nonzero(height_map.known)
    centres = height_map.geometry.cell_center(np.stack([iy, ix], axis=1))
    side = np.linspace(-0.0624, 0.0624, 7)
    within = np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)
    around = (centres[:, None] + within).reshape(-1, 2)
    tops = world.scene().heights(around).reshape(len(centres), -1)
    is_floor = (np.abs(tops) < 1e-6).all(axis=1)
    assert is_floor.sum() > 1000
    np.testing.assert_allclose(height_map.metres[iy, ix][is_floor], 0.0, atol=0.02)

    localizer = Localizer(params)
    localizer.set_long_term(height_map, mapping.layers(height_map.geometry))
    localizer.begin_at([0.15, 0.0, 0.0, 0.0])
    for event in events:
        feed(localizer, event.topic, event.message)
    assert localizer.state is State.TRACKING
    np.testing.assert_allclose(
        localizer.pose.T_map_base[:3, 3], simulation.robot.T[:3, 3], atol=0.05
    )
