"""From candidate references to the one that the robot takes: choose, and change what none can do.

The command's own motion, the first candidate, is kept where it is safe. Else the safe candidate
of the best quality is chosen, of those that do what the command means; where none is safe by a
margin, the own motion and the likeliest ones are changed until they are
(:mod:`robomirror_drake.optimization.adaptation.adapt`), and of those that are safe in the eyes
of all who foresee, not of those alone who were climbed, the one nearest to its command is taken.
Where nothing is safe, it is the safest of all.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

from scipy.special import logit

from robomirror_drake.adaptation.options import AdaptationOptions
from robomirror_drake.adaptation.ranking import rank
from robomirror_drake.exceptions import InputError
from robomirror_drake.goals import Goals, Satisfaction, make_goals, measure
from robomirror_drake.goals.margins import margins
from robomirror_drake.messages import Array, BoolArray, QualityPrediction, Ranking, RobotReference
from robomirror_drake.motion.text import parse
from robomirror_drake.optimization.adaptation.adapt import Adapted, Goal, adapt
from robomirror_drake.optimization.adaptation.problem import fall_aim
from robomirror_drake.ppn.ensemble import Ensemble
from robomirror_drake.ppn.predictor import Judged, Predictor, sampled, whole
from robomirror_drake.robot import Robot


@dataclass(frozen=True, eq=False)
class Adaptation:
    """What was made of a command, and why.

    Attributes:
        reference: What the robot takes; kinematic.
        how: ``kept``, ``selected``, ``optimised``; ``unsafe`` where nothing safe was found,
            and the safest is taken, optimised or not.
        candidate: From which candidate it comes.
        risk_before: P(fall) of the command's own motion, as predicted.
        risk: P(fall) of what is taken.
        ranking: Of the candidates that were looked at: all, or the first alone.
        goals: What the command means; None where it has no words.
        satisfaction: How well what is taken does that, as a reference.
        changed: Of what was optimised, why and how; None where nothing was.
        reason: A sentence.
    """

    reference: RobotReference
    how: Literal["kept", "selected", "optimised", "unsafe"]
    candidate: int
    risk_before: float
    risk: float
    ranking: Ranking
    goals: Goals | None
    satisfaction: Satisfaction | None
    changed: Adapted | None
    reason: str


class WholeMotionJudge:
    """A predictor as the optimiser's judge of whole motions."""

    def __init__(self, predictor: Predictor | Ensemble, every: float) -> None:
        self._predictor, self._every = predictor, every

    def judge(self, q: Array, contact: BoolArray, history: object = None) -> Judged:
        """Of motions (n, N, 30), (n, N, 2, 4), of a robot that stands where they begin."""
        if history is not None:
            raise InputError("whole motions are judged from rest; give no history")
        return self._predictor.judge(q, contact, every=self._every)


def foresee(
    predictor: Predictor | Ensemble, references: Sequence[RobotReference], every: float
) -> QualityPrediction:
    """What becomes of whole references from rest: risk and errors over all of their windows.

    Shorter ones are held at their end for as long as the longest.
    """
    count = max(len(reference.time) for reference in references)
    q, contact = sampled(references, whole(count, predictor.options.rate))
    return predictor.foresee(q, contact, every=every)


def adapt_command(
    robot: Robot,
    command: str,
    references: Sequence[RobotReference],
    predictor: Predictor | Ensemble,
    options: AdaptationOptions | None = None,
) -> Adaptation:
    """Chooses among candidates, or changes them, so that the robot can do what it was told.

    Args:
        robot: The robot, which stands as each candidate begins.
        command: The words; the goal is not looked at where they are not understood.
        references: Kinematic references of the candidates, the command's own motion first.
        predictor: What foresees falls.
        options: Which method, thresholds and weights.

    Raises:
        InputError: There is no candidate.
    """
    options = options or AdaptationOptions()
    optimiser = options.optimiser.model_copy(update={"safe": options.ranking.t_safe})
    options = options.model_copy(update={"optimiser": optimiser})
    if not references:
        raise InputError(f"{command!r} has no candidate that the robot can follow")
    goals = goals_of(robot, command, references[0])
    pool = "selection" in options.method
    looked = references if pool else references[:1]
    foreseen = foresee(predictor, looked, options.every)
    satisfactions = None if goals is None else [measure(robot, goals, r.q) for r in looked]
    ranking = rank([r.residuals for r in looked], foreseen, satisfactions, options.ranking)
    risk = foreseen.fall_probability

    def took(how: Literal["kept", "selected", "unsafe"], i: int, reason: str) -> Adaptation:
        done = None if satisfactions is None else satisfactions[i]
        return Adaptation(
            looked[i], how, i, float(risk[0]), float(risk[i]), ranking, goals, done, None, reason
        )

    if options.method == "none" or ranking.safe[0]:
        return took("kept", 0, f"the command's own motion is kept: P(fall) {risk[0]:.1%}")
    best = next((int(i) for i in ranking.order if _suits(i, ranking, satisfactions)), None)
    sure = best is not None and logit(risk[best]) <= fall_aim(options.optimiser)
    found = None
    if "optimisation" in options.method and not sure:
        found = _optimised(robot, goals, looked, ranking, satisfactions, predictor, options)

    def changed(
        how: Literal["optimised", "unsafe"], i: int, made: Adapted, told: str
    ) -> Adaptation:
        done = None if goals is None else measure(robot, goals, made.reference.q)
        return Adaptation(
            made.reference, how, i, float(risk[0]), made.risk, ranking, goals, done, made, told
        )

    if found is not None and found[1].safe:
        return changed("optimised", *found, found[1].explanation.sentence)
    if best is not None:
        return took("selected", best, f"candidate {best} instead of 0: {ranking.reasons[best]}")
    i = int(ranking.best)
    if found is not None and found[1].risk < risk[i]:
        sentence = found[1].explanation.sentence
        return changed("unsafe", *found, f"nothing safe was found; the safest: {sentence}")
    return took("unsafe", i, f"nothing safe was found; {ranking.reasons[i]}")


def _suits(i: int, ranking: Ranking, satisfactions: Sequence[Satisfaction] | None) -> bool:
    """Whether a candidate is safe and does what the command means."""
    return bool(ranking.safe[i]) and _does(i, satisfactions)


def _does(i: int, satisfactions: Sequence[Satisfaction] | None) -> bool:
    """Whether a candidate does what the command means, as far as that is known."""
    return satisfactions is None or satisfactions[i].done


def goals_of(robot: Robot, command: str, own: RobotReference) -> Goals | None:
    """What a command means, with its own motion; None where its words are not understood."""
    try:
        return make_goals(robot, parse(command), own.q)
    except InputError:
        return None


def _optimised(
    robot: Robot,
    goals: Goals | None,
    references: Sequence[RobotReference],
    ranking: Ranking,
    satisfactions: Sequence[Satisfaction] | None,
    predictor: Predictor | Ensemble,
    options: AdaptationOptions,
) -> tuple[int, Adapted] | None:
    """The least changed safe version of the own motion and the likeliest candidates.

    First come those that do what the command means, which is hard to change into them. An
    optimiser takes for safe what fools who was climbed: here those have their say, too, who were
    not. Where they take none for safe, it is the safest; None where the optimiser found nothing.
    """
    others = sorted((int(i) for i in ranking.order if i), key=lambda i: not _does(i, satisfactions))
    likely = [0, *others][: options.optimised]
    kept = () if goals is None else margins(robot, goals, predictor.options.rate)
    made = adapt(
        robot,
        [references[i] for i in likely],
        WholeMotionJudge(predictor, options.every),
        [Goal(name, function) for name, function in kept],
        options.optimiser,
    )
    limit, told = 1.0 - options.ranking.t_safe, []
    for i, changed in zip(likely, made, strict=True):
        if changed.safe and (goals is None or measure(robot, goals, changed.reference.q).done):
            # By itself, since it would be held at its end for as long as a longer one beside it.
            foreseen = foresee(predictor, [changed.reference], options.every)
            before, after = float(1.0 - ranking.scores[i, 2]), float(foreseen.fall_probability[0])
            explanation = replace(changed.explanation, risk_before=before, risk_after=after)
            told.append(
                (i, changed._replace(risk=after, safe=after <= limit, explanation=explanation))
            )
    safe = [found for found in told if found[1].safe]
    if safe:
        return min(safe, key=lambda found: found[1].explanation.deviation)
    return min(told, key=lambda found: found[1].risk, default=None)
