"""Which commands a study takes: those whose own motion falls, and some whose own does not.

Groups have equal shares. A group that has too few gives the rest of its share to the others; a
group in which nothing has fallen for long is given up, for each execution takes its time.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from itertools import chain, zip_longest
from typing import NamedTuple

from robomirror_drake.dataset.prompts import Prompt

Order = Mapping[str, Sequence[int]]
"""Commands of each group, in the order in which they are looked at."""

_AT_ONCE = 2  # commands of a group to screen at least, where some are missing


class Choice(NamedTuple):
    """What is known of which commands to take.

    Attributes:
        failing: Commands whose own motion falls, group by turns.
        succeeding: Likewise those whose own motion does not.
        more: Commands to be screened next; none when the choice is made.
    """

    failing: tuple[int, ...]
    succeeding: tuple[int, ...]
    more: tuple[int, ...]


def order_of(prompts: Sequence[Prompt], seed: int) -> Order:
    """Commands of each group in an order of the seed's choice.

    Where a command stands depends on its text and the seed, not on the other commands.
    """

    def place(number: int) -> bytes:
        return hashlib.sha256(f"{seed} {prompts[number].text}".encode()).digest()

    groups: dict[str, list[int]] = {}
    for number, prompt in enumerate(prompts):
        groups.setdefault(prompt.group, []).append(number)
    return {name: sorted(own, key=place) for name, own in sorted(groups.items())}


def choose(
    order: Order, states: Mapping[int, str], failing: int, succeeding: int, patience: int
) -> Choice:
    """Takes the first commands of each group that end as wanted.

    Args:
        order: From :func:`order_of`.
        states: Of the commands that have been screened: ``fell``, ``stood`` or what else.
        failing: How many are wanted that fell.
        succeeding: How many that stood.
        patience: Executions without a fall after which a group is given up.
    """
    taken: dict[str, tuple[int, ...]] = {}
    missing = dict.fromkeys(order, 0)
    for state, wanted in (("fell", failing), ("stood", succeeding)):
        found, there = {}, {}
        for name, own in order.items():
            seen = _seen(own, states)
            hopeful = _until_given_up(seen, states, patience) if state == "fell" else seen
            found[name] = [n for n in hopeful if states[n] == state]
            over = len(hopeful) < len(seen) or len(seen) == len(own)
            there[name] = len(found[name]) if over else wanted
        share = _shares(wanted, there)
        turns = zip_longest(*(own[: share[name]] for name, own in found.items()))
        taken[state] = tuple(n for n in chain.from_iterable(turns) if n is not None)
        for name in order:
            if (lacking := share[name] - len(found[name])) > 0:
                missing[name] = max(missing[name], lacking, _AT_ONCE)
    more = chain.from_iterable(_unseen(own, states)[: missing[name]] for name, own in order.items())
    return Choice(taken["fell"], taken["stood"], tuple(more))


def _until_given_up(seen: Sequence[int], states: Mapping[int, str], patience: int) -> Sequence[int]:
    """Those before the execution with which patience ends; all where it does not."""
    upright = 0
    for place, number in enumerate(seen):
        state = states[number]
        upright = 0 if state == "fell" else upright + (state == "stood")
        if upright > patience:
            return seen[:place]
    return seen


def _seen(own: Sequence[int], states: Mapping[int, str]) -> Sequence[int]:
    """Those up to the first that has not been screened."""
    return own[: next((i for i, n in enumerate(own) if n not in states), len(own))]


def _unseen(own: Sequence[int], states: Mapping[int, str]) -> list[int]:
    return [n for n in own if n not in states]


def _shares(wanted: int, there: Mapping[str, int]) -> dict[str, int]:
    """As equal shares as can be of what is wanted, where each can give only so many."""
    share = dict.fromkeys(there, 0)
    while sum(share.values()) < min(wanted, sum(there.values())):
        open_ = [name for name in there if share[name] < there[name]]
        least = min(open_, key=lambda name: share[name])
        share[least] += 1
    return share
