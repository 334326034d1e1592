"""Any motion file as a HumanMotion, by its suffix.

Whatever the file's own conventions, the motion is in metres, z up, HumanML3D joint
order, and on the floor as :mod:`~robomirror_drake.motion.ground` defines it: in flat
stance the toe joint is 2 cm and the ankle 8 cm above z = 0. The heading is that of
the recording: +x where a y-up file faces +z (or, in DeepMimic's files, +x).
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from robomirror_drake.exceptions import MotionFileError
from robomirror_drake.messages import HumanMotion
from robomirror_drake.motion.bvh import load_bvh
from robomirror_drake.motion.checks import existing_file
from robomirror_drake.motion.humanml import load_humanml
from robomirror_drake.motion.mocap import load_mocap

LOADERS: dict[str, Callable[[Path | str], HumanMotion]] = {
    ".bvh": load_bvh,
    ".npy": load_humanml,
    ".txt": load_mocap,
    ".json": load_mocap,
}
"""The loader of each file suffix."""

_SMPL_SUFFIXES = (".npz", ".pkl")
_SMPL_FAULT = (
    "holds SMPL body parameters (as AMASS does), and the SMPL body model that turns them into "
    "joint positions is not free to ship and is missing here; with the model, compute the "
    "first 22 joints at 20 fps, y up, and save them as a (frames, 22, 3) .npy"
)


def load_motion(path: Path | str) -> HumanMotion:
    """Load a motion file: BVH, HumanML3D ``.npy`` or DeepMimic JSON (``.txt``, ``.json``).

    Raises:
        MotionFileError: The file is missing, of an unknown kind, malformed, empty, too
            short, or not a human's; the message names the file and the fault.
    """
    path = existing_file(path)
    suffix = path.suffix.lower()
    if suffix in _SMPL_SUFFIXES:
        raise MotionFileError(path, _SMPL_FAULT)
    if suffix not in LOADERS:
        raise MotionFileError(
            path,
            f"no loader for {suffix or 'files without suffix'}; known are {', '.join(LOADERS)}",
        )
    return LOADERS[suffix](path)
