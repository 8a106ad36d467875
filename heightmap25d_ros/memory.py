# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Memory is estimated before it is taken: what is too large is refused, not killed for."""

from __future__ import annotations

from pathlib import Path

from heightmap25d_ros.errors import InputError


def require(size: int, purpose: str) -> None:
    """Refuse work that needs more memory than the machine has available.

    Parameters
    ----------
    size : int [bytes]
        An estimate.
    purpose : str
        Of the memory, with which the message begins.

    Raises
    ------
    InputError
        If that is more than is available.
    """
    available = available_bytes()
    if size > available:
        raise InputError(
            f"{purpose} needs about {size / 2**30:.1f} GiB of memory, "
            f"{available / 2**30:.1f} GiB are available"
        )


def available_bytes() -> int:
    """Memory that can be taken without swapping [bytes]."""
    for line in Path("/proc/meminfo").read_text(encoding="ascii").splitlines():
        name, _, value = line.partition(":")
        if name == "MemAvailable":
            return int(value.split()[0]) * 1024
    raise OSError("/proc/meminfo does not tell MemAvailable")
