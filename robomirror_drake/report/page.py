"""HTML pages that need no network: templates, plots, and plotly.js inside."""

from __future__ import annotations

import functools
from typing import Any

import jinja2
import plotly.graph_objects as go
from markupsafe import Markup
from plotly.offline import get_plotlyjs


def render(template: str, **values: Any) -> str:
    """A page from a template of ``assets/templates``; ``plotly_js`` is there for it.

    In a template of Markdown nothing is escaped.
    """
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("robomirror_drake.assets", "templates"),
        autoescape=not template.endswith(".md"),
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template(template).render(plotly_js=_plotly_js(), **values)


def plot(figure: go.Figure, name: str) -> Markup:
    """A figure as a ``div`` of that name."""
    config: dict[str, Any] = {"displayModeBar": False, "responsive": True}
    html = figure.to_html(
        include_plotlyjs=False, full_html=False, div_id=name, config=config, validate=False
    )
    return Markup(html)


@functools.cache
def _plotly_js() -> Markup:
    return Markup(get_plotlyjs())
