"""Sphinx: formulas as MathML, which browsers draw themselves: no script, and nothing that is loaded from elsewhere."""

from typing import Any

from docutils import nodes


def _element(source: str, display: str) -> str:
    from latex2mathml.converter import convert

    # Browsers no longer know the variant "bold"; a style says the same.
    bold = 'mathvariant="normal" style="font-weight: bold"'
    return convert(source, display=display).replace('mathvariant="bold"', bold)


def _inline(self: Any, node: nodes.math) -> None:
    self.body.append(_element(node.astext(), "inline"))
    raise nodes.SkipNode


def _block(self: Any, node: nodes.math_block) -> None:
    self.body.append(f'<div class="formula">{_element(node.astext(), "block")}</div>')
    raise nodes.SkipNode


def setup(app: Any) -> dict[str, bool]:
    """Offer the renderer that conf.py chooses."""
    app.add_html_math_renderer("mathml", (_inline, None), (_block, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
