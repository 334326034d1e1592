"""Arrays, texts and numbers out of a pickle, without executing what else it might hold.

Pickles can name any function of any module to be called on loading. This reader knows the few
that rebuild a NumPy array, and refuses a file that names another one: the way that Python's own
manual gives under "Restricting Globals".
"""

from __future__ import annotations

import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.lib import format as npy

from robomirror_drake.exceptions import MotionFileError

_ARRAY: Any = np.ndarray(0).__reduce__()[0]
_SCALAR: Any = np.float64(0.0).__reduce__()[0]
_ALLOWED: dict[tuple[str, str], Callable[..., Any]] = {
    ("numpy", "ndarray"): np.ndarray,
    ("numpy", "dtype"): np.dtype,
    **{
        (f"numpy.{core}.multiarray", name): function
        for core in ("core", "_core")
        for name, function in (("_reconstruct", _ARRAY), ("scalar", _SCALAR))
    },
}


class _Reader(pickle.Unpickler):
    def find_class(self, module: str, name: str) -> Any:
        try:
            return _ALLOWED[module, name]
        except KeyError:
            raise pickle.UnpicklingError(f"it calls {module}.{name}") from None


def read_pickle(path: Path) -> Any:
    """What a pickle of plain values and arrays holds; also one inside a ``.npy``.

    Raises:
        MotionFileError: It cannot be read, is damaged, or would call something.
    """
    try:
        with path.open("rb") as file:
            if path.suffix.lower() == ".npy":
                _header(file)
            return _Reader(file).load()
    except pickle.UnpicklingError as error:
        raise MotionFileError(
            path, f"a pickle that is not read, because it may run code ({error}); if you trust "
            "it, load it yourself and save its joint positions (frames, 22, 3) as .npy",
        ) from error  # fmt: skip
    except Exception as error:  # a damaged pickle raises almost any type
        raise MotionFileError(path, f"a damaged pickle: {error}") from error


def is_pickled_npy(path: Path) -> bool:
    """Whether a ``.npy`` holds Python objects rather than numbers."""
    try:
        with path.open("rb") as file:
            return _header(file).hasobject
    except Exception:  # damaged, in one of many ways: for who reads it to say how
        return False


def _header(file: BinaryIO) -> np.dtype[Any]:
    """Reads over the header of a ``.npy``: what its elements are."""
    version = npy.read_magic(file)
    read = npy.read_array_header_1_0 if version == (1, 0) else npy.read_array_header_2_0
    dtype: np.dtype[Any] = read(file)[2]
    return dtype
