"""Settings of offline algorithms: all are in docs/settings.md, impossible ones are refused."""

import dataclasses
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swarmdata.errors import SchemaError
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


REFUSED: list[tuple[str, dict[str, Any], str]] = [
    *(("filtered_bc", {"fraction": f}, "above 0 and at most 1") for f in (0.0, -0.1, 1.1, np.nan)),
    ("filtered_bc", {"min_episodes": 0}, "min_episodes is 0"),
    ("iql_cost", {"cost_weight": -1.0}, "cost_weight is -1"),
    *(("mac_flow", {"critic_share": s}, "a part of the updates") for s in (-0.1, 1.0, np.nan)),
    ("mac_flow", {"policy_network": "deep_sets"}, "expected 'mlp'"),
    ("mac_flow", {"mixer": "free"}, "expected reward 'team'"),
    ("oryx", {"n_heads": 3}, "multiple of the number"),
    ("oryx", {"n_components": 0}, "at least 1"),
    ("maddpg_bc", {"inverse_temperature": 0.0}, "inverse_temperature is 0"),
]  # fmt: skip


@pytest.mark.parametrize(("algorithm", "settings", "message"), REFUSED)
def test_impossible_settings_are_refused(
    algorithm: str, settings: dict[str, Any], message: str
) -> None:
    with pytest.raises(SchemaError, match=message):
        resolve("algorithm", OFFLINE_ALGORITHMS, algorithm).Config(**settings)
