"""What algorithms declare of settings that need another one: it is so, and users are told."""

import dataclasses
from collections.abc import Mapping
from typing import Any, get_args, get_type_hints

import pytest

pytest.importorskip("torch", reason="algorithms need torch")

from swarmdata.errors import SpecError
from swarmdata.learn.training.settings import as_texts, check_effects, needs_of, override
from swarmdata.registry.components import OFFLINE_ALGORITHMS, ONLINE_ALGORITHMS, resolve
from swarmdata.testing.sample_batches import sample_setup
from tests.contract.test_algorithms import SMALL, batches_of

N_UPDATES = 6


def declared(table: Mapping[str, str]) -> list[tuple[str, str]]:
    return [
        (name, setting)
        for name in table
        for setting in needs_of(resolve("algorithm", table, name).Config)
    ]


def other_value(kind: Any, setting: str) -> Any:
    """A value of a setting that is not its default."""
    default, hint = getattr(kind, setting), get_type_hints(kind)[setting]
    if get_args(hint):
        return next(value for value in get_args(hint) if value != default)
    if isinstance(default, bool):
        return not default
    return default // 2 if isinstance(default, int) else default / 2 or 1.0


def split(kind: Any, need: tuple[str, tuple[Any, ...]]) -> tuple[list[Any], list[Any]]:
    """Values of the other setting: those with an effect, and those without."""
    hint = get_type_hints(kind)[need[0]]
    values = (False, True) if hint is bool else get_args(hint)
    return list(need[1]), [value for value in values if value not in need[1]]


TABLES = {"offline": OFFLINE_ALGORITHMS, "online": ONLINE_ALGORITHMS}


@pytest.mark.parametrize(
    ("trained", "name", "setting"),
    [(key, *each) for key, table in TABLES.items() for each in declared(table)],
)
def test_a_change_without_effect_is_refused(trained: str, name: str, setting: str) -> None:
    kind = resolve("algorithm", TABLES[trained], name).Config
    need = needs_of(kind)[setting]
    allowed, others = split(kind, need)
    assert allowed
    assert others
    team = {"reward": "team"} if name == "mac_flow" else {}  # which its mixers need
    for value in (*allowed, *others):
        config = dataclasses.replace(kind(), **team, **{need[0]: value})
        check_effects(config, [setting])  # as it is by default
        config = dataclasses.replace(config, **{setting: other_value(kind, setting)})
        if value in allowed:
            check_effects(config, [setting])
            continue
        with pytest.raises(SpecError, match=f"'{setting}' .* has no effect with {need[0]} "):
            check_effects(config, [need[0], setting])


@pytest.mark.slow
@pytest.mark.parametrize(("name", "setting"), declared(OFFLINE_ALGORITHMS))
def test_what_is_refused_would_change_nothing(name: str, setting: str) -> None:
    kind = resolve("algorithm", OFFLINE_ALGORITHMS, name)
    need = needs_of(kind.Config)[setting]
    small = override(kind.Config(), as_texts({**SMALL[name], "n_updates": N_UPDATES}))
    for value in split(kind.Config, need)[1]:
        config = dataclasses.replace(small, **{need[0]: value})
        changed = dataclasses.replace(config, **{setting: other_value(kind.Config, setting)})
        assert state_of(kind, config) == state_of(kind, changed)


def state_of(kind: Any, config: Any) -> bytes:
    """The state after a short training."""
    algorithm = kind(sample_setup((0,)), config)
    for index in range(N_UPDATES):
        algorithm.update(batches_of(config)((0,), index))
    state = algorithm.state_dict()
    return b"".join(state[name].numpy().tobytes() for name in sorted(state))
