"""The frame of every page: head, security policy, navigation, and the scripts it starts.

The policy allows one inline script by its hash, which loads the others (`strict-dynamic`): nothing
is fetched from elsewhere, no injected script runs, and pages work from `file://`.
"""

import base64
import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from swarmdata import __version__
from swarmdata.catalogue.elements import Html, element, join

ICON = (
    "data:image/svg+xml,%3Csvg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 16 16'%3E"
    "%3Ccircle cx='5' cy='6' r='3' fill='%230072B2'/%3E%3Ccircle cx='11' cy='10' r='3' "
    "fill='%23E69F00'/%3E%3C/svg%3E"
)
"""Two robots; without an icon, browsers ask the host for one."""

NAVIGATION = (("index.html", "Datasets"), ("results.html", "Results"))
"""Pages that every page links to, from the top of the catalogue."""


@dataclass(frozen=True)
class Page:
    """The content of one page."""

    path: str  # of its file, from the top of the catalogue
    title: str  # in the window's title
    body: Html  # the main part
    scripts: Sequence[str] = ()  # names in `assets`, in the order in which they run
    data: Any = None  # for the scripts, JSON

    @property
    def root(self) -> str:
        """The relative path to the top of the catalogue."""
        return "../" * self.path.count("/")


def render(page: Page) -> str:
    """Returns the HTML document of a page."""
    start = _start_script(page)
    head = join(
        element("meta", charset="utf-8"),
        element("meta", http_equiv="Content-Security-Policy", content=security_policy(start)),
        element("meta", name="viewport", content="width=device-width, initial-scale=1"),
        element("meta", name="color-scheme", content="light dark"),
        element("meta", name="referrer", content="no-referrer"),
        element("title", page.title),
        element("link", rel="icon", href=ICON),
        element("link", rel="stylesheet", href=f"{page.root}assets/catalogue.css"),
    )
    data = element("script", _in_script(page.data), type="application/json", id="page-data")
    body = join(
        element("a", "Skip to content", href="#content", class_="skip"),
        _header(page),
        element("main", page.body, id="content", tabindex="-1"),
        element("footer", f"Made by swarmdata {__version__}. Works offline, without a server."),
        data if page.data is not None else "",
        element("script", Html(start)),
    )
    document = element("html", element("head", head), element("body", body), lang="en")
    return f"<!doctype html>\n{document}\n"


def security_policy(script: str) -> str:
    """Returns the policy of a page with one inline script."""
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    return (
        f"default-src 'none'; script-src 'sha256-{digest}' 'strict-dynamic'; "
        "style-src 'self' file:; img-src data:; base-uri 'none'; form-action 'none'"
    )


def _start_script(page: Page) -> str:
    """Loads the scripts of a page in their order."""
    files = json.dumps([f"{page.root}assets/{name}" for name in page.scripts])
    return (
        f"for(const file of {files}){{const script=document.createElement('script');"
        "script.src=file;script.async=false;document.head.append(script)}"
    )


def _in_script(data: Any) -> Html:
    """Returns JSON that cannot end the script element it is in."""
    text = json.dumps(data, separators=(",", ":"), allow_nan=False)
    return Html(text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026"))


def _header(page: Page) -> Html:
    links = [
        element(
            "a", name, href=page.root + path, aria_current="page" if path == page.path else None
        )
        for path, name in NAVIGATION
    ]
    brand = element("a", "swarmdata", href=f"{page.root}index.html", class_="brand")
    return element("header", brand, element("nav", *links, aria_label="Catalogue"))
