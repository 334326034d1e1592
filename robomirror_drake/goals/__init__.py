"""What a command means, as predicates that can be measured on any motion of the robot.

:func:`make_goals` reads them from the command and its own motion, :func:`measure` evaluates
them on a reference, a plan, or what was executed; :func:`margins` gives them with gradients.
"""

from robomirror_drake.goals.margins import margins
from robomirror_drake.goals.predicates import Goals, Predicate, make_goals
from robomirror_drake.goals.satisfaction import Measured, Satisfaction, measure

__all__ = [
    "Goals",
    "Measured",
    "Predicate",
    "Satisfaction",
    "make_goals",
    "margins",
    "measure",
]
