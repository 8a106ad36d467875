# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The one place through which every callback, service and timer of every node runs."""

from __future__ import annotations

import functools
import traceback
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from rcl_interfaces.msg import ParameterType, SetParametersResult
from rcl_interfaces.srv import SetParameters, SetParametersAtomically
from rclpy.node import Node

from heightmap25d_ros.errors import printable

_LONGEST_TOLD = 200  # characters of an exception's text, which may be anybody's
_LONGEST_TRACEBACK = 4000  # characters

_LAST_TYPE = ParameterType.PARAMETER_STRING_ARRAY


class Guard:
    """What a callback raises is logged and counted, and does not reach the executor.

    Of many failures of one kind (type and line) the first one is logged, with its traceback.

    Parameters
    ----------
    node : rclpy.node.Node
        Whose log it is.

    Attributes
    ----------
    failures : Counter of str
        How often callbacks failed, by kind.
    newest : str
        What the newest failure was.
    """

    def __init__(self, node: Any) -> None:
        self.failures: Counter[str] = Counter()
        self.newest = ""
        self._node = node

    @contextmanager
    def catching(self) -> Iterator[None]:
        """A block that ends where it fails."""
        try:
            yield
        except Exception as error:
            self._record(error)

    def wrapped(self, callback: Callable[..., Any]) -> Callable[..., Any]:
        """The callback, guarded.

        A service's one must return the response, which says no unless it was filled.
        """

        @functools.wraps(callback)
        def guarded(*arguments: Any) -> Any:
            with self.catching():
                return callback(*arguments)
            return arguments[1] if len(arguments) > 1 else None

        return guarded

    def _record(self, error: Exception) -> None:
        frame = traceback.extract_tb(error.__traceback__)[-1]
        kind = f"{type(error).__name__} in {frame.name}, line {frame.lineno} of {frame.filename}"
        self.newest = printable(f"{type(error).__name__}: {error}", _LONGEST_TOLD)
        self.failures[kind] += 1
        if self.failures[kind] == 1:
            lines = "".join(traceback.format_tb(error.__traceback__)).splitlines()
            told = "\n".join(printable(line, _LONGEST_TOLD) for line in lines)
            self._node.get_logger().error(f"{self.newest}\n{told[-_LONGEST_TRACEBACK:]}")


class GuardedCallbacks(Node):
    """A node that no exception of a callback, a service or a timer ends.

    Attributes
    ----------
    guard : Guard
    """

    def __init__(self, *arguments: Any, **options: Any) -> None:
        self.guard = Guard(self)
        super().__init__(*arguments, **options)

    def create_subscription(
        self, kind: Any, topic: str, callback: Callable[..., Any], *arguments: Any, **options: Any
    ) -> Any:
        """As of `rclpy.node.Node`, guarded."""
        guarded = self.guard.wrapped(callback)
        return super().create_subscription(kind, topic, guarded, *arguments, **options)

    def create_service(
        self, kind: Any, name: str, callback: Callable[..., Any], *arguments: Any, **options: Any
    ) -> Any:
        """As of `rclpy.node.Node`, guarded."""
        if kind in (SetParameters, SetParametersAtomically):
            callback = _refusing_unknown_types(callback)
        return super().create_service(
            kind, name, self.guard.wrapped(callback), *arguments, **options
        )

    def create_timer(
        self, period: float, callback: Callable[..., Any], *arguments: Any, **options: Any
    ) -> Any:
        """As of `rclpy.node.Node`, guarded."""
        return super().create_timer(period, self.guard.wrapped(callback), *arguments, **options)


def _refusing_unknown_types(answer: Callable[[Any, Any], Any]) -> Callable[[Any, Any], Any]:
    """A service of parameters, in which rclpy raises for a type that it does not know."""

    def checked(request: Any, response: Any) -> Any:
        unknown = {p.value.type for p in request.parameters if p.value.type > _LAST_TYPE}
        if not unknown:
            return answer(request, response)
        refused = SetParametersResult(reason=f"there is no type {min(unknown)} of parameters")
        if hasattr(response, "results"):
            response.results = [refused] * len(request.parameters)
        else:
            response.result = refused
        return response

    return checked
