"""Settings that cannot be meant are refused, for every algorithm, by name."""

import dataclasses
import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, get_args

import pytest

pytest.importorskip("torch", reason="algorithms need torch")

from swarmdata.errors import SpecError
from swarmdata.learn.training.setting_ranges import RANGES, Range, check_range
from swarmdata.learn.training.settings import LogUniform, override, setting_types, space_of
from swarmdata.offline_algos.bc import BCConfig
from swarmdata.registry.components import OFFLINE_ALGORITHMS, ONLINE_ALGORITHMS, resolve

OFFLINE = {name: resolve("algorithm", OFFLINE_ALGORITHMS, name) for name in OFFLINE_ALGORITHMS}
ONLINE = {name: resolve("algorithm", ONLINE_ALGORITHMS, name) for name in ONLINE_ALGORITHMS}
KINDS = (*OFFLINE.values(), *ONLINE.values())


def is_numeric(kind: Any) -> bool:
    return kind in (int, float) or any(map(is_numeric, get_args(kind)))


def settings_of(config: Any) -> Iterator[tuple[type, str, Any]]:
    """The class, name and value of every field, those of sections too."""
    for field in dataclasses.fields(config):
        value = getattr(config, field.name)
        if dataclasses.is_dataclass(value):
            yield from settings_of(value)
        else:
            yield type(config), field.name, value


@pytest.mark.parametrize("kind", KINDS)
def test_every_number_has_a_range_that_its_default_is_in(kind: Any) -> None:
    config = kind.Config
    numeric = {key for key, kind in setting_types(config).items() if is_numeric(kind)}
    assert {key for key in numeric if key.rpartition(".")[2] not in RANGES} == set()
    for each in settings_of(config()):
        check_range(*each)


def test_no_range_is_of_a_setting_that_is_gone() -> None:
    known = {name for kind in KINDS for _, name, _ in settings_of(kind.Config())}
    assert RANGES.keys() - known == set()


@pytest.mark.parametrize("name", OFFLINE)
def test_search_spaces_are_inside(name: str) -> None:
    for key, space in space_of(OFFLINE[name], name).items():
        ends = (space.low, space.high) if isinstance(space, LogUniform) else space.values
        for value in ends:
            check_range(OFFLINE[name].Config, key, value)


@pytest.mark.parametrize(
    ("algorithm", "name", "text", "expected"),
    [
        ("bc", "n_updates", "-3", "is -3, expected at least 1"),
        ("bc", "n_updates", "0", "is 0, expected at least 1"),
        ("bc", "learning_rate", "-1", "is -1.0, expected above 0"),
        ("bc", "hidden", "", r"is \(\), expected numbers, each at least 1"),
        ("bc", "hidden", "8,-4", r"is \(8, -4\), expected numbers, each at least 1"),
        ("iql", "expectile", "1.5", "is 1.5, expected above 0 and below 1"),
        ("maddpg_bc", "discount", "2.0", "is 2.0, expected at least 0 and at most 1"),
        ("maddpg_bc", "tau", "0", "is 0.0, expected above 0 and at most 1"),
        ("mappo", "shaping.team_share", "1.5", "is 1.5, expected at least 0 and at most 1"),
        ("mappo", "start.clone_rounds", "0", "is 0, expected at least 1"),
        ("mappo", "noise_correlation", "1", "is 1.0, expected at least 0 and below 1"),
    ],
)
def test_a_number_outside_its_range_is_refused(
    algorithm: str, name: str, text: str, expected: str
) -> None:
    leaf = name.rpartition(".")[2]
    with pytest.raises(SpecError, match=f"setting '{leaf}' of .*Config {expected}"):
        override(({**ONLINE, **OFFLINE}[algorithm]).Config(), {name: text})


def test_none_is_in_every_range_that_allows_it() -> None:
    assert override(BCConfig(), {"max_grad_norm": "none"}).max_grad_norm is None


def test_a_range_has_ends_that_may_be_outside() -> None:
    half_open = Range(0, 1, is_open_below=True)
    assert [value in half_open for value in (0, 1e-9, 1, 1.1)] == [False, True, True, False]
    assert (math.inf * 0) not in half_open


@dataclass(frozen=True)
class Own:
    n_updates: int = 10
    temperature: float = -1.0


def test_an_algorithm_of_ones_own_has_its_own_ranges_but_for_its_length() -> None:
    assert override(Own(), {"temperature": "-2"}).temperature == -2
    with pytest.raises(SpecError, match="'n_updates' of Own is 0, expected at least 1"):
        override(Own(), {"n_updates": "0"})


def test_training_refuses_them_at_its_entrance(tmp_path: Path) -> None:
    from swarmdata.evaluation.runs.train import train

    with pytest.raises(SpecError, match="setting 'n_updates' of BCConfig is -3"):
        train("bc", tmp_path / "no-data", tmp_path / "run", changes={"n_updates": -3})
    assert not (tmp_path / "run").exists()
