"""RoboMirror on Drake: a humanoid that judges a commanded motion before it moves."""

__version__ = "0.1.0"
