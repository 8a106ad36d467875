# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The map directory: ``map.yaml`` and ``map.pgm`` for map_server, ``height_grid.npz`` for us.

And trajectories as TUM text.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from heightmap25d_ros import se3
from heightmap25d_ros.errors import InputError
from heightmap25d_ros.grid.height_map import POSITION_LIMIT
from heightmap25d_ros.input_files import require_file
from heightmap25d_ros.io._untrusted import as_input_error
from heightmap25d_ros.io.decode import QUATERNION_TOLERANCE

_LATEST = 2**63 * 1e-9  # [s] that stamps in ns can hold


def write_tum(path: Path, trajectory: Sequence[tuple[int, se3.Matrix]]) -> None:
    """Write stamps [ns] and poses (4, 4) as lines ``t x y z qx qy qz qw``.

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    poses = np.array([pose for _, pose in trajectory]).reshape(-1, 4, 4)
    positions, quaternions = poses[:, :3, 3], se3.to_quaternion(poses)
    lines = (
        f"{stamp_ns // 10**9}.{stamp_ns % 10**9:09d} "
        + " ".join(f"{number:.9f}" for number in (*position, *quaternion))
        for (stamp_ns, _), position, quaternion in zip(
            trajectory, positions, quaternions, strict=True
        )
    )
    try:
        path.write_text("".join(f"{line}\n" for line in lines), encoding="utf-8")
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror}") from None


def read_tum(path: Path) -> NDArray[np.float64]:
    """(N, 8) float64 from TUM text: ``t`` [s], ``x y z`` [m], ``qx qy qz qw``.

    Raises
    ------
    InputError
        If the file cannot be read, or a line is not eight finite numbers, a time, a place and a
        unit quaternion.
    """
    require_file(path)
    with as_input_error(str(path)):
        lines = path.read_text(encoding="utf-8").splitlines()
        rows = [line.split() for line in lines if line.strip() and not line.startswith("#")]
        poses = np.array(rows, np.float64).reshape(-1, 8)
    if any(len(row) != 8 for row in rows) or not np.isfinite(poses).all():
        raise InputError(f"{path}: a line is not eight finite numbers, t x y z qx qy qz qw")
    for is_wrong, fault in (
        ((poses[:, 0] < 0.0) | (poses[:, 0] > _LATEST), "is not a time"),
        ((np.abs(poses[:, 1:4]) > POSITION_LIMIT).any(axis=1), "is not a place"),
        (
            np.abs(np.linalg.norm(poses[:, 4:], axis=1) - 1.0) > QUATERNION_TOLERANCE,
            "is not turned by a unit quaternion",
        ),
    ):
        if is_wrong.any():
            raise InputError(f"{path}: pose {is_wrong.argmax() + 1} {fault}")
    return poses
