"""A card's Markdown as HTML: CommonMark with tables, from which nothing becomes HTML of its own."""

import re
from collections.abc import Sequence
from typing import Any

from markdown_it import MarkdownIt
from markdown_it.renderer import RendererHTML
from markdown_it.token import Token

from swarmdata.catalogue.elements import Html, element

_FRONT_MATTER = re.compile(r"\A---\n.*?\n---\n", re.DOTALL)

_LINK = re.compile(r"https?://|(?![\w+.-]*:)")
"""Targets of links: web addresses, and what is relative."""


def card_html(text: str) -> Html:
    """Returns a card without its front matter, title and picture, headings one level deeper."""
    parser = _Parser("commonmark", {"html": False}, renderer_cls=_Renderer).enable("table")
    tokens = parser.parse(_FRONT_MATTER.sub("", text))
    left_out: set[int] = set()
    for k in range(1, len(tokens)):
        if _is_left_out(tokens[k - 1], tokens[k]):
            left_out |= {k - 1, k, k + 1}
    shown = [token for k, token in enumerate(tokens) if k not in left_out]
    return Html(parser.renderer.render(shown, parser.options, {}))


def _is_left_out(before: Token, token: Token) -> bool:
    """Whether this is the text of the title, or of a paragraph with nothing but a picture."""
    if before.type == "paragraph_open":
        return all(each.type == "image" for each in token.children or ())
    return before.type == "heading_open" and before.tag == "h1"


class _Parser(MarkdownIt):
    def validateLink(self, url: str) -> bool:  # noqa: N802  (the library's name)
        return _LINK.match(url) is not None


class _Renderer(RendererHTML):
    """What pages have besides: scrolled code and tables, and a first cell that names its row."""

    def heading_open(self, tokens: Sequence[Token], idx: int, *rest: Any) -> str:
        tokens[idx].tag = f"h{min(6, int(tokens[idx].tag[1:]) + 1)}"
        return self.renderToken(tokens, idx, *rest)

    heading_close = heading_open

    def fence(self, tokens: Sequence[Token], idx: int, *_: Any) -> str:
        return element("pre", element("code", tokens[idx].content.rstrip("\n")), tabindex="0")

    def code_block(self, *parts: Any) -> str:
        return self.fence(*parts)

    def image(self, *_: Any) -> str:
        return ""

    def link_open(self, tokens: Sequence[Token], idx: int, *rest: Any) -> str:
        tokens[idx].attrSet("rel", "noopener")
        return self.renderToken(tokens, idx, *rest)

    def table_open(self, *_: Any) -> str:
        return '<div class="wide"><table>'

    def table_close(self, *_: Any) -> str:
        return "</table></div>"

    def th_open(self, *_: Any) -> str:  # without its style, which pages do not allow
        return '<th scope="col">'

    def td_open(self, tokens: Sequence[Token], idx: int, *_: Any) -> str:
        return '<th scope="row">' if tokens[idx - 1].type == "tr_open" else "<td>"

    def td_close(self, tokens: Sequence[Token], idx: int, *_: Any) -> str:
        return "</th>" if tokens[idx - 3].type == "tr_open" else "</td>"
