# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Coverage-guided fuzzing of the readers of files and messages, by atheris (libFuzzer).

``python test/attack/fuzz.py TARGET [libFuzzer's options]``, as ``-runs=100000``. Anything but
`InputError` is a find, and is written to a file ``crash-...``; ``fuzz.py TARGET crash-...`` repeats
it. The targets are in fuzz_targets.py.
"""

from __future__ import annotations

import importlib
import logging
import pkgutil
import sys
import tempfile
from contextlib import suppress
from pathlib import Path

sys.path.append(str(Path(__file__).resolve().parents[1] / "helpers"))

import atheris

import heightmap25d_ros
from heightmap25d_ros import pipelines

# The algorithms come first, as they are: numba cannot compile kernels that are instrumented.
for room in ("", ".grid", ".mapping", ".terrain", ".planning", ".localization", ".exploration"):
    package = importlib.import_module(f"heightmap25d_ros{room}")
    for module in pkgutil.iter_modules(package.__path__, f"{package.__name__}."):
        if not module.ispkg:
            importlib.import_module(module.name)

# Nor those of the pipelines, which import the readers that are fuzzed.
PIPELINES = [m.name for m in pkgutil.iter_modules(pipelines.__path__, f"{pipelines.__name__}.")]

with atheris.instrument_imports(include=[heightmap25d_ros.__name__, "rosbags"], exclude=PIPELINES):
    from fuzz_targets import TARGETS, seeds_of

    from heightmap25d_ros.errors import InputError


def main() -> None:
    target = sys.argv[1]
    read, _ = TARGETS[target]
    logging.disable()

    def one_input(data: bytes) -> None:
        with suppress(InputError):
            read(data)

    with tempfile.TemporaryDirectory() as corpus:
        for index, data in enumerate(seeds_of(target)):
            (Path(corpus) / str(index)).write_bytes(data)
        is_repeated = any(Path(argument).is_file() for argument in sys.argv[2:])
        directories = [] if is_repeated else [corpus]
        atheris.Setup([sys.argv[0], *sys.argv[2:], *directories], one_input)
        atheris.Fuzz()


if __name__ == "__main__":
    main()
