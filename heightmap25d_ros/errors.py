# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The exception for bad input from outside, and that of a command whose answer is no."""

from typing import Any


class InputError(Exception):
    """Bad input from outside: a bag, a YAML file, a map directory, a message, a parameter.

    The message is one line that names the file, topic, parameter or field, and what is wrong
    with it. ``main()`` catches it once and prints that line; a node logs it and keeps running.
    """


class NegativeResultError(Exception):
    """A command did its work, and the answer is no.

    Attributes
    ----------
    figures : dict of str to Any
        What it found: printed as otherwise.
    exit_status : int
        Of the process.
    """

    def __init__(self, figures: dict[str, Any], exit_status: int) -> None:
        super().__init__()
        self.figures = figures
        self.exit_status = exit_status
