"""``python -m robomirror_drake`` is the ``robomirror`` command."""

from robomirror_drake.cli import main

main()
