# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0

import re

import pytest
import yaml
from repository import ROOT

from heightmap25d_ros.errors import InputError
from heightmap25d_ros.params.by_name import REMOVED, RENAMED, flatten, with_values
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
