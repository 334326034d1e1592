"""What the falls of sampled candidates go with: the style that was drawn for them, or nothing."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.stats import fisher_exact

from robomirror_drake.motion.composer.cue import Style
from robomirror_drake.survey.survey import Row

MORE = ("tempo", "amplitude", "step_length")
"""Parameters that ask more of a robot the greater they are."""


class Split(NamedTuple):
    """Sampled candidates on both sides of a parameter's nominal value.

    Attributes:
        parameter: Of the style.
        below: (upright, executions) where it is at most the nominal one.
        above: The same where it is greater.
        p: Probability of a difference at least as great by chance (Fisher's exact test).
    """

    parameter: str
    below: tuple[int, int]
    above: tuple[int, int]
    p: float


def sampled(rows: Sequence[Row]) -> list[Row]:
    """Executions of candidates whose style was drawn."""
    return [row for row in rows if row.candidate and row.style is not None and row.fell is not None]


def splits(rows: Sequence[Row]) -> list[Split]:
    """For each parameter of the style, how the sampled candidates ended on both sides of it."""
    drawn = [(row, row.style or {}) for row in sampled(rows)]
    found = []
    for parameter, nominal in vars(Style()).items():
        sides = [
            [row.fell is False for row, style in drawn if (style[parameter] > nominal) is more]
            for more in (False, True)
        ]
        (low, below), (high, above) = ((sum(side), len(side)) for side in sides)
        p = float(fisher_exact(np.array([[low, below - low], [high, above - high]])).pvalue)
        found.append(Split(parameter, (low, below), (high, above), p))
    return found


def gentle(row: Row) -> bool:
    """Whether a style asks no more of the robot than the nominal one."""
    nominal = vars(Style())
    return row.style is not None and all(row.style[name] <= nominal[name] for name in MORE)


def unexplained(rows: Sequence[Row]) -> list[Row]:
    """Falls of gentle candidates of actions whose nominal motion stands: not due to their style."""
    stands = {row.action for row in rows if row.candidate == 0 and row.fell is False}
    return [row for row in sampled(rows) if row.fell and row.action in stands and gentle(row)]
