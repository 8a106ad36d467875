# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Messages of point clouds into a `Cloud`: PointCloud2 in any layout, compressed ones, and Livox's.

x, y and z may be float32 or float64, at any offset, of either endianness, with padding after each
point and each row. Drivers name and scale the times of points in many ways: `_offsets_ns` decides.
"""

from __future__ import annotations

import zlib
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from heightmap25d_ros.errors import InputError
from heightmap25d_ros.io._compression import zstd
from heightmap25d_ros.io.decode import frame_name, stamp_ns
from heightmap25d_ros.mapping.cloud import Cloud

MOST_POINTS = 4_000_000
"""Of a cloud. No sensor has that many; a message that claims more is damaged, or meant to harm."""

LONGEST_SWEEP = 2.0
"""Time from the first point of a cloud to the last one [s]."""

SHORTEST_SWEEP = 5e-4
"""The same, where they differ at all [s]: shorter ones are in another unit, as microseconds."""

FARTHEST_STAMP = 1.0
"""Time from the stamp of a cloud to the nearest of its points [s]."""

_MOST_BYTES = 64 * MOST_POINTS  # of a cloud that is compressed

TIME_FIELDS = ("t", "time", "timestamp", "time_stamp", "offset_time", "time_offset")
RING_FIELDS = ("ring", "channel", "line")

_TYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}
_NAMES = {1: "INT8", 2: "UINT8", 3: "INT16", 4: "UINT16", 5: "INT32", 6: "UINT32", 7: "FLOAT32",
          8: "FLOAT64"}  # fmt: skip
_FLOATS = (7, 8)
_UNITS = {"seconds": 1e9, "nanoseconds": 1.0}  # [ns]
_LINES = 1 << 16
_ENOUGH_IN_LINES = 3  # points of a line without which it has no neighbours to speak of


def cloud(message: Any) -> Cloud:
    """`Cloud` of a message of one of the types that a topic of clouds may have, by duck type.

    Raises
    ------
    InputError
        If it has no x, y or z of a floating-point type, its sizes contradict one another or the
        number of bytes, the times of its points contradict its stamp, or it is compressed in a way
        that is not known.
    """
    if hasattr(message, "timebase"):
        return _livox(message)
    if hasattr(message, "compressed_data"):
        return _point_cloud(_inflated(message))
    return _point_cloud(message)


def _livox(message: Any) -> Cloud:
    """Of a livox_ros_driver2/CustomMsg: times after ``timebase``, which the stamp is as well."""
    stamp = stamp_ns(message.header)
    frame_id = frame_name(message.header.frame_id, "header.frame_id")
    points = message.points
    if not 0 < len(points) <= MOST_POINTS or len(points) != int(message.point_num):
        raise InputError(f"point_num: {int(message.point_num)}, with {len(points)} points")
    columns = [
        np.fromiter((getattr(p, name) for p in points), kind, len(points))
        for name, kind in (("x", "f4"), ("y", "f4"), ("z", "f4"), ("offset_time", "i8"),
                           ("line", "u2"))
    ]  # fmt: skip
    offsets = columns[3]
    if offsets.max() - offsets.min() > LONGEST_SWEEP * 1e9 or offsets.min() > FARTHEST_STAMP * 1e9:
        raise InputError(
            f"offset_time: {offsets.min()} to {offsets.max()} ns are no sweep after the stamp"
        )
    return Cloud(
        stamp_ns=stamp,
        frame_id=frame_id,
        points=np.stack(columns[:3], axis=1),
        offsets_ns=offsets,
        lines=columns[4],
        has_gaps=True,
        told="neighbours in rings (line); time of each point: offset_time, nanoseconds after the "
        "stamp of the header",
    )


def _inflated(message: Any) -> Any:
    """The PointCloud2 in a point_cloud_interfaces/CompressedPointCloud2, without loss."""
    row = max(int(message.row_step), int(message.width) * int(message.point_step))
    size = row * int(message.height)
    if not 0 < size <= _MOST_BYTES:
        raise InputError(f"row_step: {message.row_step} x {message.height} bytes are no cloud")
    packed = np.asarray(message.compressed_data, np.uint8).tobytes()
    try:
        if message.format == "zlib":
            data = zlib.decompressobj(wbits=zlib.MAX_WBITS | 32).decompress(packed, size)
        elif message.format == "zstd":
            data = zstd.ZstdDecompressor().decompress(packed, size)
        else:
            raise InputError(
                f"format: {message.format[:40]!r} is not read, only zlib and zstd: set the "
                "publisher's point_cloud_transport to one of them"
            )
    except (zlib.error, zstd.ZstdError) as error:
        raise InputError(f"compressed_data: {message.format}: {error}") from None
    fields = ("header", "height", "width", "fields", "is_bigendian", "point_step", "row_step")
    values = {name: getattr(message, name) for name in fields}
    return SimpleNamespace(**values, data=np.frombuffer(data, np.uint8))


def _point_cloud(message: Any) -> Cloud:
    stamp = stamp_ns(message.header)
    frame_id = frame_name(message.header.frame_id, "header.frame_id")
    records = _Records(message)
    points = np.empty((records.count, 3), np.float32)
    for column, name in enumerate("xyz"):
        with np.errstate(over="ignore"):  # of a float64: becomes infinite, which is no return
            points[:, column] = records.coordinate(name)
    offsets, time_told = _offsets_ns(records, points, stamp)
    lines, has_gaps, line_told = _lines(records)
    return Cloud(
        stamp_ns=stamp,
        frame_id=frame_id,
        points=points,
        offsets_ns=offsets,
        lines=lines,
        has_gaps=has_gaps,
        told=f"{line_told}; {time_told}",
    )


@dataclass(frozen=True, slots=True)
class _Field:
    """Where a number stands in the record of a point."""

    offset: int
    datatype: int


class _Records:
    """The points of a message as records of which single fields are read, without copies.

    Raises
    ------
    InputError
        If the sizes of the message do not go together.
    """

    def __init__(self, message: Any) -> None:
        self.width, self.height = int(message.width), int(message.height)
        self.count = self.width * self.height
        self._step = int(message.point_step)
        self._order = ">" if message.is_bigendian else "<"
        if not self.count:
            raise InputError(f"width: {self.width} x {self.height} points are no cloud")
        if self.count > MOST_POINTS:
            raise InputError(
                f"width: {self.width} x {self.height} points are more than {MOST_POINTS}"
            )
        if self._step < 1:
            raise InputError(f"point_step: {self._step} bytes")
        # Many drivers of clouds with one row leave row_step out.
        filled = self.width * self._step
        self._row_step = filled if self.height == 1 else int(message.row_step)
        if self._row_step < filled:
            raise InputError(
                f"row_step: {self._row_step} bytes for {self.width} points of {self._step}"
            )
        self._data = np.asarray(message.data, np.uint8)
        needed = self._row_step * (self.height - 1) + filled
        if len(self._data) < needed:
            raise InputError(
                f"data: {len(self._data)} bytes, {self.width} x {self.height} points need {needed}"
            )
        self._fields: dict[str, _Field] = {}
        for field in message.fields:
            self._fields.setdefault(str(field.name), _Field(int(field.offset), int(field.datatype)))

    def coordinate(self, name: str) -> NDArray[Any]:
        """(count,) float32 or float64 [m]: x, y or z."""
        if name not in self._fields:
            raise InputError(f"fields: no {name}, only {', '.join(self._fields)[:80] or 'none'}")
        datatype = self._fields[name].datatype
        if datatype not in _FLOATS:
            told = _NAMES.get(datatype, str(datatype))
            raise InputError(f"fields: {name} is of type {told}, not FLOAT32 or FLOAT64")
        return self._values(name)

    def optional(self, names: tuple[str, ...]) -> tuple[str, NDArray[Any]] | None:
        """The first of some fields that there is, and its values (count,)."""
        for name in names:
            if name in self._fields:
                return name, self._values(name)
        return None

    def _values(self, name: str) -> NDArray[Any]:
        field = self._fields[name]
        if field.datatype not in _TYPES:
            raise InputError(f"fields: {name} is of type {field.datatype}, which there is not")
        dtype = np.dtype(self._order + _TYPES[field.datatype])
        if not 0 <= field.offset <= self._step - dtype.itemsize:
            raise InputError(
                f"fields: {name} at byte {field.offset} is not within the {self._step} of a point"
            )
        rows = np.ndarray(
            (self.height, self.width), dtype, self._data, field.offset,
            (self._row_step, self._step),
        )  # fmt: skip
        return rows.reshape(-1)


def _lines(records: _Records) -> tuple[NDArray[np.uint16] | None, bool, str]:
    """Lines of neighbouring points, whether points are left out of them, and where they are from.

    The ring goes before the rows: some drivers put a ring in each column.
    """
    is_organized = records.height > 1 and records.width > 1
    found = records.optional(RING_FIELDS)
    if found is not None:
        name, rings = found
        if rings.dtype.kind in "iu" and rings.min() >= 0 and rings.max() < _LINES:
            lines = rings.astype(np.uint16)
            count = int(lines.max()) + 1
            if records.count >= _ENOUGH_IN_LINES * count:
                return lines, not is_organized, f"neighbours in rings ({name})"
    if is_organized and records.height < _LINES:
        rows = np.repeat(np.arange(records.height, dtype=np.uint16), records.width)
        return rows, False, "neighbours in rows"
    return None, False, "neither rows nor rings, so that outliers are not found"


def _offsets_ns(
    records: _Records, points: NDArray[np.float32], stamp: int
) -> tuple[NDArray[np.int64] | None, str]:
    """Times of the points after the stamp [ns], and how they were read; None: there are none.

    Integers are nanoseconds, floats seconds or nanoseconds; either are times since the stamp, or
    absolute ones. Of what is possible that is meant which comes nearest to the stamp, and of
    several that do, that which lasts longest: 0 .. 0.1 are tenths of a second, not of a nanosecond.
    """
    found = records.optional(TIME_FIELDS)
    if found is None:
        return None, "all points at the stamp of the header"
    name, values = found
    is_float = values.dtype.kind == "f"
    is_return = np.isfinite(points[:, 0]) & np.isfinite(values)
    if not is_return.any():
        return None, "all points at the stamp of the header"
    times = values.astype(np.float64)
    low, high = float(times[is_return].min()), float(times[is_return].max())
    best: tuple[float, float, str, float, float] | None = None
    for unit, scale in _UNITS.items() if is_float else [("nanoseconds", 1.0)]:
        for zero, meaning in ((0.0, "after the stamp of the header"), (stamp / scale, "absolute")):
            first, last = (low - zero) * scale * 1e-9, (high - zero) * scale * 1e-9
            apart = max(first, -last, 0.0)
            is_sweep = low == high or SHORTEST_SWEEP <= last - first <= LONGEST_SWEEP
            if is_sweep and apart <= FARTHEST_STAMP:
                # A microsecond is within the rounding of an absolute time.
                rank = (round(apart, 6), first - last)
                told = f"time of each point: {name}, {unit} {meaning}"
                best = min(filter(None, [best, (*rank, told, zero, scale)]))
    if best is None:
        raise InputError(
            f"{name}: {low:.10g} to {high:.10g} are neither seconds nor nanoseconds of a sweep at "
            f"the stamp {stamp * 1e-9:.3f} s"
        )
    _, _, told, zero, scale = best
    if low == high == zero:
        return None, "all points at the stamp of the header"
    offsets = np.where(is_return, (times - zero) * scale, (low - zero) * scale)
    return np.rint(offsets).astype(np.int64), told
