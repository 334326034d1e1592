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
from robomirror_drake.motion.plain_pickle import is_pickled_npy
from robomirror_drake.motion.results_files import load_result
from robomirror_drake.motion.smpl import load_smpl


def _load_npy(path: Path | str) -> HumanMotion:
    """HumanML3D's arrays of numbers, or MDM's pickled results."""
    return load_result(path) if is_pickled_npy(Path(path)) else load_humanml(path)


LOADERS: dict[str, Callable[[Path | str], HumanMotion]] = {
    ".bvh": load_bvh,
    ".npy": _load_npy,
    ".txt": load_mocap,
    ".json": load_mocap,
    ".npz": load_smpl,
    ".pkl": load_result,
}
"""The loader of each file suffix."""


def load_motion(path: Path | str) -> HumanMotion:
    """Load a motion file of any kind in :data:`LOADERS`.

    BVH; HumanML3D ``.npy``, or MDM's with one motion; DeepMimic JSON (``.txt``, ``.json``); AMASS
    ``.npz``, where the body model is at hand; MotionLCM's ``.pkl``, of which nothing is executed.

    Raises:
        MotionFileError: The file is missing, of an unknown kind, malformed, empty, too
            short, or not a human's; the message names the file and the fault.
    """
    path = existing_file(path)
    suffix = path.suffix.lower()
    if suffix not in LOADERS:
        raise MotionFileError(
            path,
            f"no loader for {suffix or 'files without suffix'}; known are {', '.join(LOADERS)}",
        )
    return LOADERS[suffix](path)
