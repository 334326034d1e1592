"""Why a command was not saved."""

from __future__ import annotations


def cause(method: str, how: str | None, survivor: bool | None) -> str:
    """Why a method did not save a command whose own motion falls.

    ====================== ====================================================================
    ``not_adapted``        nothing was tried: ``none``
    ``no_survivor``        a choice was made, and no candidate of the pool survives
    ``survivor_misranked`` a candidate survives, but the method took something else
    ``optimiser_failed``   nothing to choose, and the optimiser found nothing safe, or what it
                           found fell
    ``fall_unforeseen``    the command's own motion was taken for safe, by a method that looks
                           at no other
    ``unknown``            a choice was made, and not all of the pool has been simulated
    ====================== ====================================================================

    Args:
        method: Which.
        how: What it did: ``kept``, ``selected``, ``optimised`` or ``unsafe``.
        survivor: Whether a candidate of its pool survives; None where nobody knows.
    """
    if method == "none":
        return "not_adapted"
    if method == "optimisation":
        return "fall_unforeseen" if how == "kept" else "optimiser_failed"
    if survivor:
        return "survivor_misranked"
    optimised = how == "optimised" or (how == "unsafe" and "optimisation" in method)
    if optimised:
        return "optimiser_failed"
    return "unknown" if survivor is None else "no_survivor"
