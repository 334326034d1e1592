"""Robots, scenarios, prompts, trained weights and licence notes, as package data."""

if __name__ != "robomirror_drake.assets":
    raise ImportError(
        "import this package as robomirror_drake.assets: under its short name "
        "every class in it would exist twice"
    )
