# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""ROS parameters declared from `Params`, and changed as a whole while a node runs."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from rcl_interfaces.msg import (
    FloatingPointRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.node import Node
from rclpy.parameter import Parameter

from heightmap25d_ros.errors import InputError
from heightmap25d_ros.io import map_directory
from heightmap25d_ros.params.by_name import flatten, is_live, with_present_names, with_values
from heightmap25d_ros.params.sections import Params
from heightmap25d_ros.params.spec import Spec, Value
from heightmap25d_ros.terrain.traversability import covering_disc

# Parameters that rclpy brings along in every node.
_RCLPY_PARAMETERS = ("use_sim_time", "start_type_description_service", "qos_overrides.")


def declare_params(node: Node, used: Sequence[str]) -> Params:
    """The parameters of a node, declared with descriptors; a wrong one is an error.

    A parameter file may serve several nodes, so that those of other nodes are checked as well, but
    not declared.

    Parameters
    ----------
    node : Node
        Made with ``automatically_declare_parameters_from_overrides``: only so can an unknown name
        be found and refused.
    used : sequence of str
        Sections (``planner``) and single parameters (``mapping.map_frame``) that the node uses.

    Raises
    ------
    InputError
        For an unknown name (the nearest right one is suggested), a wrong type or value.
    """
    overrides = {
        name: parameter.value
        for name, parameter in node.get_parameters_by_prefix("").items()
        if not name.startswith(_RCLPY_PARAMETERS)
    }
    given, notices = with_present_names(overrides)
    params = _consistent(with_values(Params(), given))
    for notice in notices:
        node.get_logger().warning(notice)
    for name in overrides:
        node.undeclare_parameter(name)
    for name, (spec, value) in used_by(params, used).items():
        descriptor = _descriptor(name, spec, value)
        if value == ():
            _declare_empty(node, name, spec, descriptor)
        else:
            # The override is in the value, and may be an integer where that is not one.
            node.declare_parameter(name, value, descriptor, ignore_override=True)
    return params


def used_by(params: Params, used: Sequence[str]) -> dict[str, tuple[Spec, Value]]:
    """Of all parameters those of some sections, and single ones, by name."""
    return {
        name: entry
        for name, entry in flatten(params).items()
        if name in used or name.partition(".")[0] in used
    }


def _declare_empty(node: Node, name: str, spec: Spec, descriptor: ParameterDescriptor) -> None:
    """Declare an empty list of numbers or strings, which rclpy would take for bytes.

    Declared by its type only it would not be set, and `ros2 param dump` tell of no parameter.
    """
    kind = Parameter.Type.STRING_ARRAY if spec.entries is str else Parameter.Type.DOUBLE_ARRAY
    node.declare_parameter(name, [spec.entries()])
    node.set_parameters([Parameter(name, kind, [])])
    descriptor.type = kind.value
    node.set_descriptor(name, descriptor)


def _consistent(params: Params) -> Params:
    """The same parameters; `InputError` where sections do not go together."""
    covering_disc(params.traversability, params.grid.resolution)
    for name in (params.mapping.autosave, params.mapping.initial_map):
        if name:
            map_directory.check_name(name)
    return params


def _descriptor(name: str, spec: Spec, value: Value) -> ParameterDescriptor:
    descriptor = ParameterDescriptor(
        description=spec.meaning + (f" [{spec.unit}]" if spec.unit else ""),
        additional_constraints=spec.range_text,
        read_only=not is_live(name),
    )
    if isinstance(value, float):
        descriptor.floating_point_range = [
            FloatingPointRange(from_value=spec.low, to_value=spec.high)
        ]
    return descriptor


def follow_changes(
    node: Node, params: Params, used: Sequence[str], take: Callable[[Params], None]
) -> None:
    """Hand over the parameters when live ones change: all of a call, or none and the reason.

    Parameters
    ----------
    node : Node
        Whose parameters were declared by `declare_params`.
    params : Params
        What that returned.
    used : sequence of str
        As there.
    take : callable
        Is called with the new parameters, which are sound.
    """
    current = params

    def changed(changes: list[Parameter]) -> Params:
        known = used_by(current, used)
        values = {p.name: p.value for p in changes if p.name in known}
        return _consistent(with_values(current, values))

    def check(changes: list[Parameter]) -> SetParametersResult:
        try:
            changed(changes)
        except InputError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def adopt(changes: list[Parameter]) -> None:
        nonlocal current
        adopted = changed(changes)
        if adopted != current:
            current = adopted
            take(current)

    node.add_on_set_parameters_callback(check)
    node.add_post_set_parameters_callback(adopt)
