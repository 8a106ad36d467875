# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Compiles what the nodes need, so that their first start is as quick as the ones after it."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor

from heightmap25d_ros.exploration import explorer
from heightmap25d_ros.params.by_name import with_values
from heightmap25d_ros.params.sections import Params
from heightmap25d_ros.pipelines import localization, mapping

PARAMS = with_values(Params(), {"intake.cloud_topics": ["points"]})  # those of clouds, too


def compile_mapping() -> None:
    """And what shows its maps."""
    mapping.compile_kernels(PARAMS)


def compile_localization() -> None:
    """Registration, search and scan filter."""
    localization.compile_kernels(PARAMS)


def compile_own_map() -> None:
    """Localization on a map that the robot makes."""
    localization.compile_kernels(with_values(PARAMS, {"localization.own_map": True}))


def main() -> None:
    """Compile on all cores; what two processes need is compiled by the one that is first."""
    nodes: list[Callable[[], None]] = [
        compile_mapping,
        compile_localization,
        compile_own_map,
        explorer.compile_kernels,  # and planning's
    ]
    with ProcessPoolExecutor() as pool:
        for done in [pool.submit(node) for node in nodes]:
            done.result()


if __name__ == "__main__":
    main()
