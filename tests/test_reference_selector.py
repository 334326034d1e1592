from __future__ import annotations

import numpy as np
import pytest
from pydrake.common.value import Value

from robomirror_drake.exceptions import PortError
from robomirror_drake.messages import RobotReference
from robomirror_drake.systems.reference_selector import ReferenceSelector


def reference(source: str) -> RobotReference:
    q = np.zeros((3, 30))
    q[:, 0] = 1.0
    zeros = np.zeros((3, 29))
    contact = np.ones((3, 2, 4), dtype=bool)
    return RobotReference(np.arange(3) / 60, q, zeros, zeros, contact, source=source)


def select(value: object) -> RobotReference:
    selector = ReferenceSelector()
    context = selector.CreateDefaultContext()
    selector.GetInputPort("references").FixValue(context, Value[object](value))
    return selector.GetOutputPort("reference").Eval(context)


def test_takes_the_first_and_keeps_it_whole():
    first = reference("nominal")
    assert select((first, reference("other"))) == first


@pytest.mark.parametrize("value", [(), None, ("walk",), [reference("list")]])
def test_refuses_what_is_not_a_tuple_of_references(value):
    with pytest.raises(PortError):
        select(value)
