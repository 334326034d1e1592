"""What :mod:`~robomirror_drake.measure.measure` found, as tables at the prompt and as a page."""

from __future__ import annotations

from typing import Any

from rich.console import Console
from rich.table import Table

from robomirror_drake.measure.measure import SHEET_CANDIDATES, Pool
from robomirror_drake.motion import plausibility
from robomirror_drake.report.motion_strips import strip
from robomirror_drake.report.page import render

QUALITY = {
    "skating_frames_percent": ("frames with a skating foot", "%"),
    "stance_drift_mm": ("drift of a bearing foot", "mm"),
    "penetration_mm": ("deepest under the floor", "mm"),
    "bone_drift_percent": ("change of bone lengths", "%"),
    "beyond_range_frames_percent": ("frames with a joint beyond its range", "%"),
    "beyond_range_deg": ("farthest beyond a range", "°"),
    "arm_in_body_mm": ("arm in trunk, head or thigh", "mm"),
    "jerk_m_s3": ("jerk, root mean square", "m/s³"),
    "peak_acceleration_m_s2": ("largest acceleration of a joint", "m/s²"),
}
"""Words and unit of each figure of :func:`~robomirror_drake.motion.plausibility.figures`."""

VARIETY = {
    "diversity": "diversity",
    "multimodality": "multimodality",
    "r_precision_top1": "R-precision, top 1",
    "r_precision_top2": "R-precision, top 2",
    "r_precision_top3": "R-precision, top 3",
}
"""Words of each figure that is measured in the evaluator's space."""


def print_measures(figures: dict[str, Any], console: Console) -> None:
    """Prints intent, variety and time, and how human the motions are."""
    intent, sources = figures["intent"], figures["sources"]
    console.print(
        f"intent: {intent['right']} of {intent['sentences']} sentences understood"
        f" ({100 * intent['accuracy']:.1f} %), {intent['refused']} refused"
    )
    table = Table("", *sources)
    for name, words in VARIETY.items():
        table.add_row(words, *(spread(source.get(name)) for source in sources.values()))
    for words, row in time_rows(figures):
        table.add_row(words, *row)
    console.print(table)
    columns = quality_columns(figures)
    table = Table("median (95 %, worst)", *columns, "unit")
    for name, (words, unit) in QUALITY.items():
        table.add_row(words, *(_trio(column[name]) for column in columns.values()), unit)
    console.print(table)


def quality_columns(figures: dict[str, Any]) -> dict[str, dict[str, Any]]:
    """The quality of the recorded clips and of each source, by name."""
    found = {"clips": figures["clips"]["quality"]}
    return found | {name: source["quality"] for name, source in figures["sources"].items()}


def time_rows(figures: dict[str, Any]) -> list[tuple[str, list[str]]]:
    """What is said of the time, for each source."""
    times = [source["time"] for source in figures["sources"].values()]
    return [
        ("sentences refused", [str(len(s["refused"])) for s in figures["sources"].values()]),
        (
            f"time of {times[0]['candidates']} candidates, median (95 %) [ms]",
            [f"{1e3 * t['median_s']:.0f} ({1e3 * t['p95_s']:.0f})" for t in times],
        ),
        ("of which a core worked, median [ms]", [f"{1e3 * t['core_median_s']:.0f}" for t in times]),
        ("their mean duration [s]", [f"{t['mean_duration_s']:.1f}" for t in times]),
    ]


def spread(value: dict[str, float] | None) -> str:
    """A mean and half its 95 % interval."""
    return "·" if value is None else f"{value['mean']:.3f} ± {value['ci95']:.3f}"


def number(value: float) -> str:
    """Three digits; what is only rounding is 0."""
    return f"{value:.3g}" if abs(value) > 1e-6 else "0"


def _trio(value: dict[str, float]) -> str:
    return f"{number(value['median'])} ({number(value['p95'])}, {number(value['worst'])})"


def render_measures(figures: dict[str, Any], sheets: dict[str, list[Pool]]) -> str:
    """The page: every figure, and the contact sheet of each source."""
    sections = [
        {
            "source": source,
            "rows": [
                {
                    "text": pool.text,
                    "strips": [
                        (strip(motion), _caption(plausibility.figures(motion), motion.duration))
                        for motion in pool.motions[:SHEET_CANDIDATES]
                    ],
                }
                for pool in pools
            ],
        }
        for source, pools in sheets.items()
    ]
    return render(
        "measures.html",
        figures=figures,
        sections=sections,
        quality=QUALITY,
        quality_columns=quality_columns(figures),
        variety=VARIETY,
        time_rows=time_rows(figures),
        spread=spread,
        number=number,
        tolerance=plausibility.TOLERANCE,
        rate=plausibility.RATE,
    )


def _caption(found: dict[str, float], duration: float) -> str:
    """What a strip cannot show well, where there is something to say."""
    words = [f"{duration:.1f} s", f"peak {found['peak_acceleration_m_s2']:.0f} m/s²"]
    for key, least, text in (
        ("stance_drift_mm", 5.0, "drift {:.0f} mm"),
        ("penetration_mm", 5.0, "under floor {:.0f} mm"),
        ("arm_in_body_mm", 10.0, "arm in body {:.0f} mm"),
        ("beyond_range_deg", 5.0, "beyond range {:.0f}°"),
    ):
        if found[key] >= least:
            words.append(text.format(found[key]))
    return ", ".join(words)
