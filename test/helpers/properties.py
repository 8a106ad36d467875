# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How many examples a property draws: few in the suite, twenty times as many when exploring."""

from __future__ import annotations

from typing import Any

from hypothesis import settings

USUAL = 100
"""Examples of a property that does not say otherwise, in the suite."""


def draws(count: int, **options: Any) -> settings:
    """Settings of a property that draws so many examples in the suite; a decorator.

    Profiles set how many `USUAL` ones are; ``count`` grows with them.
    """
    examples = max(1, round(count * settings.default.max_examples / USUAL))
    return settings(max_examples=examples, **options)
