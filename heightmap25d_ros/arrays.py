# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What the whole package shares of arrays."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
"""Double precision: coordinates, angles, covariances."""


def cells_of_mask(mask: NDArray[np.bool_]) -> NDArray[np.int64]:
    """(N, 2): row and column of the cells of a mask, as kernels take them.

    In memory they are row by row, however many there are: `numpy.argwhere` alone has them column by
    column unless there are none, and a kernel would be compiled for each.
    """
    return np.ascontiguousarray(np.argwhere(mask))
