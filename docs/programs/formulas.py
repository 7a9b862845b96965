"""Formulas as SVG by matplotlib: no network, no TeX."""

from __future__ import annotations

import base64
import html
import io
from typing import Any

from docutils import nodes
from matplotlib import rc_context
from matplotlib.figure import Figure

_POINTS = 13.0


def setup(app: Any) -> dict[str, bool]:
    """The renderer ``mathtext`` for ``html_math_renderer``."""
    app.add_html_math_renderer("mathtext", (_visit_inline, None), (_visit_display, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def _image(formula: str) -> str:
    text = formula.strip().replace("\n", " ")
    figure = Figure()
    figure.text(0, 0, f"${text}$", fontsize=_POINTS)
    drawn = io.BytesIO()
    with rc_context({"mathtext.fontset": "cm", "svg.hashsalt": "ocisac"}):
        figure.savefig(
            drawn, format="svg", bbox_inches="tight", pad_inches=0.03, transparent=True, metadata={"Date": None}
        )
    encoded = base64.b64encode(drawn.getvalue()).decode()
    return f'<img class="formula" src="data:image/svg+xml;base64,{encoded}" alt="{html.escape(formula)}">'


def _visit_inline(writer: Any, node: nodes.math) -> None:
    writer.body.append(_image(node.astext()))
    raise nodes.SkipNode


def _visit_display(writer: Any, node: nodes.math_block) -> None:
    writer.body.append(f"<p>{_image(node.astext())}</p>")
    raise nodes.SkipNode
