# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0

import pytest
import yaml
from repository import ROOT

from heightmap25d_ros.errors import InputError
from heightmap25d_ros.params.by_name import REMOVED, RENAMED, flatten, with_values
from heightmap25d_ros.params.files import as_markdown, as_yaml, read_yaml
from heightmap25d_ros.params.sections import Params, SensorParams

CONFIG = ROOT / "config"


def test_config_file_and_page_of_parameters_are_current():
    assert (CONFIG / "heightmap25d.yaml").read_text() == as_yaml(Params())
    assert as_markdown(Params()) in (ROOT / "docs" / "interface.md").read_text()


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
    document = yaml.safe_load(path.read_text())
    of_all = set(dotted(document["/**"]["ros__parameters"]))
    for node in ("mapping", "planning", "localization"):
        defaults, preset = flatten(Params()), flatten(read_yaml(path, node))
        changed = {name for name in defaults if preset[name] != defaults[name]}
        own = document.get(f"/**/{node}", {"ros__parameters": {}})["ros__parameters"]
        assert of_all | set(dotted(own)) == changed != set()


def test_every_parameter_has_a_meaning_and_every_number_a_range():
    for name, (spec, value) in flatten(Params()).items():
        assert spec.meaning, name
        if isinstance(value, float):
            assert spec.low < spec.high < float("inf"), name


@pytest.mark.parametrize(
    ("name", "value", "complaint"),
    [
        ("grid.resolutoin", 0.1, "did you mean grid.resolution?"),
        ("max_step", 0.1, "did you mean traversability.max_step?"),
        ("grid.resolution", 0.0, "parameter grid.resolution: 0 is not within 0.01 .. 10"),
        ("grid.resolution", float("nan"), "parameter grid.resolution: nan is not within"),
        ("grid.resolution", "fine", "'fine' is not a float"),
        ("grid.resolution", True, "True is not a float"),
        ("mapper.update_rule", "papper", "'papper' is not one of candidate, paper"),
        ("intake.scan_topics", "scan", "'scan' is not a list"),
        ("intake.scan_topics", [3], "3 is not a str"),
        ("intake.mounts", [0.0, 1.0], "2 numbers for 1 lasers"),
        ("sensor.hit_given_object", [0.8], "needs two numbers"),
        ("sensor.hit_given_empty", [0.9, 0.4], "must exceed hit_given_empty"),
        ("mapper.probability_max", 0.8, "must not exceed probability_max"),
        ("mapper.probability_min", 0.5, "must lie between"),
        ("mapper.bogus", 1, "parameter mapper.bogus: unknown"),
        ("intake.scan_topics", ["a", "a"], "named twice"),
        ("intake.scan_topics", [""], "is empty"),
        ("mapping.map_frame", "", "is empty"),
        ("sensor.min_height", 3.0, "must be below max_height"),
    ],
)
def test_a_bad_parameter_is_refused_with_its_name(name, value, complaint):
    with pytest.raises(InputError) as error:
        with_values(Params(), {name: value})
    assert complaint in str(error.value)
    assert "\n" not in str(error.value)


def test_values_are_taken_all_or_none_and_integers_pass_for_floats():
    changed = with_values(Params(), {"grid.resolution": 1, "intake.mounts": [0, 0, 1, 0, 0, 0]})
    assert changed.grid.resolution == 1.0
    assert changed.intake.mounts == (0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
    assert changed.sensor == SensorParams()


def test_yaml_of_one_node_or_of_all_with_dots_or_nested(tmp_path):
    path = tmp_path / "p.yaml"
    path.write_text(
        "mapping:\n  ros__parameters:\n    grid.resolution: 0.25\n    sensor: {max_range: 20.0}\n"
    )
    params = read_yaml(path, "mapping")
    assert (params.grid.resolution, params.sensor.max_range) == (0.25, 20.0)
    assert read_yaml(path, "planning") == Params()


def test_a_node_takes_the_blocks_of_all_nodes_and_its_own(tmp_path):
    path = tmp_path / "p.yaml"
    path.write_text(
        "/**:\n  ros__parameters: {sensor.max_range: 20.0, grid.resolution: 0.25}\n"
        "/**/mapping:\n  ros__parameters: {sensor.max_range: 6.0}\n"
        "/robot/planning:\n  ros__parameters: {planner.timeout: 3.0}\n"
    )
    mapping, planning = (read_yaml(path, node) for node in ("mapping", "planning"))
    assert (mapping.sensor.max_range, planning.sensor.max_range) == (6.0, 20.0)
    assert (mapping.planner.timeout, planning.planner.timeout) == (2.0, 3.0)
    assert mapping.grid.resolution == planning.grid.resolution == 0.25


@pytest.mark.parametrize(
    "text",
    ["a: [", "just words", "/**: 3", "/**: {ros__parameters: 3}", "/**:\n  ros__parameters:\n"
     "    gird: {resolution: 1.0}", "\x00", ""],
)  # fmt: skip
def test_a_bad_file_is_refused_in_one_line_with_its_name(tmp_path, text):
    path = tmp_path / "p.yaml"
    path.write_text(text)
    with pytest.raises(InputError, match=r"p\.yaml") as error:
        read_yaml(path, "mapping")
    assert "\n" not in str(error.value)


def test_a_missing_file_is_refused(tmp_path):
    with pytest.raises(InputError, match="nowhere"):
        read_yaml(tmp_path / "nowhere.yaml", "mapping")


def test_the_generated_yaml_holds_every_parameter():
    document = yaml.safe_load(as_yaml(Params()).replace("# mounts:", "mounts:"))
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
