"""docs/settings.md has every setting of every offline algorithm, with the value that it has."""

import dataclasses
import re
from pathlib import Path
from typing import Any

import pytest

from swarmdata.registry.components import OFFLINE_ALGORITHMS, resolve

PAGE = Path(__file__).parents[2] / "docs/settings.md"
ROW = re.compile(r"^\| `(?P<name>\w+)` \| (?P<algorithms>.+?) \| (?P<value>.+?) \|")


def rows() -> dict[str, dict[str, str]]:
    """Values by setting and algorithm; `all` are the others."""
    found: dict[str, dict[str, str]] = {}
    for row in filter(None, map(ROW.match, PAGE.read_text(encoding="utf-8").splitlines())):
        for algorithm in row["algorithms"].replace("`", "").split(", "):
            assert algorithm not in found.setdefault(row["name"], {}), row.group()
            found[row["name"]][algorithm] = row["value"]
    return found


def written(value: Any) -> str:
    if isinstance(value, tuple):
        return ", ".join(map(written, value))
    if isinstance(value, bool) or value is None:
        return str(value).lower()
    return value if isinstance(value, str) else f"{value:,}".removesuffix(".0")


@pytest.mark.parametrize("algorithm", OFFLINE_ALGORITHMS)
def test_every_default_is_on_the_page(algorithm: str) -> None:
    page, config = rows(), resolve("algorithm", OFFLINE_ALGORITHMS, algorithm).Config()
    for field in dataclasses.fields(config):
        known = page[field.name]
        value = known.get(algorithm, known.get("all"))
        assert value == written(getattr(config, field.name)), (field.name, value)


def test_no_row_is_of_a_setting_that_nobody_has() -> None:
    configs = {
        name: {
            f.name
            for f in dataclasses.fields(resolve("algorithm", OFFLINE_ALGORITHMS, name).Config)
        }
        for name in OFFLINE_ALGORITHMS
    }
    for name, values in rows().items():
        owners = {algorithm for algorithm, names in configs.items() if name in names}
        assert owners, name
        named = set(values) - {"all"}
        assert named <= owners, (name, named - owners)
        assert ("all" in values) == (named != owners), name
