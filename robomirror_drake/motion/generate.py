"""From a command to candidate human motions (the paper's f: text -> H_r)."""

from __future__ import annotations

from dataclasses import asdict, replace

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from robomirror_drake.exceptions import InputError, UnknownCommandError
from robomirror_drake.messages import HumanMotion
from robomirror_drake.motion.composer.compose import clip_of, compose
from robomirror_drake.motion.composer.cue import Style
from robomirror_drake.motion.sources import SourceOptions, ready_or_learned, shares
from robomirror_drake.motion.text import Clause, parse

MAX_CANDIDATES = 256


class GeneratorOptions(BaseModel):
    """How candidates are made."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    fps: float = Field(60.0, ge=20.0, le=240.0, description="Frames per second of the motions.")
    diversity: float = Field(
        1.0, ge=0.0, le=1.0, description="Spread of the style parameters, 0 for none at all."
    )
    vigour: float = Field(
        1.0,
        ge=0.3,
        le=2.5,
        description="Factor on tempo and size of what the composer does, on top of the words.",
    )
    slowest: float = Field(
        0.6,
        gt=0.1,
        le=1.0,
        description="Least tempo of the composer's candidates, by that of the command's own.",
    )
    source: SourceOptions = SourceOptions()


def generate(
    text: str, n: int, seed: int = 0, options: GeneratorOptions | None = None
) -> tuple[HumanMotion, ...]:
    """Candidate human motions for a command: the same text and seed give the same bytes.

    From the composer, candidate 0 is in nominal style; each other one has a style drawn for
    (seed, its index), so it does not depend on how many are asked for. Where several sources
    take turns, one that does not know the command is passed over; files may run out.

    Args:
        text: The command, in English.
        n: How many candidates, 1 to 256.
        seed: Seed of the styles, not negative.
        options: Rate and spread; the defaults where None.

    Raises:
        InputError: The text, n or the seed cannot be used.
        UnknownCommandError: The text names nothing that a source knows.
    """
    check_request(n, seed)
    options = options or GeneratorOptions()
    made: dict[int, HumanMotion] = {}
    unknown: list[UnknownCommandError] = []
    for kind, indices in shares(options.source, n).items():
        try:
            if kind == "composer":
                clauses = parse(text)
                made |= {k: _candidate(text, clauses, k, seed, options) for k in indices}
            else:
                made |= ready_or_learned(kind, text, indices, seed, options.fps, options.source)
        except UnknownCommandError as error:
            unknown.append(error)
    if not made:
        raise unknown[0]
    return tuple(made[k] for k in sorted(made))


def check_request(n: int, seed: int) -> None:
    """Raises InputError where candidates cannot be made in this number or from this seed."""
    if not 1 <= n <= MAX_CANDIDATES:
        raise InputError(f"{n} candidates asked for; give 1 to {MAX_CANDIDATES}")
    if seed < 0:
        raise InputError(f"the seed is {seed}; give a number that is not negative")


def _candidate(
    text: str, clauses: tuple[Clause, ...], index: int, seed: int, options: GeneratorOptions
) -> HumanMotion:
    drawn = draw_style(seed, index, options.diversity, options.slowest)
    style = vigorous(drawn, options.vigour)
    actions = "+".join(_named(clause, style) for clause in clauses)
    return HumanMotion(
        positions=compose(clauses, style, options.fps),
        fps=options.fps,
        text=text,
        source=f"generator:{actions} seed {seed} candidate {index}",
        style=asdict(style),
    )


def _named(clause: Clause, style: Style) -> str:
    """The action, and the recording that it is played from."""
    clip = clip_of(clause, style)
    return clause.action if clip is None else f"{clause.action}(pybullet:{clip})"


def vigorous(style: Style, vigour: float) -> Style:
    """A style with a factor on tempo and size; steps, which are longer and quicker, share it."""
    return replace(
        style,
        tempo=style.tempo * vigour,
        amplitude=style.amplitude * vigour,
        step_length=style.step_length * vigour**0.5,
    )


def draw_style(seed: int, index: int, diversity: float = 1.0, slowest: float = 0.6) -> Style:
    """The style of a candidate: nominal for index 0, else drawn for (seed, index).

    Its tempo is ``slowest`` at least, of the nominal one.
    """
    nominal = Style()
    if index == 0 or diversity == 0.0:
        return nominal
    rng = np.random.default_rng((seed, index))

    def around(value: float, low: float, high: float) -> float:
        drawn = rng.uniform(low, high)
        return float(value + diversity * (drawn - value))

    # Rather gentler than the nominal style: it is what a robot may be in need of.
    return Style(
        tempo=around(nominal.tempo, slowest, 1.22),
        amplitude=around(nominal.amplitude, 0.6, 1.25),
        step_length=around(nominal.step_length, 0.6, 1.15),
        step_width=around(nominal.step_width, 0.18, 0.26),
        # Lower, and a slow foot cannot be told from a standing one by its motion.
        step_height=around(nominal.step_height, 0.065, 0.10),
        arms=around(nominal.arms, 0.4, 1.4),
        mirrored=float(rng.random() < 0.5),
        # A run that hardly bounces is still a run, and bent knees are what weak motors cannot hold.
        spring=around(nominal.spring, 0.2, 1.15),
    )
