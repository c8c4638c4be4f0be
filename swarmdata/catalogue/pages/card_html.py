"""A card's Markdown as HTML: the few constructs that cards have, everything else as plain text."""

import re
from collections.abc import Callable, Iterator

from swarmdata.catalogue.elements import Html, element, join, table

_FRONT_MATTER = re.compile(r"\A---\n.*?\n---\n", re.DOTALL)
_HEADING = re.compile(r"(#{1,6}) (.*)")
_RULE_ROW = re.compile(r"\|[\s:|-]+\|")
_CELL_BORDER = re.compile(r"(?<!\\)\|")
_INLINE = re.compile(
    r"`(?P<code>[^`]+)`|\*\*(?P<strong>[^*]+)\*\*|!\[(?P<picture>[^\]]*)\]\([^)]*\)"
    r"|\[(?P<text>[^\]]+)\]\((?P<target>https://[^)\s]+)\)"
)
_ENTITIES = {"&gt;": ">", "&lt;": "<", "&amp;": "&", "\\|": "|", "\\_": "_", "\\*": "*"}
"""What cards write where Markdown would read a mark."""

Lines = list[str]


def card_html(text: str) -> Html:
    """Returns a card without its front matter and title, with headings one level deeper."""
    lines = _FRONT_MATTER.sub("", text).splitlines()
    return join(*_blocks(lines))


def _blocks(lines: Lines) -> Iterator[Html]:
    """Yields the blocks of a text."""
    k = 0
    while k < len(lines):
        line, first = lines[k], k
        if line.startswith("```"):
            k = _until(lines, k + 1, lambda each: each.startswith("```"))
            yield element("pre", element("code", "\n".join(lines[first + 1 : k])), tabindex="0")
            k += 1
        elif found := _HEADING.fullmatch(line):
            if len(found[1]) > 1:
                yield element(f"h{min(6, len(found[1]) + 1)}", _inline(found[2]))
            k += 1
        elif line.startswith("|"):
            k = _until(lines, k, lambda each: not each.startswith("|"))
            yield _table(lines[first:k])
        elif line.startswith(("- ", "* ")):
            k = _until(lines, k, lambda each: not each.startswith(("- ", "* ", "  ")))
            yield _list(lines[first:k])
        elif line.startswith("    "):
            k = _until(lines, k, lambda each: not each.startswith("    "))
            code = "\n".join(each[4:] for each in lines[first:k])
            yield element("pre", element("code", code), tabindex="0")
        elif not line.strip():
            k += 1
        else:
            k = _until(lines, k + 1, _ends_paragraph)
            words = " ".join(each.removeprefix("> ") for each in lines[first:k])
            yield element("p", _inline(words))


def _until(lines: Lines, first: int, is_end: Callable[[str], bool]) -> int:
    """Returns the first line from `first` on that is an end, or the number of lines."""
    return next((k for k in range(first, len(lines)) if is_end(lines[k])), len(lines))


def _ends_paragraph(line: str) -> bool:
    return not line.strip() or line.startswith(("|", "```", "#", "- ", "* "))


def _table(lines: Lines) -> Html:
    head, *rest = (_cells(line) for line in lines if not _RULE_ROW.fullmatch(line.strip()))
    return table(tuple(head), [tuple(row) for row in rest])


def _cells(line: str) -> list[Html]:
    inner = line.strip().removeprefix("|").removesuffix("|")
    return [_inline(cell.strip()) for cell in _CELL_BORDER.split(inner)]


def _list(lines: Lines) -> Html:
    items: list[str] = []
    for line in lines:
        if line.startswith(("- ", "* ")):
            items.append(line[2:])
        else:
            items[-1] += " " + line.strip()
    return element("ul", *(element("li", _inline(item)) for item in items))


def _inline(text: str) -> Html:
    """Returns text with code, bold words and links; pictures are left out."""
    parts: list[object] = []
    last = 0
    for found in _INLINE.finditer(text):
        parts.append(_plain(text[last : found.start()]))
        last = found.end()
        if found["code"] is not None:
            parts.append(element("code", _plain(found["code"])))
        elif found["strong"] is not None:
            parts.append(element("strong", _plain(found["strong"])))
        elif found["text"] is not None:
            parts.append(element("a", _plain(found["text"]), href=found["target"], rel="noopener"))
    return join(*parts, _plain(text[last:]))


def _plain(text: str) -> str:
    for mark, meaning in _ENTITIES.items():
        text = text.replace(mark, meaning)
    return text
