# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The exception for bad input from outside."""


class InputError(Exception):
    """Bad input from outside: a bag, a YAML file, a map directory, a message, a parameter.

    The message is one line that names the file, topic, parameter or field, and what is wrong
    with it. ``main()`` catches it once and prints that line; a node logs it and keeps running.
    """
