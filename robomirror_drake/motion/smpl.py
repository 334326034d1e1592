"""AMASS and other SMPL parameters as joint positions, by a body model that the user has.

The body models (SMPL+H, SMPL-X) may not be passed on; where the user has their ``.npz`` files,
the environment variable :data:`MODELS` names their folder. A joint's place needs the rest shape
and the rotations only, so no mesh is computed and no other package is needed.

Sources: M. Loper et al., "SMPL: A Skinned Multi-Person Linear Model", ACM TOG 2015, eq. 2-4 and
10; N. Mahmood et al., "AMASS", ICCV 2019.
"""

from __future__ import annotations

import os
from functools import cache
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from robomirror_drake.exceptions import MotionFileError
from robomirror_drake.messages import Array, HumanMotion
from robomirror_drake.motion.checks import checked_motion, existing_file
from robomirror_drake.motion.skeleton import PARENTS

MODELS = "ROBOMIRROR_BODY_MODELS"
"""Environment variable: folder with ``smplh/GENDER/model.npz`` or ``SMPLX_GENDER.npz``."""

_PLACES = ("smplh/{g}/model.npz", "{g}/model.npz", "smplh/SMPLH_{G}.npz", "SMPLH_{G}.npz",
           "smplx/SMPLX_{G}.npz", "SMPLX_{G}.npz")  # fmt: skip
_RATES = ("mocap_framerate", "mocap_frame_rate", "fps")


def load_smpl(path: Path | str) -> HumanMotion:
    """A motion of AMASS: ``poses`` (T, ≥ 66), ``trans`` (T, 3), ``betas``, the frame rate; z up.

    Raises:
        MotionFileError: Missing, damaged, of another kind, or no body model is at hand.
    """
    path = existing_file(path)
    try:
        with np.load(path, allow_pickle=False) as data:
            content = {name: data[name] for name in data.files if data[name].dtype.kind in "fiuUS"}
    except Exception as error:  # numpy and zipfile raise half a dozen types
        raise MotionFileError(path, f"not a .npz archive of arrays: {error}") from error
    rate = next((content[name] for name in _RATES if name in content), None)
    if not {"poses", "trans"} <= content.keys() or rate is None:
        raise MotionFileError(
            path, "holds no poses, trans and frame rate: not a motion of AMASS; it has "
            + ", ".join(sorted(content)),
        )  # fmt: skip
    poses, trans = content["poses"].astype(float), content["trans"].astype(float)
    if poses.ndim != 2 or poses.shape[1] < 66 or trans.shape != (len(poses), 3):
        raise MotionFileError(path, f"poses {poses.shape} and trans {trans.shape} do not fit")
    if not (np.isfinite(poses).all() and np.isfinite(trans).all()):
        raise MotionFileError(path, "holds NaN or infinity")
    gender = str(content.get("gender", "neutral")).strip("b'\"").lower()
    betas = np.atleast_1d(content.get("betas", np.zeros(0)).astype(float))
    rest = _rest_joints(path, _model_file(path, gender), betas)
    positions = pose_joints(rest, poses[:, :66].reshape(-1, 22, 3)) + trans[:, None]
    return checked_motion(path, positions, float(rate.ravel()[0]))


def pose_joints(rest: Array, poses: Array) -> Array:
    """(T, 22, 3) joints of a rest shape (22, 3) turned by rotation vectors (T, 22, 3)."""
    frames = len(poses)
    local = Rotation.from_rotvec(poses.reshape(-1, 3)).as_matrix().reshape(frames, 22, 3, 3)
    turn = np.empty_like(local)
    joints = np.empty((frames, 22, 3))
    turn[:, 0], joints[:, 0] = local[:, 0], rest[0]
    for j in range(1, 22):
        parent = PARENTS[j]
        turn[:, j] = turn[:, parent] @ local[:, j]
        joints[:, j] = joints[:, parent] + turn[:, parent] @ (rest[j] - rest[parent])
    return joints


def _model_file(path: Path, gender: str) -> Path:
    folder = os.environ.get(MODELS, "")
    if folder:
        for g in (gender, "neutral"):
            for place in _PLACES:
                file = Path(folder) / place.format(g=g, G=g.upper())
                if file.is_file():
                    return file
    where = f"none for {gender!r} is in {folder}" if folder else "none is at hand"
    raise MotionFileError(
        path, "holds SMPL body parameters, and these need the SMPL+H or SMPL-X body model, which "
        f"may not be shipped: {where}. Get it from its authors and let {MODELS} name the folder "
        f"with {_PLACES[0].format(g='neutral')} or {_PLACES[-1].format(G='NEUTRAL')}; or compute "
        "the first 22 joints at 20 fps, y up, and save them as a (frames, 22, 3) .npy",
    )  # fmt: skip


def _rest_joints(path: Path, model: Path, betas: Array) -> Array:
    """(22, 3) joints [m] of the shape that the betas say, at rest."""
    try:
        template, shapes, regressor = _model(model)
        used = min(len(betas), shapes.shape[2])
        joints: Array = regressor @ (template + shapes[:, :, :used] @ betas[:used])
    except Exception as error:
        raise MotionFileError(path, f"the body model {model} cannot be used: {error}") from error
    return joints


@cache
def _model(file: Path) -> tuple[Array, Array, Array]:
    """Template (V, 3), shape directions (V, 3, B) and joint regressor (22, V)."""
    with np.load(file, allow_pickle=False) as data:
        template, shapes, regressor = (
            np.asarray(data[name], dtype=float)
            for name in ("v_template", "shapedirs", "J_regressor")
        )
    return template, shapes, regressor[:22]
