"""Cards as HTML: the constructs they have, and nothing from them as HTML of its own."""

from importlib.resources import files

import pytest

from swarmdata.catalogue.pages.dataset_page import card_html
from tests.support.pairs import slow

CARD = """---
license: cc-by-4.0
---

# name

Some `code <b>` and **bold** words, [a link](https://example.org/a?b=1&c=2)
on two lines.

| a | b |
| --- | ---: |
| x \\| y | &lt;script&gt; |

- one
- two
  goes on

```python
print("<b>")
```

    swarmdata load

![picture](picture.png)
"""


def test_a_card_has_its_parts() -> None:
    found = card_html(CARD)

    assert "license" not in found
    assert "<h1" not in found
    assert "<code>code &lt;b&gt;</code>" in found
    assert "<strong>bold</strong>" in found
    assert 'href="https://example.org/a?b=1&amp;c=2"' in found
    assert '<th scope="row">x | y</th><td>&lt;script&gt;</td>' in found
    assert "<li>two\ngoes on</li>" in found
    assert "print(&quot;&lt;b&gt;&quot;)" in found
    assert "<code>swarmdata load</code>" in found
    assert "picture" not in found


@pytest.mark.parametrize(
    "text",
    [
        "<script>alert(1)</script>",
        "<img src=x onerror=alert(1)>",
        "[x](javascript:alert(1))",
        '[x](https://a"onmouseover=alert(1))',
        "| <script> |\n| --- |\n| <b onclick=a> |",
        "# <script>\n\n## <script>",
        "```\n<script>\n```",
    ],
)
def test_nothing_becomes_html_of_its_own(text: str) -> None:
    found = card_html(text)

    assert "<script" not in found
    assert "<img" not in found
    assert 'href="javascript' not in found
    assert '"onmouseover' not in found
    assert "<b " not in found


@pytest.mark.parametrize("every", [25, *slow(1)])
def test_published_cards_are_read_to_their_end(every: int) -> None:
    cards = files("swarmdata.cards").joinpath("published").iterdir()
    texts = sorted(
        (file for file in cards if file.name.endswith(".md")), key=lambda file: file.name
    )
    assert texts
    for file in texts[::every]:
        found = card_html(file.read_text(encoding="utf-8"))
        assert "<h3>Rebuild</h3>" in found, file.name
        assert "| ---" not in found, file.name
