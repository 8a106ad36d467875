# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The decorators of all compiled kernels.

A compiled kernel contains the kernels that it calls and the constants that it uses, also those of
other modules. numba's cache on disk checks the kernel's own file only, so that an edit of another
module would not take effect. Here the cache of a kernel is stamped with the source of its module
and of all modules of this package that it imports, directly or through others.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

from numba import njit
from numba.core.caching import FunctionCache

_PACKAGE = Path(__file__).parent
_NAMES = _PACKAGE / "__init__.py"  # imports its names when they are used: no kernel needs it
_IMPORT = re.compile(
    rf"^\s*(?:from\s+({_PACKAGE.name}[\w.]*)\s+import\s+(\([^)]*\)|[^\n]*)"
    rf"|import\s+({_PACKAGE.name}[\w.]*))",
    re.MULTILINE,
)


def kernel(function: Callable[..., Any]) -> Any:
    """Compile a function of arrays and scalars when it is first called; cached on disk.

    Division follows numpy's rules and raises nothing. Other threads run meanwhile.
    """
    return _compiled(function)


def inlined_kernel(function: Callable[..., Any]) -> Any:
    """As `kernel`, and inlined into its callers: for where a call would cost too much."""
    return _compiled(function, forceinline=True)


def _compiled(function: Callable[..., Any], **options: Any) -> Any:
    dispatcher = njit(error_model="numpy", nogil=True, **options)(function)
    with suppress(RuntimeError):  # no writable directory: each process compiles again
        dispatcher._cache = _StampedCache(function)
    return dispatcher


class _StampedCache(FunctionCache):
    """numba's cache of a function, stale when an imported module has changed."""

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__(function)  # type: ignore[no-untyped-call]
        self._cache_file._source_stamp = stamp(Path(function.__code__.co_filename))


@cache
def stamp(module: Path) -> str:
    """SHA-256 of the source of a module and of all that it imports from this package."""
    found: dict[Path, bytes] = {}
    waiting = [module]
    while waiting:
        path = waiting.pop()
        if path not in found:
            found[path] = path.read_bytes()
            waiting += _imported(found[path].decode())
    return hashlib.sha256(b"\0".join(found[path] for path in sorted(found))).hexdigest()


def _imported(source: str) -> Iterator[Path]:
    """The files of this package that a source imports."""
    for from_module, names, module in _IMPORT.findall(source):
        parts = (from_module or module).split(".")[1:]
        candidates = [parts, *([*parts, name] for name in re.findall(r"\w+", names))]
        for candidate in candidates:
            base = _PACKAGE.joinpath(*candidate)
            found = (base.with_suffix(".py"), base / "__init__.py")
            yield from (path for path in found if path.is_file() and path != _NAMES)
