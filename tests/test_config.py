"""Scenarios: defaults, round trip, and clear refusals."""

from __future__ import annotations

import pytest
import yaml

from robomirror_drake.config import Scenario, load_scenario
from robomirror_drake.exceptions import ConfigError
from robomirror_drake.yaml_file import to_yaml


def test_the_shipped_default_is_all_of_the_defaults():
    assert load_scenario("default") == Scenario()


def test_yaml_round_trips(tmp_path):
    scenario = Scenario.model_validate(
        {"command": "bow: 'ü' # then\nwave", "seed": 7, "simulation": {"hold": 1.5}}
    )
    file = tmp_path / "s.yaml"
    file.write_text(to_yaml(scenario), encoding="utf-8")
    assert load_scenario(file) == scenario


@pytest.mark.parametrize(
    ("data", "message"),
    [
        ({"sed": 1}, "sed: there is no such key"),
        ({"seed": -1}, "seed"),
        ({"candidates": 0}, "candidates"),
        ({"simulation": {"time_step": 1.0}}, r"simulation\.time_step.*got 1\.0"),
        ({"planner": {"strenght": 1}}, r"planner\.strenght"),
        ({"simulation": {"friction": float("nan")}}, r"simulation\.friction: nan"),
        ({"simulation": {"hold": float("inf")}}, r"simulation\.hold: inf is not a finite"),
        ({"simulation": {"controller": {"start": float("-inf")}}}, r"controller\.start: -inf"),
        ({"simulation": {"hold": 1e9}}, r"simulation\.hold.*got 1000000000\.0"),
        (["a list"], "top level"),
    ],
)
def test_unknown_keys_and_bad_values_are_named(tmp_path, data, message):
    file = tmp_path / "bad.yaml"
    file.write_text(yaml.safe_dump(data))
    with pytest.raises(ConfigError, match=message):
        load_scenario(file)


def test_every_key_is_written_down_with_what_it_is_for():
    text = to_yaml(Scenario())
    assert yaml.safe_load(text) == Scenario().model_dump(mode="json")
    assert "time_step: 0.002  # of the plant [s]" in text


def test_what_is_no_yaml_and_what_is_no_file_is_said(tmp_path):
    file = tmp_path / "bad.yaml"
    file.write_text("a: [1")
    with pytest.raises(ConfigError, match="not YAML"):
        load_scenario(file)
    with pytest.raises(ConfigError, match="known: closed_loop, default"):
        load_scenario("nonesuch")
