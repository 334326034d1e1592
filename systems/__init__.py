"""One thin LeafSystem per stage: ports and state, no maths."""

if __name__ != "robomirror_drake.systems":
    raise ImportError(
        "import this package as robomirror_drake.systems: under its short name "
        "every class in it would exist twice"
    )
