"""What a seed draws, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest
from pydantic import ValidationError
from scipy.spatial.transform import Rotation

from robomirror_drake.config import Scenario, load_scenario
from robomirror_drake.disturbance import (
    DisturbanceOptions,
    RandomPushes,
    SensorNoise,
    StartErrors,
)
from robomirror_drake.disturbance_draw import (
    draw,
    measured,
    random_push,
    start_error,
    stream_rng,
)
from robomirror_drake.systems.whole_body_controller import ControllerOptions
from robomirror_drake.yaml_file import to_yaml


def test_nothing_is_disturbed_by_default():
    drawn = draw(DisturbanceOptions(), seed=5, links=24)
    assert drawn.friction is None
    assert (drawn.mass, drawn.latency, drawn.lag, drawn.strength) == (1.0, 0.0, 0.0, 1.0)
    assert not drawn.center_of_mass.any()
    assert not drawn.start.any()


def test_draws_lie_in_their_ranges_and_depend_on_nothing_but_the_seed():
    moderate = load_scenario("moderate").simulation.disturbance
    draws = [draw(moderate, seed, links=24) for seed in range(200)]
    friction = np.array([drawn.friction for drawn in draws])
    mass = np.array([drawn.mass for drawn in draws])
    for values, low, high in ((friction, 0.5, 1.0), (mass, 0.95, 1.05)):
        assert (values >= low).all()
        assert (values <= high).all()
        assert values.mean() == pytest.approx((low + high) / 2, abs=0.06 * (high - low))
        assert np.ptp(values) > 0.95 * (high - low)
    assert abs(np.corrcoef(friction, mass)[0, 1]) < 0.2
    assert {drawn.latency for drawn in draws} == {0.008}
    # Another range for one quantity leaves the others as they were.
    other = DisturbanceOptions.model_validate(moderate.model_dump() | {"mass": (-0.2, 0.2)})
    assert draw(other, 7, links=24).friction == draws[7].friction
    assert draw(other, 7, links=24).mass != draws[7].mass


def test_the_moderate_scenario_is_as_stated():
    moderate = load_scenario("moderate")
    noise = moderate.simulation.disturbance.sensors
    assert (noise.joint_position, noise.joint_velocity, noise.orientation) == (0.002, 0.05, 0.01)
    latency = moderate.simulation.disturbance.actuators.latency
    default = ControllerOptions()
    assert moderate.simulation.controller.delay == pytest.approx(default.delay + latency[0])
    nothing = {"disturbance": DisturbanceOptions(), "controller": default}
    calm = moderate.model_copy(
        update={"simulation": moderate.simulation.model_copy(update=nothing)}
    )
    assert calm == Scenario()


def test_noise_has_its_standard_deviations_and_no_memory():
    noise = SensorNoise(
        joint_position=0.002, joint_velocity=0.05, orientation=0.01, angular_velocity=0.03
    )
    rng = np.random.default_rng(0)
    state = rng.standard_normal(59)
    state[:4] /= np.linalg.norm(state[:4])
    seen = np.array([measured(state, noise, 3, tick) for tick in range(2000)])
    error = seen - state
    for columns, deviation in ((slice(7, 30), 0.002), (slice(30, 33), 0.03), (slice(36, 59), 0.05)):
        assert error[:, columns].std() == pytest.approx(deviation, rel=0.03)
        np.testing.assert_allclose(error[:, columns].mean(axis=0), 0.0, atol=0.1 * deviation)
    turn = Rotation.from_quat(state[:4], scalar_first=True).inv() * Rotation.from_quat(
        seen[:, :4], scalar_first=True
    )
    assert turn.as_rotvec().std(axis=0) == pytest.approx(0.01, rel=0.06)
    # The position of the base and its velocity are as they are.
    assert not error[:, [4, 5, 6, 33, 34, 35]].any()
    # Ticks do not know of one another.
    correlation = np.corrcoef(np.hstack([error[:-1, 7:12], error[1:, 7:12]]).T)
    assert np.abs(correlation - np.eye(10)).max() < 0.1
    # In any order, and twice, the same; with another seed not.
    backward = [measured(state, noise, 3, tick) for tick in reversed(range(50))]
    np.testing.assert_array_equal(backward[::-1], seen[:50])
    assert (measured(state, noise, 4, 0)[7:30] != seen[0, 7:30]).all()


def test_random_pushes_lie_within_their_intervals():
    options = RandomPushes(interval=2.0, duration=0.1, speed=(0.3, 0.5))
    pushes = [random_push(options, 1, interval) for interval in range(200)]
    for interval, push in enumerate(pushes):
        assert 2.0 * interval <= push.time <= 2.0 * interval + 1.9
        assert push.speed[2] == 0.0
        assert 0.3 <= np.linalg.norm(push.speed) <= 0.5
    mean = np.mean([push.speed for push in pushes], axis=0)
    assert np.linalg.norm(mean) < 0.08
    assert random_push(options, 1, 7) == pushes[7]
    assert random_push(options, 2, 7) != pushes[7]


def test_the_start_is_off_by_its_standard_deviations_and_in_place():
    errors = StartErrors(
        joint_position=0.01, joint_velocity=0.1, linear_velocity=0.2, angular_velocity=0.3
    )
    off = np.array([start_error(errors, seed, 23) for seed in range(400)])
    assert off.shape == (400, 59)
    for columns, deviation in (
        (slice(7, 30), 0.01),
        (slice(30, 33), 0.3),
        (slice(33, 35), 0.2),
        (slice(36, 59), 0.1),
    ):
        assert off[:, columns].std() == pytest.approx(deviation, rel=0.06)
    assert not off[:, [0, 1, 2, 3, 4, 5, 6, 35]].any()
    drawn = draw(DisturbanceOptions(start=errors), seed=9, links=24)
    np.testing.assert_array_equal(drawn.start, off[9])


def test_streams_are_not_each_other():
    assert stream_rng(1, "mass").uniform() != stream_rng(1, "friction").uniform()
    assert stream_rng(1, "mass").uniform() != stream_rng(2, "mass").uniform()


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"friction": 0.0}, "friction"),
        ({"friction": [1.0, 0.5]}, "lower end of a range comes first"),
        ({"mass": -1.0}, "mass"),
        ({"mass": [0.1]}, "mass"),
        ({"mass": float("nan")}, "mass"),
        ({"center_of_mass": -0.01}, "center_of_mass"),
        ({"sensors": {"joint_position": -0.1}}, "joint_position"),
        ({"sensors": {"imu": 0.1}}, "imu"),
        ({"actuators": {"latency": -0.001}}, "latency"),
        ({"actuators": {"latency": 1.0}}, "latency"),
        ({"actuators": {"strength": 0.0}}, "strength"),
        ({"pushes": [{"time": 1.0}]}, "give one of force, impulse and speed"),
        ({"pushes": [{"time": 1.0, "force": [1, 0, 0], "speed": [1, 0, 0]}]}, "give one of"),
        ({"pushes": [{"time": -1.0, "force": [1, 0, 0]}]}, "time"),
        ({"pushes": [{"time": 1.0, "duration": 0.0, "force": [1, 0, 0]}]}, "duration"),
        ({"pushes": [{"time": 1.0, "force": [1, 0]}]}, "force"),
        ({"random_pushes": {"interval": 0.1, "duration": 0.2}}, "one every 0.1 s"),
        ({"random_pushes": {"speed": -0.3}}, "speed"),
    ],
)
def test_bad_values_are_refused(given, message):
    with pytest.raises(ValidationError, match=message):
        DisturbanceOptions.model_validate(given)


def test_pushes_go_through_yaml(tmp_path):
    push = {"time": 0.5, "speed": [0.0, 0.3, 0.0], "body": "WAIST_R_S"}
    scenario = Scenario.model_validate({"simulation": {"disturbance": {"pushes": [push]}}})
    file = tmp_path / "pushes.yaml"
    file.write_text(to_yaml(scenario), encoding="utf-8")
    assert load_scenario(file) == scenario


def test_what_has_diverged_is_measured_as_such():
    state = np.full(59, np.nan)
    assert np.isnan(measured(state, SensorNoise(orientation=0.01), 0, 0)[:4]).all()
    huge = measured(np.full(59, 1e300), SensorNoise(orientation=0.01), 0, 0)
    assert np.abs(huge).max() >= 1e300


def test_orientation_noise_turns_the_base_about_its_own_axes():
    state = np.zeros(59)
    state[:4] = Rotation.from_euler("xyz", [0.3, -0.2, 1.1]).as_quat(scalar_first=True)
    noise = SensorNoise(orientation=0.05)
    drawn = stream_rng(4, "sensors", 9).standard_normal(52)[:3]
    seen = Rotation.from_quat(measured(state, noise, 4, 9)[:4], scalar_first=True)
    true = Rotation.from_quat(state[:4], scalar_first=True)
    np.testing.assert_allclose((true.inv() * seen).as_rotvec(), 0.05 * drawn, atol=1e-12)
