"""Why a command was not saved."""

from __future__ import annotations

from typing import Final

from robomirror_drake.study.options import CLOSED, OPTIMISING
from robomirror_drake.study.records import Row

TRANSITION: Final = 1.0
"""After a hand-over a fall is taken to come from it for so long [s]."""


def cause(row: Row) -> str:
    """Why a method did not save a command whose own motion falls.

    ====================== ====================================================================
    ``not_adapted``        nothing was tried: ``none``
    ``no_survivor``        a choice was made, and no candidate of the pool survives
    ``survivor_misranked`` a candidate survives, but the method took something else
    ``optimiser_failed``   nothing to choose, and the optimiser found nothing safe, or what it
                           found fell
    ``fall_unforeseen``    the command's own motion was taken for safe, by a method that looks
                           at no other
    ``transition_failed``  the motion was changed on the way, and fell right after that
    ``stopped``            the robot came to a halt: it did not fall, and did not go on
    ``failed``             a stage failed
    ``unknown``            a choice was made, and not all of the pool has been simulated
    ====================== ====================================================================

    Args:
        row: Of the results, with ``survivor`` where the method looks at a pool.
    """
    method, how, survivor = row["method"], row.get("how"), row.get("survivor")
    if row.get("failure"):
        return "failed"
    if method == "none":
        return "not_adapted"
    if method in CLOSED:
        if row.get("stopped") and row.get("fall_time_s") is None:
            return "stopped"
        since = row.get("since_s")
        if since is not None and since <= TRANSITION:
            return "transition_failed"
    if row.get("pool") is None:
        return "fall_unforeseen" if how == "kept" else "optimiser_failed"
    if survivor:
        return "survivor_misranked"
    if how == "optimised" or (how == "unsafe" and method in OPTIMISING):
        return "optimiser_failed"
    return "unknown" if survivor is None else "no_survivor"
