# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Solids, a height field and moving objects, and their intersections with rays, by MuJoCo."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from math import atan2, hypot

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from heightmap25d_ros.arrays import Array
from heightmap25d_ros.errors import InputError

try:
    import mujoco
except ImportError as error:
    raise InputError("the simulator needs MuJoCo: pip install 'mujoco>=3.5,<4'") from error


_HIDDEN = (0.0, 0.0, -1e4)
_TERRAIN_TILE = 24
_OVERHEAD_GROUP = 1
_OPEN_SKY = 1e3


@dataclass(frozen=True, slots=True, kw_only=True)
class Solid:
    """A box, an upright cylinder or an ellipsoid.

    Attributes
    ----------
    kind : "box", "cylinder" or "ellipsoid"
    center : (x, y, z) [m], map
    size : (3,) [m]
        Half the extents; of a cylinder the radius, the radius and half the height.
    pitch, yaw : float [rad]
        The pitch is applied first.
    is_overhead : bool
        Whether it hangs, and can be passed below where that is high enough: a lintel, a ceiling,
        an upper deck. All other solids are complete from the ground up: the robot and the ground
        truth look for no gap below them, which beams would see.
    """

    kind: str
    center: tuple[float, float, float]
    size: tuple[float, float, float]
    pitch: float = 0.0
    yaw: float = 0.0
    is_overhead: bool = False


Span = tuple[float, float]


def box(x: Span, y: Span, z: Span, *, yaw: float = 0.0, is_overhead: bool = False) -> Solid:
    """A box over these ranges [m], turned about its middle."""
    spans = (x, y, z)
    return Solid(
        kind="box",
        center=(sum(x) / 2, sum(y) / 2, sum(z) / 2),
        size=tuple((high - low) / 2 for low, high in spans),  # type: ignore[arg-type]
        yaw=yaw,
        is_overhead=is_overhead,
    )


def cylinder(x: float, y: float, radius: float, z: Span) -> Solid:
    """An upright cylinder."""
    half = (z[1] - z[0]) / 2
    return Solid(kind="cylinder", center=(x, y, sum(z) / 2), size=(radius, radius, half))


def ramp(x: Span, y: Span, z: Span, *, thickness: float) -> Solid:
    """A plate whose top goes from ``z[0]`` at ``x[0]`` to ``z[1]`` at ``x[1]``.

    Complete from the ground up only if its thickness reaches down to the ground everywhere.
    """
    run, rise = x[1] - x[0], z[1] - z[0]
    length = hypot(run, rise)
    half = thickness / 2
    center = (sum(x) / 2 + half * rise / length, sum(y) / 2, sum(z) / 2 - half * run / length)
    return Solid(
        kind="box",
        center=center,
        size=(length / 2, (y[1] - y[0]) / 2, half),
        pitch=-atan2(rise, run),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Terrain:
    """A height field.

    Attributes
    ----------
    height : (rows, columns) float64 [m]
        At the corners of a lattice, rows along y; planar in triangles in between.
    origin : (x, y) [m], map
        Of ``height[0, 0]``.
    spacing : float [m]
    """

    height: Array
    origin: tuple[float, float]
    spacing: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Mover:
    """A solid that moves without turning.

    Attributes
    ----------
    solid : Solid
        Its center is not used.
    center_at : callable of seconds
        Its center (x, y, z) [m]; None while it is not in the world.
    """

    solid: Solid
    center_at: Callable[[float], tuple[float, float, float] | None]


class Scene:
    """The geometry that beams, wheels and the ground truth are computed with.

    Parameters
    ----------
    solids : sequence of Solid
    terrain : Terrain, optional
    movers : sequence of Mover
    """

    def __init__(
        self,
        solids: Sequence[Solid],
        terrain: Terrain | None = None,
        movers: Sequence[Mover] = (),
    ) -> None:
        spec = mujoco.MjSpec()
        for solid in solids:
            _add_geom(spec.worldbody, solid)
        if terrain is not None:
            _add_terrain(spec, terrain)
        for mover in movers:
            body = spec.worldbody.add_body(mocap=True, pos=_HIDDEN)
            _add_geom(body, replace(mover.solid, center=(0.0, 0.0, 0.0)))
        self._model = spec.compile()
        self._data = mujoco.MjData(self._model)
        self._movers = tuple(movers)
        self._first_moving = self._model.ngeom - len(movers)
        self._overhead = (np.arange(6) == _OVERHEAD_GROUP).astype(np.uint8)
        self._no_overhead = 1 - self._overhead
        self._geom = np.zeros(1, np.int32)
        self.set_time(0.0)

    def set_time(self, seconds: float) -> None:
        """Move the movers to their positions at a time [s]."""
        for index, mover in enumerate(self._movers):
            self._data.mocap_pos[index] = mover.center_at(seconds) or _HIDDEN
        mujoco.mj_kinematics(self._model, self._data)

    def ranges(self, origins: ArrayLike, directions: ArrayLike) -> tuple[Array, NDArray[np.int32]]:
        """Distance to the first surface along each ray.

        Parameters
        ----------
        origins, directions : (N, 3) float64 [m], map
            The directions have length one.

        Returns
        -------
        ranges : (N,) float64 [m]
            Infinite if a ray hits nothing.
        mover : (N,) int32
            Index of the mover that was hit, or -1.
        """
        directions = np.ascontiguousarray(directions, np.float64)
        origins = np.broadcast_to(np.asarray(origins, np.float64), directions.shape)
        found, met = np.empty(len(directions)), np.empty(len(directions), np.int32)
        model, data, geom = self._model, self._data, self._geom
        for index, (origin, direction) in enumerate(zip(origins, directions, strict=True)):
            found[index] = mujoco.mj_ray(model, data, origin, direction, None, 1, -1, geom)
            met[index] = geom[0]
        return np.where(found < 0.0, np.inf, found), np.maximum(met - self._first_moving, -1)

    def heights(
        self, points: ArrayLike, below: float = _OPEN_SKY, *, with_overhead: bool = True
    ) -> Array:
        """(N,) [m]: highest surface at points (N, 2) that lies below a height [m].

        Minus infinity where there is none.
        """
        group = None if with_overhead else self._no_overhead
        down = np.array([0.0, 0.0, -1.0])
        origin = np.array([0.0, 0.0, below])
        points = np.asarray(points, np.float64)
        found = np.empty(len(points))
        for index, point in enumerate(points):
            origin[:2] = point
            found[index] = mujoco.mj_ray(
                self._model, self._data, origin, down, group, 1, -1, self._geom
            )
        return np.where(found < 0.0, -np.inf, below - found)

    def meets(self, points: Array, low: Array, high: Array) -> NDArray[np.bool_]:
        """(N,): whether anything is at points (N, 2) between heights ``low`` and ``high`` [m]."""
        up, normal = np.array([0.0, 0.0, 1.0]), np.zeros(3)
        origins = np.column_stack([points, low])
        hangs = np.empty(len(origins), np.bool_)
        for index, (origin, room) in enumerate(zip(origins, high - low, strict=True)):
            distance = mujoco.mj_ray(
                self._model, self._data, origin, up, self._overhead, 1, -1, self._geom, normal
            )
            # The first face of a ray that begins inside of a solid is the one by which it leaves.
            hangs[index] = distance >= 0.0 and (distance < room or normal[2] > 0.0)
        return np.asarray(hangs | (self.heights(points, with_overhead=False) > low))

    def undersides(self, points: ArrayLike, above: ArrayLike) -> Array:
        """(N,) [m]: lowest surface at points (N, 2) above heights (N,) [m]; infinite: none."""
        points, above = np.asarray(points, np.float64), np.asarray(above, np.float64)
        origins = np.column_stack([points, above + 1e-3])
        found, _ = self.ranges(origins, np.broadcast_to([0.0, 0.0, 1.0], origins.shape))
        return np.asarray(origins[:, 2] + found)


def _add_geom(body: mujoco.MjsBody, solid: Solid) -> None:
    x, y, half_height = solid.size
    is_cylinder = solid.kind == "cylinder"
    quaternion = Rotation.from_euler("yz", [solid.pitch, solid.yaw]).as_quat()
    body.add_geom(
        type=getattr(mujoco.mjtGeom, f"mjGEOM_{solid.kind.upper()}"),
        pos=solid.center,
        size=(x, half_height, 0.0) if is_cylinder else (x, y, half_height),
        quat=np.roll(quaternion, 1),
        group=_OVERHEAD_GROUP if solid.is_overhead else 0,
    )


def _add_terrain(spec: mujoco.MjSpec, terrain: Terrain) -> None:
    """As tiles: a ray is tested against all triangles of the rectangle that it crosses."""
    rows, columns = terrain.height.shape
    for row in range(0, rows - 1, _TERRAIN_TILE):
        for column in range(0, columns - 1, _TERRAIN_TILE):
            height = terrain.height[
                row : row + _TERRAIN_TILE + 1, column : column + _TERRAIN_TILE + 1
            ]
            low, high = float(height.min()), float(height.max())
            half = 0.5 * terrain.spacing * (np.array(height.shape[::-1]) - 1)
            corner = np.array(terrain.origin) + terrain.spacing * np.array([column, row])
            name = f"terrain {row} {column}"
            spec.add_hfield(
                name=name,
                nrow=height.shape[0],
                ncol=height.shape[1],
                size=(*half, max(high - low, 1e-3), 1.0),
                userdata=height.astype(np.float32).ravel(),
            )
            spec.worldbody.add_geom(
                type=mujoco.mjtGeom.mjGEOM_HFIELD,
                hfieldname=name,
                pos=(*(corner + half), low),
            )
