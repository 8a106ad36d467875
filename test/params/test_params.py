# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0

import re

import pytest
import yaml
from repository import ROOT

from heightmap25d_ros.errors import InputError
from heightmap25d_ros.params import sources
from heightmap25d_ros.params.by_name import REMOVED, RENAMED, flatten, is_live, with_values
from heightmap25d_ros.params.files import as_markdown, as_yaml, read_yaml
from heightmap25d_ros.params.sections import Params

CONFIG = ROOT / "config"


def test_config_file_and_page_of_parameters_are_current():
    assert (CONFIG / "heightmap25d.yaml").read_text() == as_yaml(Params())
    assert as_markdown(Params()) in (ROOT / "docs" / "interface.md").read_text()


@pytest.mark.parametrize("path", sorted(CONFIG.glob("*.yaml")), ids=lambda path: path.name)
@pytest.mark.parametrize("node", ["mapping", "localization", "planning"])
def test_each_config_file_is_valid_for_each_node(path, node):
    assert read_yaml(path, node) is not None


def test_namespaces_of_a_parameter_file_may_be_nested(tmp_path):
    path = tmp_path / "robots.yaml"
    path.write_text("robot: {mapping: {ros__parameters: {mapping.publish_rate: 3.5}}}")
    assert read_yaml(path, "mapping").mapping.publish_rate == 3.5
    assert read_yaml(path, "planning") == Params()
    path.write_text("robot: {mapping: {ros__parameters: [1]}}")
    with pytest.raises(InputError, match=r"robot/mapping.ros__parameters is not a mapping"):
        read_yaml(path, "mapping")


def test_the_lifecycle_manager_of_nav2_starts_our_nodes_before_who_needs_them():
    blocks = yaml.safe_load((CONFIG / "nav2.yaml").read_text())
    parameters = {name: block.get("ros__parameters") for name, block in blocks.items()}
    ours = ["mapping", "localization", "planning"]
    assert parameters["lifecycle_manager"]["node_names"][:3] == ours
    assert parameters["lifecycle_manager"]["bond_timeout"] == 0.0
    assert not any(parameters[name]["autostart"] for name in ours)
    assert set(parameters["lifecycle_manager"]["node_names"]) == {
        name for name, block in parameters.items() if block and name != "lifecycle_manager"
    }


def test_the_config_file_gives_the_defaults():
    assert read_yaml(CONFIG / "heightmap25d.yaml", "mapping") == Params()


def dotted(document):
    """``section.name`` of all that is in the parameters of a file; those of no section as well."""
    for section, content in document.items():
        yield from (f"{section}.{n}" for n in content) if isinstance(content, dict) else [section]


@pytest.mark.parametrize(
    "path", sorted(set(CONFIG.glob("*.yaml")) - {CONFIG / "heightmap25d.yaml"})
)
def test_a_preset_holds_only_what_differs_from_the_defaults(path):
    lists = "mounts|cloud_topics|cloud_mounts|body_box|boundary"
    every = re.sub(f"# ({lists}):", r"\1:", as_yaml(Params()))
    document = yaml.safe_load(every)
    document = document["/**"]["ros__parameters"]
    assert set(dotted(document)) == set(flatten(Params()))


def test_every_renamed_parameter_has_a_present_name_that_exists():
    assert not RENAMED.keys() & flatten(Params()).keys()
    assert set(RENAMED.values()) <= flatten(Params()).keys()


def test_an_old_name_sets_the_parameter_and_warns_of_both_names_in_one_line():
    message = "short_term.mature_way: .* short_term.mature_distance"
    with pytest.warns(FutureWarning, match=message) as warned:
        params = with_values(Params(), {"short_term.mature_way": 1})
    assert params.short_term.mature_distance == 1.0
    assert ["\n" in str(warning.message) for warning in warned] == [False]


def test_a_removed_parameter_warns_and_changes_nothing():
    assert not REMOVED.keys() & flatten(Params()).keys()
    with pytest.warns(FutureWarning, match="localization.max_odom_step: .* section odometry"):
        params = with_values(Params(), {"localization.max_odom_step": 1.0})
    assert params == Params()


def test_an_old_name_in_a_parameter_file_sets_the_parameter_and_warns(tmp_path):
    path = tmp_path / "p.yaml"
    path.write_text("/**:\n  ros__parameters:\n    short_term: {mature_way: 1.5}\n")
    with pytest.warns(FutureWarning, match="mature_distance"):
        params = read_yaml(path, "localization")
    assert params.short_term.mature_distance == 1.5


def test_a_value_of_an_old_name_is_checked_and_both_names_at_once_are_refused():
    with (
        pytest.warns(FutureWarning),
        pytest.raises(InputError, match=r"short_term\.mature_distance: -1 is not within"),
    ):
        with_values(Params(), {"short_term.mature_way": -1.0})
    both = {"short_term.mature_way": 1.0, "short_term.mature_distance": 1.0}
    with pytest.raises(InputError, match=r"mature_way: is given as short_term\.mature_distance"):
        with_values(Params(), both)


SOURCES = {
    "intake.scan_topics": ["scan", "/front/scan"],
    "intake.cloud_topics": ["/camera/depth/points"],
    "sensor.max_range": 20,
    "sensor.front_scan.max_range": 8,
    "sensor.camera_depth_points.max_range": 4.0,
    "sensor.camera_depth_points.error_growth": "quadratic",
    "sensor.camera_depth_points.mount": [0.2, 0, 0.5, 0, 0.4, 0],
    "cloud.camera_depth_points.step": 4,
}


def test_what_is_set_for_one_source_takes_the_place_of_what_is_set_for_all():
    params = with_values(Params(), {**SOURCES, "sensor.min_height": -2.0})
    front, camera = (
        sources.sensor_of(params, topic) for topic in ("/front/scan", "/camera/depth/points")
    )
    assert sources.sensor_of(params, "scan") == params.sensor
    assert (front.max_range, camera.max_range, params.sensor.max_range) == (8.0, 4.0, 20.0)
    assert (front.error_growth, camera.error_growth) == ("linear", "quadratic")
    assert front.min_height == camera.min_height == -2.0
    assert sources.cloud_of(params, "/camera/depth/points").step == 4
    assert sources.mounts(params) == {"/camera/depth/points": (0.2, 0.0, 0.5, 0.0, 0.4, 0.0)}
    assert sources.max_range(params) == 20.0
    changed = with_values(params, {"sensor.min_height": -1.0, "sensor.front_scan.max_range": 30.0})
    assert sources.sensor_of(changed, "/camera/depth/points").min_height == -1.0
    assert sources.max_range(changed) == 30.0
    assert with_values(Params(), {n: value for n, (_, value) in flatten(params).items()}) == params


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("sensor.scan.max_range", 900.0, r"sensor.scan.max_range: 900 is not within 0.5 .. 200"),
        ("sensor.scan.max_range", "far", "sensor.scan.max_range: 'far' is not a float"),
        ("sensor.scan.max_rnage", 9.0, r"unknown; did you mean sensor.scan.max_range\?"),
        ("sensor.scan.min_height", 3.0, "sensor.scan.min_height: must be below max_height"),
        ("sensor.scan.mount", [1.0], "sensor.scan.mount: 1 numbers; needs six"),
        ("cloud.points.step", 0, "cloud.points.step: 0 is not within 1 .. 1000"),
        ("grid.scan.resolution", 0.1, "grid.scan.resolution: unknown"),
    ],
)
def test_a_wrong_parameter_of_a_source_is_named(name, value, message):
    with pytest.raises(InputError, match=message):
        with_values(Params(), {name: value})


def test_a_source_that_no_topic_is_is_told():
    params = with_values(Params(), {"sensor.scam.max_range": 5.0})
    assert sources.without_topic(params) == [
        "parameter sensor.scam.max_range: no topic is scam, only scan"
    ]


def test_parameters_of_a_source_are_live_as_those_of_all():
    assert is_live("sensor.scan.max_range")
    assert not is_live("sensor.scan.mount")
