"""What retargeting, planning and the search for a fall's cause read off a contact schedule."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from robomirror_drake.messages import BoolArray


def runs(active: BoolArray) -> list[tuple[int, int]]:
    """Maximal runs [start, stop) of True in ``active`` (T,)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], active.astype(np.int8), [0]])))
    return [(int(a), int(b)) for a, b in edges.reshape(-1, 2)]


def picked_samples(contact: BoolArray, stride: int) -> npt.NDArray[np.int64]:
    """Indices of every ``stride``-th sample, the last, and both sides of each switch.

    Args:
        contact: (T, 2, 4) schedule.
        stride: Samples from one to the next where nothing switches.
    """
    switch = (contact[1:] != contact[:-1]).any(axis=(1, 2))
    picked = np.zeros(len(contact), dtype=np.bool_)
    picked[::stride] = picked[-1] = True
    picked[1:] |= switch
    picked[:-1] |= switch
    return np.flatnonzero(picked)
