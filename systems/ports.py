"""Abstract ports carry any Python value: here it is seen whether it is the right one."""

from __future__ import annotations

from typing import TypeVar

from robomirror_drake.exceptions import PortError

T = TypeVar("T")


def expect(value: object, kind: type[T], port: str) -> T:
    """The value of a port, which has to be a ``kind``.

    Raises:
        PortError: It is something else.
    """
    if not isinstance(value, kind):
        raise PortError(port, f"a {type(value).__name__}", f"a {kind.__name__}")
    return value


def expect_some(values: object, kind: type[T], port: str) -> tuple[T, ...]:
    """The value of a port, which has to be a tuple of one ``kind`` or more.

    Raises:
        PortError: It is something else, or empty.
    """
    wanted = f"a non-empty tuple of {kind.__name__}"
    if not isinstance(values, tuple) or not values:
        raise PortError(port, f"{values!r:.60}", wanted)
    for value in values:
        if not isinstance(value, kind):
            raise PortError(port, f"a tuple with a {type(value).__name__}", wanted)
    return values
