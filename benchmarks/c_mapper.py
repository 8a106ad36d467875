# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The mapper in C (mapper.c) behind the interface of `heightmap25d_ros.mapper.Mapper`."""

from __future__ import annotations

import ctypes
import functools
import subprocess
import tempfile
from pathlib import Path

from heightmap25d_ros.grid.height_grid import HeightGrid
from heightmap25d_ros.grid.height_map import HEIGHT_RESOLUTION, stored_probability
from heightmap25d_ros.mapping.sensor_model import Beams
from heightmap25d_ros.params.sections import MapperParams, SensorParams

COMPILER = ("cc", "-O3", "-march=native", "-ffp-contract=off", "-fPIC", "-shared")
SOURCE = Path(__file__).with_name("mapper.c")


class _Likelihoods(ctypes.Structure):
    _fields_ = [
        (name, ctypes.c_double)
        for name in ("object_near", "object_far", "empty_near", "empty_far", "max_range")
    ]


class _Rule(ctypes.Structure):
    _fields_ = [
        *((name, ctypes.c_int64) for name in ("candidate", "tolerance", "allowance", "known")),
        *((name, ctypes.c_int64) for name in ("lowest", "highest", "candidate_belief")),
        *(
            (name, ctypes.c_double)
            for name in ("clearing_margin", "clearing_fall", "clearing_width")
        ),
        ("replace_belief", ctypes.c_double),
    ]


class _Grid(ctypes.Structure):
    _fields_ = [
        *((name, ctypes.c_int64) for name in ("tile_rows", "tile_columns")),
        *(
            (name, ctypes.c_double)
            for name in ("corner_x", "corner_y", "ground_zero", "cells_per_metre")
        ),
        *((name, ctypes.c_void_p) for name in ("heights", "probabilities", "candidate_heights")),
        *((name, ctypes.c_void_p) for name in ("candidates", "tile_top", "tile_changed")),
        *((name, ctypes.c_void_p) for name in ("observed", "changed")),
    ]


@functools.cache
def _library() -> ctypes.CDLL:
    with tempfile.TemporaryDirectory() as directory:
        library = Path(directory) / "mapper.so"
        subprocess.run([*COMPILER, str(SOURCE), "-o", str(library), "-lm"], check=True)
        return ctypes.CDLL(str(library))


class CMapper:
    """As `Mapper`; its grid is the same `HeightGrid`."""

    def __init__(self, grid: HeightGrid, sensor: SensorParams, params: MapperParams) -> None:
        self.grid = grid
        candidate = params.update_rule == "candidate"
        likelihoods = (
            (*sensor.hit_given_object, *sensor.hit_given_empty, sensor.max_range),
            (*sensor.miss_given_object, *sensor.miss_given_empty, sensor.max_range),
        )
        rule = _Rule(
            candidate=candidate,
            tolerance=round(params.height_tolerance / HEIGHT_RESOLUTION),
            allowance=round(params.height_allowance / HEIGHT_RESOLUTION) if candidate else 0,
            clearing_width=params.clearing_width / 2,
            known=stored_probability(params.probability_threshold),
            lowest=stored_probability(params.probability_min),
            highest=stored_probability(params.probability_max),
            candidate_belief=stored_probability(params.candidate_belief),
            clearing_margin=params.clearing_margin / HEIGHT_RESOLUTION if candidate else 0.0,
            clearing_fall=params.clearing_fall / HEIGHT_RESOLUTION if candidate else 0.0,
            replace_belief=params.replace_belief,
        )
        arrays = (
            grid.height.cells,
            grid.probability.cells,
            grid.candidate_height.cells,
            grid.candidate_probability.cells,
            grid.tile_top,
            grid.tile_changed,
            grid.observed,
            grid.changed,
        )
        geometry = grid.geometry
        c_grid = _Grid(
            *grid.tile_top.shape,
            *geometry.origin,
            geometry.ground_zero,
            1.0 / geometry.resolution,
            *(array.ctypes.data for array in arrays),
        )
        self._counts = (ctypes.c_int64 * 3)()
        self._constants = (
            ctypes.byref(c_grid),
            *(ctypes.byref(_Likelihoods(*values)) for values in likelihoods),
            ctypes.byref(rule),
            ctypes.byref(self._counts),
        )
        self._integrate = _library().integrate
        self._integrate.restype = None

    def integrate(self, beams: Beams) -> None:
        """Merge the beams, one after the other."""
        self._integrate(
            ctypes.c_void_p(beams.origins.ctypes.data),
            ctypes.c_void_p(beams.ends.ctypes.data),
            ctypes.c_void_p(beams.is_hit.ctypes.data),
            ctypes.c_void_p(beams.is_lone.ctypes.data),
            ctypes.c_int64(len(beams.ends)),
            *self._constants,
        )
