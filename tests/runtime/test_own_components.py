"""Registered and installed components: names, conflicts, and what workers are told."""

import importlib
import json
import os
from collections.abc import Iterator
from pathlib import Path

import pytest

import swarmdata
from swarmdata.behavior_policies.simple import Idle
from swarmdata.errors import SpecError, UnknownNameError
from swarmdata.registry.components import OFFLINE_ALGORITHMS, POLICIES, make_policy, resolve
from swarmdata.runtime import own_components
from swarmdata.runtime.own_components import (
    GROUPS,
    REGISTERED_VARIABLE,
    components,
    own_codes,
    summary_of,
)
from swarmdata.specs.task_spec import TaskSpec


@pytest.fixture(autouse=True)
def nothing_is_registered(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.setattr(own_components, "_here", {group: {} for group in GROUPS})
    monkeypatch.setenv(REGISTERED_VARIABLE, "{}")
    own_components._installed.cache_clear()
    yield
    own_components._installed.cache_clear()


class Resting(Idle):
    """A policy of a test, which other processes can import from here."""


def test_a_registered_class_is_found_by_its_name_here_and_in_workers() -> None:
    swarmdata.register_policy("resting", Resting)
    assert isinstance(make_policy("resting", TaskSpec()), Resting)
    assert list(POLICIES)[-1] == "resting"
    assert len(POLICIES) == len(POLICIES.own) + 1
    told = json.loads(os.environ[REGISTERED_VARIABLE])
    assert told == {"policies": {"resting": f"{__name__}:Resting"}}


def test_a_worker_finds_what_its_environment_names(monkeypatch: pytest.MonkeyPatch) -> None:
    place = {"algorithms": {"mine": f"{__name__}:Resting"}}
    monkeypatch.setenv(REGISTERED_VARIABLE, json.dumps(place))
    assert "mine" in OFFLINE_ALGORITHMS
    assert resolve("algorithm", OFFLINE_ALGORITHMS, "mine").__name__ == "Resting"


def test_a_class_that_others_cannot_import_stays_in_this_process() -> None:
    class Local(Idle):
        pass

    swarmdata.register_policy("local", Resting)
    swarmdata.register_policy("local", Local)
    assert isinstance(make_policy("local", TaskSpec()), Local)
    assert json.loads(os.environ[REGISTERED_VARIABLE]) == {"policies": {}}  # nor the class before


def test_text_names_a_class_and_a_second_registration_replaces_the_first() -> None:
    swarmdata.register_policy("mine", "swarmdata.behavior_policies.simple:Random")
    swarmdata.register_policy("mine", "swarmdata.behavior_policies.simple:Idle")
    assert type(make_policy("mine", TaskSpec())) is Idle


@pytest.mark.parametrize(
    ("register", "name"),
    [
        (swarmdata.register_policy, "scripted"),
        (swarmdata.register_task, "coop_nav"),
        (swarmdata.register_algorithm, "bc"),
        (swarmdata.register_remote, "hf"),
    ],
)
def test_names_of_the_package_stay_its_own(register: object, name: str) -> None:
    with pytest.raises(SpecError, match=f"'{name}' among .* cannot be replaced"):
        register(name, Idle)  # type: ignore[operator]
    with pytest.raises(SpecError, match="expected a class, or text such as 'my_package:Name'"):
        register("mine", "no place")  # type: ignore[operator]


def test_offline_and_online_algorithms_are_apart() -> None:
    swarmdata.register_algorithm("mine", Idle, online=True)
    assert "mine" in components("online_algorithms")
    with pytest.raises(UnknownNameError):
        resolve("algorithm", OFFLINE_ALGORITHMS, "mine")


def distribution(site: Path, name: str, text: str) -> None:
    info = site / f"{name}-1.0.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(text)


def test_entry_points_of_installed_distributions_are_found(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    place = f"{__name__}:Resting"
    distribution(tmp_path, "one", f"[swarmdata.policies]\nresting = {place}\n")
    monkeypatch.syspath_prepend(tmp_path)
    importlib.invalidate_caches()
    assert isinstance(make_policy("resting", TaskSpec()), Resting)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("scripted", "'scripted' among policies is .* uninstall one, or rename it there"),
        ("resting", "two installed distributions have 'resting'"),
    ],
)
def test_conflicts_of_entry_points_are_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, message: str
) -> None:
    distribution(tmp_path, "one", f"[swarmdata.policies]\n{name} = {__name__}:Resting\n")
    distribution(tmp_path, "other", f"[swarmdata.policies]\n{name} = {__name__}:Other\n")
    monkeypatch.syspath_prepend(tmp_path)
    importlib.invalidate_caches()
    with pytest.raises(SpecError, match=message):
        components("policies")


def test_changed_code_of_users_has_another_hash(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "swiftly.py").write_text("class Swift: ...\n")
    swarmdata.register_policy("swift", "swiftly:Swift")
    first = own_codes(policies="swift", tasks="tag")
    assert list(first) == ["code of swift (policies)"]
    (tmp_path / "swiftly.py").write_text("class Swift: speed = 2\n")
    assert own_codes(policies="swift", tasks="tag") != first


def test_a_package_without_init_file_has_a_hash_and_components_of_one_name_have_their_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(tmp_path)
    for folder, base in (("lab", "Idle"), ("team", "Random")):
        (tmp_path / folder).mkdir()
        text = f"from swarmdata.behavior_policies.simple import {base} as Mine\n"
        (tmp_path / folder / "parts.py").write_text(text)
    swarmdata.register_task("mine", "lab.parts:Mine")
    swarmdata.register_policy("mine", "team.parts:Mine")
    first = own_codes(tasks="mine", policies="mine")
    assert len({*first.values()}) == 2
    (tmp_path / "lab" / "parts.py").write_text("from swarmdata.behavior_policies.simple import *\n")
    again = own_codes(tasks="mine", policies="mine")
    assert [again[key] == first[key] for key in first] == [False, True]


@pytest.mark.parametrize("place", ["gone:Mine", "gone.parts:Mine", f"{__name__}:Gone"])
def test_a_component_that_cannot_be_imported_is_named(place: str) -> None:
    swarmdata.register_algorithm("mine", place)
    with pytest.raises(SpecError, match=f"'{place}' cannot be imported: .* as module:name"):
        resolve("algorithm", OFFLINE_ALGORITHMS, "mine")
    assert "Gone" not in summary_of(place)  # lists of algorithms name it
