"""A page in a real Chromium, what it complained about, and what it asked for."""

import shutil
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

TIMEOUT = 120_000  # ms; a loaded machine takes half a minute to start a browser
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")


@dataclass
class Visit:
    """A page, what it complained about, and what it asked for."""

    page: Any
    site: Path
    complaints: list[str] = field(default_factory=list)
    requests: list[str] = field(default_factory=list)

    def hear(self, note: Any) -> None:
        if note.type in ("error", "warning"):
            self.complaints.append(note.text)

    def open(self, path: str) -> None:
        self.page.goto(f"{self.site.as_uri()}/{path}")
        self.page.wait_for_selector("body[data-ready=yes]")

    def texts(self, selector: str) -> list[str]:
        found: list[str] = self.page.locator(selector).all_inner_texts()
        return found

    def wait(self, script: str) -> None:
        """Waits until an expression is true; the policy of the pages forbids Playwright's own."""
        deadline = time.monotonic() + TIMEOUT / 1000
        while not self.run(script):
            assert time.monotonic() < deadline, script
            self.page.wait_for_timeout(30)

    def run(self, script: str) -> Any:
        return self.page.evaluate(script)
