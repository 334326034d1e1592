"""From a command to candidate human motions, as a system."""

from __future__ import annotations

from pydrake.common.value import Value
from pydrake.systems.framework import Context, LeafSystem

from robomirror_drake.motion.generate import GeneratorOptions, check_request, generate
from robomirror_drake.systems.ports import expect


class MotionGenerator(LeafSystem):
    """Makes candidate human motions for a command (the paper's f).

    From the composer, the learned generator, ready motions, or all in turn, as the options say;
    each candidate names its source.

    Input port:
        command: the text, a ``Value[object]`` that holds a ``str``.
    Output port:
        candidates: tuple of :class:`HumanMotion`, cached until the command changes.

    The system has no state.
    """

    def __init__(self, n: int = 8, seed: int = 0, options: GeneratorOptions | None = None) -> None:
        """Args and errors are those of :func:`generate`."""
        super().__init__()
        check_request(n, seed)
        self._n = n
        self._seed = seed
        self._options = options or GeneratorOptions()
        self._command = self.DeclareAbstractInputPort("command", Value(object()))
        self.DeclareAbstractOutputPort(
            "candidates",
            alloc=lambda: Value(object()),
            calc=self._calc_candidates,
            prerequisites_of_calc={self._command.ticket()},
        )

    def _calc_candidates(self, context: Context, output: Value[object]) -> None:
        command = expect(self._command.Eval(context), str, "command")
        output.set_value(generate(command, self._n, self._seed, self._options))
