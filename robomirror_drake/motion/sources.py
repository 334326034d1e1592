"""Where candidates come from: composer, learned generator, ready motions, or all in turn."""

from __future__ import annotations

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

from robomirror_drake.exceptions import InputError
from robomirror_drake.messages import HumanMotion
from robomirror_drake.motion.learned.options import SamplingOptions

Source = Literal["composer", "learned", "files", "mix"]


class SourceOptions(BaseModel):
    """Which source makes the candidates."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    kind: Source = Field("composer", description="composer, learned, files; mix takes them in turn")
    files: str = Field("", description="folder of motions with texts, or a result file")
    learned: SamplingOptions = SamplingOptions()


def shares(options: SourceOptions, n: int) -> dict[Source, list[int]]:
    """Which of n candidates each source makes: source -> their indices.

    Raises:
        InputError: Files are wanted, and none named.
    """
    if options.kind == "files" and not options.files:
        raise InputError("the source is files, and `files` names no folder and no result file")
    if options.kind != "mix":
        return {options.kind: list(range(n))}
    kinds: list[Source] = ["composer", "learned"]
    kinds += ["files"] if options.files else []
    return {kind: list(range(i, n, len(kinds))) for i, kind in enumerate(kinds) if i < n}


def ready_or_learned(
    kind: Source, text: str, indices: list[int], seed: int, fps: float, options: SourceOptions
) -> dict[int, HumanMotion]:
    """Candidates by their index, of the learned generator or of files.

    Raises:
        InputError: The text is none that the source knows, or the source cannot be used.
    """
    if kind == "learned":
        from robomirror_drake.motion.learned.generator import generate_learned

        made = generate_learned(text, indices, seed, fps, options.learned)
        return dict(zip(indices, made, strict=True))
    from robomirror_drake.motion.pool import choose, load_pool

    # The best files first, whichever numbers the candidates have.
    ready = choose(text, list(range(len(indices))), load_pool(options.files), fps)
    return dict(zip(indices, ready, strict=False))
