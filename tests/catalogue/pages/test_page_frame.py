"""The frame: its security policy matches its script, and data cannot leave their element."""

import base64
import hashlib
import json
import re

import pytest

from swarmdata.catalogue.elements import Html, element, join, table
from swarmdata.catalogue.pages.page_frame import Page, render

EVIL = "</script><script>alert(1)</script>\"'<!--&"


def test_the_policy_allows_the_one_inline_script_by_its_hash() -> None:
    text = render(Page("datasets/a.html", "A", Html("<p>A</p>"), ("core.js",), {}))

    (script,) = re.findall(r"<script>(.*?)</script>", text)
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    (policy,) = re.findall(r'Content-Security-Policy" content="([^"]*)"', text)
    assert "default-src &#x27;none&#x27;" in policy
    assert f"script-src &#x27;sha256-{digest}&#x27; &#x27;strict-dynamic&#x27;" in policy
    assert "unsafe" not in policy
    assert '"../assets/core.js"' in script


def test_data_stay_in_their_element() -> None:
    text = render(Page("index.html", EVIL, Html(""), (), {"text": EVIL}))

    assert text.count("<script") == 2
    (data,) = re.findall(r'id="page-data">(.*?)</script>', text)
    assert json.loads(data) == {"text": EVIL}
    assert "<title>&lt;/script&gt;" in text


@pytest.mark.parametrize("path", ["index.html", "datasets/a.html"])
def test_links_to_other_pages_are_relative(path: str) -> None:
    text = render(Page(path, "A", Html("")))

    root = "../" if "/" in path else ""
    assert f'href="{root}results.html"' in text
    assert "http://" not in text.replace("http://www.w3.org/2000/svg", "")


def test_text_and_attributes_are_escaped() -> None:
    found = element("a", EVIL, href=EVIL, hidden=True, id=None, data_x=1, class_="b")

    assert "<script" not in found
    assert found.endswith("</a>")
    assert ' hidden data-x="1" class="b">' in found
    assert join("<", Html("<br>")) == "&lt;<br>"
    assert '<th scope="row">&lt;' in table(("a",), [("<",)])


def test_elements_without_content_have_no_end() -> None:
    assert element("br") == "<br>"
    assert element("svg", viewBox="0 0 1 1") == '<svg viewBox="0 0 1 1"></svg>'
