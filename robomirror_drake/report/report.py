"""A result as one HTML page that needs no network."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from markupsafe import Markup

from robomirror_drake.messages import Execution, Outcome
from robomirror_drake.outcome import HEIGHT_DROP, LEAN, TOUCH_FORCE, lean_angle, until_fall
from robomirror_drake.report import figures
from robomirror_drake.report.adaptation import adaptation_values
from robomirror_drake.report.page import plot, render
from robomirror_drake.results import Result
from robomirror_drake.robot import Robot

FALLS = {
    "contact": "a link other than the feet touched the ground",
    "height": f"the pelvis sank more than {HEIGHT_DROP:.2f} m below the reference",
    "tilt": f"the trunk leaned more than {np.rad2deg(LEAN):.0f}° away from the reference",
}

CAUSES = {
    "reference_infeasible": "What went wrong first is the reference",
    "torque_saturated": "What went wrong first is a joint without torque to spare",
    "friction_lost": "What went wrong first is the grip of a foot",
    "contact_mismatch": "What went wrong first is a contact that was not as planned",
    "controller": "The controller lost the balance",
}


class Metric(NamedTuple):
    """A row of the table of metrics; ``limit`` is empty where there is none."""

    name: str
    symbol: Markup
    value: str
    unit: str
    limit: str = ""


def render_report(result: Result, robot: Robot) -> str:
    """The report of a result as HTML, with plotly.js and all data inside.

    Args:
        result: What to report.
        robot: The robot that executed it.
    """
    execution, outcome = result.execution, result.outcome
    names = robot.joint_names
    limbs = []
    for number, limb in enumerate(figures.limbs(robot.model)):
        columns = [names.index(name) for name in limb]
        angles = figures.joint_angles(limb, columns, execution, outcome)
        torques = figures.joint_torques(limb, columns, execution, outcome, robot.effort_limits)
        limbs.append(
            {
                "label": f"{limb[0]} … {limb[-1]}" if len(limb) > 1 else limb[0],
                "angles": plot(angles, f"angles-{number}"),
                "torques": plot(torques, f"torques-{number}"),
            }
        )
    return render(
        "report.html",
        result=result,
        verdicts=_verdicts(result),
        adaptation=adaptation_values(result, robot),
        metrics=_metrics(result, robot),
        path=plot(figures.root_path(execution, outcome), "path"),
        root=plot(figures.root_errors(execution, outcome), "root"),
        contacts=plot(figures.contacts(execution, result.reference, outcome), "contacts"),
        limbs=limbs,
        style_names=sorted({name for c in result.candidates for name in c.style}),
    )


HALTED = " It was brought to a halt on the way, and did not do what it was told."


class Verdict(NamedTuple):
    """How an execution went; ``which`` is empty where there is only one."""

    which: str
    fell: bool
    sentence: str
    cause: str


def _verdicts(result: Result) -> list[Verdict]:
    """What would have happened, if that was tried, and what happened."""
    ends = [("", result.outcome, result.execution)]
    if result.adaptation is not None and result.adaptation.original is not None:
        original = result.adaptation.original
        ends = [
            ("As commanded", original.outcome, original.execution),
            ("As adapted", result.outcome, result.execution),
        ]
    halted = result.adaptation is not None and result.adaptation.record.stopped
    return [
        Verdict(
            which,
            end.fell,
            outcome_sentence(end, done) + (HALTED if halted and end is result.outcome else ""),
            cause_sentence(end),
        )
        for which, end, done in ends
    ]


def outcome_sentence(outcome: Outcome, execution: Execution) -> str:
    """How it went, in one sentence."""
    if outcome.fall_time_s is not None:
        how = FALLS[outcome.fall_cause or ""]
        return f"The robot fell after {outcome.fall_time_s:.2f} s: {how}."
    hold = outcome.duration_s - execution.motion_end
    if execution.motion_end > 0.0 and hold > 0.0:
        return (
            f"The robot carried out the motion ({execution.motion_end:.1f} s), "
            f"then stood for {hold:.1f} s, and did not fall."
        )
    return f"The robot carried out the motion ({outcome.duration_s:.1f} s) and did not fall."


def cause_sentence(outcome: Outcome) -> str:
    """Why it fell, in one sentence; empty where that is not known."""
    if outcome.cause is None:
        return ""
    return f"{CAUSES[outcome.cause]}: {outcome.cause_evidence}."


def _metrics(result: Result, robot: Robot) -> list[Metric]:
    outcome, execution = result.outcome, until_fall(result.execution)
    drop = np.max(execution.q_ref[:, 6] - execution.q[:, 6])
    lean = np.max(lean_angle(execution.q[:, :4], execution.q_ref[:, :4]))
    share = np.max(np.abs(execution.torque) / robot.effort_limits)
    return [
        Metric("joint position error", _sub("A", "q"), f"{outcome.A_q:.3g}", "rad"),
        Metric("joint velocity error", _sub("A", "q̇"), f"{outcome.A_qd:.3g}", "rad/s"),
        Metric("joint acceleration error", _sub("A", "q̈"), f"{outcome.A_qdd:.3g}", "rad/s²"),
        Metric("root position error", _sub("A", "p"), f"{outcome.A_p:.3g}", "m"),
        Metric("root orientation error", _sub("A", "θ"), f"{outcome.A_theta:.3g}", "rad"),
        Metric("largest drop below the reference", Markup(), f"{drop:.3f}", "m", f"{HEIGHT_DROP}"),
        Metric(
            *("largest lean from the reference", Markup(), f"{np.rad2deg(lean):.1f}", "°"),
            limit=f"{np.rad2deg(LEAN):.0f}",
        ),
        Metric(
            *("ground force on other links", Markup(), f"{execution.other_force.max():.1f}", "N"),
            limit=f"{TOUCH_FORCE:g}",
        ),
        Metric("largest torque, share of its limit", Markup(), f"{100 * share:.0f}", "%", "100"),
        Metric(
            *("torque samples at the limit", Markup(), f"{100 * outcome.torque_saturation:.2f}"),
            unit="%",
        ),
        Metric(
            *("friction margin, least", Markup()),
            *(f"{round(outcome.friction_margin, 3) + 0.0:.3f}", "1", "0"),
        ),
        Metric("work of the joints", Markup(), f"{outcome.energy_j:.0f}", "J"),
    ]


def _sub(symbol: str, index: str) -> Markup:
    return Markup("{}<sub>{}</sub>").format(symbol, index)
