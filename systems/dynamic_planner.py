"""Makes the chosen reference dynamically consistent."""

from __future__ import annotations

from pydrake.common.value import Value
from pydrake.systems.framework import Context, LeafSystem

from robomirror_drake.messages import RobotReference
from robomirror_drake.optimization.planning.plan import PlanOptions, plan_dynamics
from robomirror_drake.robot import Robot
from robomirror_drake.systems.ports import expect


class DynamicPlanner(LeafSystem):
    """Plans a motion that physics can follow, as near to the reference as it gets.

    The output is cached: a reference is planned once, when the plan is first asked for.

    Input port:
        reference: ``RobotReference``, abstract.

    Output port:
        plan: ``RobotReference`` with foot forces, abstract.
    """

    def __init__(self, robot: Robot, options: PlanOptions | None = None) -> None:
        """A planner for ``robot``."""
        super().__init__()
        self._robot = robot
        self._options = options or PlanOptions()
        self._reference = self.DeclareAbstractInputPort("reference", Value[object]())
        self.DeclareAbstractOutputPort(
            "plan",
            lambda: Value[object](),
            self._calc_plan,
            prerequisites_of_calc={self._reference.ticket()},
        )

    def _calc_plan(self, context: Context, output: Value[object]) -> None:
        reference = expect(self._reference.Eval(context), RobotReference, "reference")
        output.set_value(plan_dynamics(self._robot, reference, self._options))
