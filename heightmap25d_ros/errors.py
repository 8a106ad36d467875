# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Exceptions for bad input and for a command whose answer is no; foreign text made printable."""

from typing import Any

_LONGEST, _LONGEST_QUOTED = 2000, 200


def printable(text: str, longest: int = _LONGEST) -> str:
    r"""Foreign text in one line, that every log, terminal and message can hold.

    Parameters
    ----------
    text : str
    longest : int
        Number of characters from which on it is cut.

    Examples
    --------
    >>> print(printable("two\nlines"))
    two\nlines
    >>> printable("Karte_ä" * 1000, longest=10)
    'Karte_äKar...'
    """
    cut = f"{text[:longest]}..." if len(text) > longest else text
    if cut.isprintable():
        return cut
    return "".join(c if c.isprintable() else ascii(c)[1:-1] for c in cut)


def quoted(value: Any) -> str:
    """A foreign value as an error quotes it: short.

    Examples
    --------
    >>> quoted(["x" * 1000])[-6:]
    'xxx...'
    """
    return printable(repr(value), _LONGEST_QUOTED)


class InputError(Exception):
    """Bad input from outside: a bag, a YAML file, a map directory, a message, a parameter.

    The message is one line that names the file, topic, parameter or field, and what is wrong
    with it. ``main()`` catches it once and prints that line; a node logs it and keeps running.
    """

    def __init__(self, message: str) -> None:
        super().__init__(printable(message))


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
