"""The network on the largest torques: what it sees, learns and has a say in."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from scipy.special import expit, logit

from robomirror_drake import checkpoint
from robomirror_drake.exceptions import ConfigError, ResultError
from robomirror_drake.learning.metrics import auroc
from robomirror_drake.learning.motions import foreseen, read_motions
from robomirror_drake.learning.torques import train_torques
from robomirror_drake.ppn.body import Body
from robomirror_drake.ppn.ensemble import Ensemble, load_ensemble
from robomirror_drake.ppn.features import PAD, reference_frames
from robomirror_drake.ppn.mirror import Mirror
from robomirror_drake.ppn.options import TorqueOptions, TrainTorquesOptions
from robomirror_drake.ppn.torques import (
    TorqueNetwork,
    TorquePredictor,
    largest_torques,
    load_torques,
)
from robomirror_drake.robot import load_robot

ROBOT = load_robot()
BODY = Body.of(ROBOT)
OPTIONS = TorqueOptions()


def torch_of(*arrays: np.ndarray) -> list[torch.Tensor]:
    return [torch.from_numpy(array) for array in arrays]


def sways(count: int = 40) -> tuple[np.ndarray, np.ndarray]:
    """Three motions (3, N, 30) at 20 Hz, ever quicker, with their contacts."""
    time = np.arange(count) / 20.0
    q = np.tile(ROBOT.standing, (3, count, 1))
    q[:, :, 7:] += 0.1 * np.sin(np.multiply.outer([1.0, 3.0, 6.0], time))[..., None]
    return q, np.ones((3, count, 2, 4))


@pytest.fixture
def predictor() -> TorquePredictor:
    torch.manual_seed(3)
    network = TorqueNetwork(OPTIONS, 6).double()
    network.fit_scales(largest_torques(BODY, *torch_of(*sways()), OPTIONS))
    return TorquePredictor(network, ROBOT)


def test_it_sees_the_largest_torque_of_either_leg():
    q, contact = torch_of(*sways())
    held = torch.arange(-PAD, q.shape[1] + PAD).clamp(0, q.shape[1] - 1)
    torque = reference_frames(BODY, q[:, held], contact, 0.05).scalars[..., -12:].abs()
    most = torque.amax(1).reshape(3, 2, 6).amax(1)
    sharp = largest_torques(BODY, q, contact, TorqueOptions(power=64.0))
    np.testing.assert_allclose(sharp, most, rtol=0.06, atol=2e-3)
    smooth = largest_torques(BODY, q, contact, OPTIONS)
    assert (smooth >= sharp).all()
    assert (smooth < 1.7 * most + 3e-3).all()


def test_left_and_right_are_the_same_to_it():
    q, contact = (part[:1] for part in sways())
    q[0, 10:20, 7 + ROBOT.joint_names.index("L_KNEE")] += 0.5
    contact[0, 20:, 0] = 0.0
    mirror = Mirror(ROBOT)
    turned = mirror.positions(q), np.ascontiguousarray(mirror.contacts(contact))
    assert abs(turned[0] - q).max() > 0.4
    made, again = (
        largest_torques(BODY, *torch_of(*part), OPTIONS) for part in ((q, contact), turned)
    )
    np.testing.assert_allclose(made, again, rtol=0.02)


def test_who_stands_on_at_the_end_is_seen_alike():
    """Motions of a pool are held at their ends for as long as the longest."""
    q = np.tile(ROBOT.standing, (1, 40, 1))
    q[:, 15:25, 7 + ROBOT.joint_names.index("R_KNEE")] += 1.0
    q, contact = torch_of(q, np.ones((1, 40, 2, 4)))
    longer = torch.arange(80).clamp(max=39)
    seen = largest_torques(BODY, q, contact, OPTIONS)
    held = largest_torques(BODY, q[:, longer], contact[:, longer], OPTIONS)
    np.testing.assert_allclose(held, seen, rtol=2.0 ** (1.0 / OPTIONS.power) - 1.0)
    most = seen.argmax()  # of what was bent for a while
    np.testing.assert_allclose(held[0, most], seen[0, most], rtol=0.01)


def test_it_has_half_of_the_say_and_is_not_climbed(make_predictor, predictor):
    q, contact = sways()
    network = make_predictor(0, torch.float64)
    both = Ensemble([predictor, network])
    told = network.foresee(q, contact)
    apart = predictor.foresee(q, contact)
    assert abs(logit(told.fall_probability) - logit(apart)).max() > 0.05
    half = expit(0.5 * (logit(told.fall_probability) + logit(apart)))
    made = both.foresee(q, contact)
    np.testing.assert_allclose(made.fall_probability, half, atol=1e-12)
    np.testing.assert_array_equal(made.A_q, told.A_q)
    for mine, its in zip(both.judge(q, contact), network.judge(q, contact), strict=True):
        np.testing.assert_array_equal(mine, its)
    with pytest.raises(ConfigError, match="beside the torques"):
        Ensemble([predictor])


def test_it_learns_whose_legs_are_strained(tmp_path, write_executions):
    """Who falls in this data set crouches; what it learns holds for commands it has not seen."""
    knees = [7 + ROBOT.joint_names.index(f"{side}_KNEE") for side in ("L", "R")]

    def crouch(row, _):
        q = np.array(row["raw_q"]).reshape(-1, 30)
        q[20:60, knees] += (0.9 if row["fell"] else 0.1) + 0.3 * np.sin(row["episode"])
        row["raw_q"] = q

    folder = write_executions(tmp_path / "data", crouch, train=60, validation=20, test=20)
    options = TrainTorquesOptions(data=folder, out=tmp_path / "first", epochs=60)
    epochs = []
    path = train_torques(options, lambda done, total: epochs.append((done, total)))
    assert epochs[-1] == (60, 60)
    loaded = load_torques(path, ROBOT)
    unseen = read_motions(folder, ("test",))["test"]
    told = foreseen(loaded, unseen)
    assert auroc(told, np.array([one.fell for one in unseen])) > 0.95
    again = train_torques(options.model_copy(update={"out": tmp_path / "second"}))
    assert again.read_bytes() == path.read_bytes()
    _, header = checkpoint.load(path, checkpoint.TORQUES)
    assert header["data"]["motions_learned"] == 60
    with pytest.raises(ConfigError, match="no weights of a performance predictor"):
        checkpoint.load(path, checkpoint.PREDICTOR)

    lucky = write_executions(tmp_path / "lucky", falls=0.0, train=4, validation=4)
    with pytest.raises(ResultError, match=r"of 4 undisturbed motions .* 'train' all end alike"):
        train_torques(TrainTorquesOptions(data=lucky, out=tmp_path / "third"))


def test_the_packaged_ones_know_more_than_chance():
    """Sways are safe for them, and to bend the knee of the one leg to stand on is not."""
    loaded = load_ensemble(("ppn_3s", "leg_torques"), ROBOT)
    (torques,) = (one for one in loaded.members if isinstance(one, TorquePredictor))
    assert len(loaded.headers) == 2
    assert loaded.headers[1]["data"]["motions_learned"] > 1000
    q, contact = sways()
    assert (torques.foresee(q, contact) < 0.02).all()
    q[:, 15:, 7 + ROBOT.joint_names.index("R_KNEE")] += 1.5
    contact[:, 15:, 0] = 0.0
    assert (torques.foresee(q, contact)[:2] > 0.5).all()
