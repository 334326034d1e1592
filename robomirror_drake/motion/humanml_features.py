"""HumanML3D's 263 features of a motion, from joint positions and back.

Source: C. Guo et al., "Generating Diverse and Natural 3D Human Motions from Text", CVPR 2022,
and the conventions of its published data. At 20 frames per second, y up, for each frame t but
the last one:

==========  =====================================================================
columns     meaning
==========  =====================================================================
0           half the root's yaw from t to t + 1 [rad]
1:3         step of the pelvis to t + 1, x and z, in the root's axes at t + 1 [m]
3           height of the pelvis [m]
4:67        21 joints over the pelvis' place on the floor, in the root's axes [m]
67:193      21 rotations to the bone from its parent, first two columns each
193:259     22 steps of the joints to t + 1, in the root's axes at t [m]
259:263     whether left ankle, left toe, right ankle, right toe stand still
==========  =====================================================================

The root's axes are y up and z along a heading smoothed over a second; they start in line with
the world's. Rotations are those that turn each bone from its direction in the rest pose the
shortest way, so twist about a bone is not told.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from scipy.ndimage import gaussian_filter1d

from robomirror_drake.messages import Array
from robomirror_drake.motion.bones import along_bones, bones
from robomirror_drake.motion.skeleton import INDEX

FPS = 20.0
"""Frame rate of every HumanML3D motion [1/s]."""
FEATURES = 263
"""Numbers a frame."""
STILL = 0.002
"""A foot that moves less in a frame than the root of this stands still [m²]."""

ROOT, HEIGHT, JOINTS = slice(0, 3), 3, slice(4, 67)
ROTATIONS, STEPS, CONTACTS = slice(67, 193), slice(193, 259), slice(259, 263)

_SMOOTHING = 20.0  # of the heading, standard deviation [frames]
_FEET = [INDEX[f"{side}_{end}"] for side in ("left", "right") for end in ("ankle", "foot")]
_CHAINS = ((0, 2, 5, 8, 11), (0, 1, 4, 7, 10), (0, 3, 6, 9, 12, 15),
           (9, 14, 17, 19, 21), (9, 13, 16, 18, 20))  # fmt: skip
_X, _Y, _Z = np.eye(3)
_REST = np.array(
    [0 * _X, _X, -_X, _Y, -_Y, -_Y, _Y, -_Y, -_Y, _Y, _Z, _Z, _Y, _X, -_X, _Z] + 6 * [-_Y]
)
"""(22, 3) direction of the bone that ends at each joint in the rest pose."""


def to_features(positions: Array) -> Array:
    """Features (T − 1, 263) of joint positions (T, 22, 3) [m], y up, at 20 fps.

    The motion is put on the floor, its start over the origin and facing +z, as
    :func:`canonical` does.
    """
    positions = canonical(positions)
    root = _root_quaternions(positions)
    turn = _multiply(root[1:], _inverse(root[:-1]))
    # Either sign means the same turn; the short way round is the one with cos ≥ 0. (The published
    # code leaves the sign, which flips one step of a motion that turns past half a circle.)
    half_yaw = np.arcsin(np.clip(turn[:, 2] * np.sign(turn[:, 0] + 1e-12), -1.0, 1.0))
    step = np.diff(positions, axis=0)
    pelvis_step = _rotate(root[1:], step[:, 0])
    local = _rotate(root[:, None], positions - positions[:, :1] * [1.0, 0.0, 1.0])
    still = (step[:, _FEET] ** 2).sum(axis=-1) < STILL
    frames = len(step)
    return np.concatenate(
        [
            half_yaw[:, None],
            pelvis_step[:, [0, 2]],
            positions[:-1, 0, 1:2],
            local[:-1, 1:].reshape(frames, 63),
            _rotations(positions, root)[:-1].reshape(frames, 126),
            _rotate(root[:-1, None], step).reshape(frames, 66),
            still.astype(float),
        ],
        axis=1,
    )


def canonical(positions: Array) -> Array:
    """Positions (T, 22, 3), y up, with the lowest joint at 0, starting at x = z = 0 facing +z."""
    first = positions[0]
    across = first[2] - first[1] + first[17] - first[16]
    forward = np.cross([0.0, 1.0, 0.0], across)
    origin = first[0] * [1.0, 0.0, 1.0] + [0.0, positions[..., 1].min(), 0.0]
    return _rotate(_between(forward, _Z), positions - origin)


def recover_from_ric(features: Array) -> Array:
    """(…, T, 22, 3) joint positions [m], y up, of features (…, T, 263), by their joint columns.

    The root's yaw θ (stored as half angle per frame) and ground velocity, the latter in
    the root's frame, are summed up from 0; the joints are given in that frame as well.
    With q = (cos θ, 0, sin θ, 0) taking world to root, vectors return by q⁻¹.
    """
    half_yaw, root = _recover_root(features)
    joints = features[..., JOINTS].reshape(*features.shape[:-1], 21, 3)
    joints = _yaw_back(joints, half_yaw[..., None])
    joints = joints + (root * [1.0, 0.0, 1.0])[..., None, :]
    return np.concatenate([root[..., None, :], joints], axis=-2)


def recover_from_rotations(features: Array, lengths: Array) -> Array:
    """(…, T, 22, 3) joint positions [m], y up, of features (…, T, 263), by their rotations.

    Args:
        features: Features, not normalised.
        lengths: (21,) length of the bone that ends at each joint but the pelvis [m].
    """
    half_yaw, root = _recover_root(features)
    local = _matrices(features[..., ROTATIONS].reshape(*features.shape[:-1], 21, 6))
    cos, sin = np.cos(2.0 * half_yaw), np.sin(2.0 * half_yaw)
    zero, one = np.zeros_like(cos), np.ones_like(cos)
    heading = np.stack([cos, zero, sin, zero, one, zero, -sin, zero, cos], axis=-1)
    heading = heading.reshape(*cos.shape, 3, 3)
    joints = np.empty((*features.shape[:-1], 22, 3))
    joints[..., 0, :] = root
    for chain in _CHAINS:  # each starts from the root's rotation, also those of the arms
        turn = heading
        for parent, joint in pairwise(chain):
            turn = turn @ local[..., joint - 1, :, :]
            bone = turn @ (lengths[joint - 1] * _REST[joint])
            joints[..., joint, :] = joints[..., parent, :] + bone
    return joints


def with_lengths(positions: Array, lengths: Array) -> Array:
    """Positions (…, T, 22, 3) with bones of other lengths (21,) [m] in the same directions.

    The pelvis' path is scaled by the ratio of the right leg's length, as HumanML3D does to
    bring everybody to one skeleton.
    """
    vectors = bones(positions)
    old = np.linalg.norm(vectors, axis=-1, keepdims=True)
    leg = [INDEX["right_knee"] - 1, INDEX["right_ankle"] - 1]
    scale = lengths[leg].sum() / old[..., :1, leg, 0].sum(axis=-1)
    return along_bones(positions[..., 0, :] * scale[..., None], vectors / old * lengths[:, None])


def _recover_root(features: Array) -> tuple[Array, Array]:
    """Half the yaw (…, T) [rad] and the pelvis (…, T, 3) [m] from the first four columns."""
    half_yaw = np.zeros(features.shape[:-1])
    half_yaw[..., 1:] = np.cumsum(features[..., :-1, 0], axis=-1)
    step = np.zeros((*features.shape[:-1], 3))
    step[..., 1:, [0, 2]] = features[..., :-1, 1:3]
    root = np.cumsum(_yaw_back(step, half_yaw), axis=-2)
    root[..., 1] = features[..., HEIGHT]
    return half_yaw, root


def _yaw_back(vectors: Array, half_yaw: Array) -> Array:
    """Vectors (…, 3) rotated by −2·half_yaw about y."""
    c, s = np.cos(2.0 * half_yaw), np.sin(2.0 * half_yaw)
    x, y, z = np.moveaxis(vectors, -1, 0)
    return np.stack([c * x - s * z, y, s * x + c * z], axis=-1)


def _root_quaternions(positions: Array) -> Array:
    """(T, 4) quaternions wxyz that take the world's axes to the root's.

    The published data take the heading from the shoulders *less* the hips (two names are
    exchanged in its code), and the first frame's to be 0; both are kept, to agree with it.
    """
    shoulders = positions[:, INDEX["right_shoulder"]] - positions[:, INDEX["left_shoulder"]]
    hips = positions[:, INDEX["right_hip"]] - positions[:, INDEX["left_hip"]]
    across = shoulders - hips
    across = across / np.linalg.norm(across, axis=1, keepdims=True)
    forward = gaussian_filter1d(np.cross(_Y, across), _SMOOTHING, axis=0, mode="nearest")
    root = _between(forward, _Z)
    root[0] = [1.0, 0.0, 0.0, 0.0]
    return root


def _rotations(positions: Array, root: Array) -> Array:
    """(T, 21, 6) rotation to each bone from the one before it in its chain, two columns each."""
    columns = np.empty((len(positions), 21, 6))
    for chain in _CHAINS:
        turn = root
        for parent, joint in pairwise(chain):
            to_bone = _between(_REST[joint], positions[:, joint] - positions[:, parent])
            local = _multiply(_inverse(turn), to_bone)
            columns[:, joint - 1] = np.concatenate([_rotate(local, _X), _rotate(local, _Y)], axis=1)
            turn = to_bone
    return columns


def _matrices(columns: Array) -> Array:
    """(…, 3, 3) rotations from two columns (…, 6), made orthonormal.

    Y. Zhou et al., "On the Continuity of Rotation Representations", CVPR 2019.
    """
    x = columns[..., :3] / np.linalg.norm(columns[..., :3], axis=-1, keepdims=True)
    z = np.cross(x, columns[..., 3:])
    z = z / np.linalg.norm(z, axis=-1, keepdims=True)
    return np.stack([x, np.cross(z, x), z], axis=-1)


def _between(start: Array, end: Array) -> Array:
    """(…, 4) shortest rotations, wxyz, from the directions start to end (…, 3).

    Opposite directions have no shortest way: there the turn is about z, or x where that is
    the direction itself.
    """
    start, end = np.broadcast_arrays(start, end)
    size = np.linalg.norm(start, axis=-1) * np.linalg.norm(end, axis=-1)
    real = size + (start * end).sum(axis=-1)
    axis = np.cross(start, end)
    opposite = real < 1e-12 * size
    aside = np.cross(start, np.where(np.abs(start[..., :1]) + np.abs(start[..., 1:2]) > 0, _Z, _X))
    axis = np.where(opposite[..., None], np.cross(start, aside), axis)
    quaternion = np.concatenate([np.where(opposite, 0.0, real)[..., None], axis], axis=-1)
    unit: Array = quaternion / np.linalg.norm(quaternion, axis=-1, keepdims=True)
    return unit


def _inverse(quaternion: Array) -> Array:
    inverse: Array = quaternion * [1.0, -1.0, -1.0, -1.0]
    return inverse


def _multiply(a: Array, b: Array) -> Array:
    """(…, 4) Hamilton product, wxyz: first b, then a."""
    real = a[..., :1] * b[..., :1] - (a[..., 1:] * b[..., 1:]).sum(axis=-1, keepdims=True)
    imaginary = a[..., :1] * b[..., 1:] + b[..., :1] * a[..., 1:] + np.cross(a[..., 1:], b[..., 1:])
    return np.concatenate([real, imaginary], axis=-1)


def _rotate(quaternion: Array, vectors: Array) -> Array:
    """Vectors (…, 3) rotated by unit quaternions (…, 4), wxyz."""
    axis = quaternion[..., 1:]
    twice = 2.0 * np.cross(axis, vectors)
    rotated: Array = vectors + quaternion[..., :1] * twice + np.cross(axis, twice)
    return rotated
