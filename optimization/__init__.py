"""Pure functions and solvers, arrays in and out; no LeafSystem lives here."""

if __name__ != "robomirror_drake.optimization":
    raise ImportError(
        "import this package as robomirror_drake.optimization: under its short name "
        "every class in it would exist twice"
    )
