"""Specs from elsewhere: each is refused in one sentence of ours, or is a finite world."""

import json
import re
import selectors
import subprocess
import sys
from collections import Counter
from collections.abc import Callable, Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swarmdata.envs.coop_nav.navigation_rules import NavigationRewards
from swarmdata.errors import SpecError
from swarmdata.evaluation.study.plan import Study
from swarmdata.interop.conversion.imported_data import AgentShapes, spec_from_shapes
from swarmdata.interop.conversion.user_choices import Choices
from swarmdata.record import Recorder
from swarmdata.registry.components import make_env, make_policy
from swarmdata.registry.presets import preset, preset_names
from swarmdata.registry.published import published
from swarmdata.registry.recipes import shipped_recipes
from swarmdata.runtime.documents import parse_document
from swarmdata.specs.frozen import Frozen
from swarmdata.specs.origins import RecordedSpec, parse_origin
from swarmdata.specs.recipe import Recipe
from swarmdata.specs.task_spec import TaskSpec
from tests.faults.spec_mutations import cases, mutated
from tests.record.worlds import Counting
from tests.support.pairs import slow

ROOT = Path(__file__).parents[2]
SMOKE = ROOT / "cards" / "studies" / "smoke.yaml"

MAX_SECONDS = 10.0
WARM_UP_SECONDS = 600.0  # kernels are compiled where no cache has them


class Prober:
    """A process that tries specs; one that hangs or dies is replaced."""

    def __init__(self) -> None:
        self._process: subprocess.Popen[str] | None = None

    def outcome(self, text: str) -> str:
        """What became of a spec; "broken: ..." also where the process hung or died."""
        process = self._process or self._start()
        assert process.stdin is not None
        process.stdin.write(json.dumps(text) + "\n")
        process.stdin.flush()
        answer = self._line(process, MAX_SECONDS)
        if answer:
            return str(json.loads(answer))
        code = process.poll()
        self.close()
        return f"broken: {'took too long' if code is None else f'the process died: {code}'}"

    def _start(self) -> subprocess.Popen[str]:
        command = [sys.executable, "-W", "error", "-m", "tests.faults.spec_mutations"]
        process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, cwd=ROOT
        )
        self._process = process
        assert self._line(process, WARM_UP_SECONDS) == "ready\n"
        return process

    @staticmethod
    def _line(process: subprocess.Popen[str], seconds: float) -> str:
        assert process.stdout is not None
        with selectors.DefaultSelector() as selector:
            selector.register(process.stdout, selectors.EVENT_READ)
            return process.stdout.readline() if selector.select(seconds) else ""

    def close(self) -> None:
        """Ends the process."""
        if self._process is not None:
            self._process.kill()
            self._process.communicate()
            self._process = None


@pytest.fixture(scope="module")
def each() -> Iterator[Prober]:
    found = Prober()
    yield found
    found.close()


def probe(each: Prober, n: int) -> Counter[str]:
    """Tries n mutated specs; fails with all that are neither refused nor worlds."""
    kinds: Counter[str] = Counter()
    broken = []
    for k, text in enumerate(cases(n, seed=1)):
        found = each.outcome(text)
        kinds[found.partition(":")[0]] += 1
        if found.startswith("broken"):
            broken.append(f"case {k}: {found}\n{text[:3000]}")
    assert not broken, f"{len(broken)} of {n}:\n" + "\n\n".join(broken[:20])
    return kinds


LONG = "9" * 5_000
CYRILLIC_A = "\u0430"  # looks like a Latin one

BOMBS = {
    "an integer of 5,000 digits": (f"horizon: {LONG}", "column 10: horizon: a number of 5000 ch"),
    "the same in JSON": (f'{{"horizon": {LONG}}}', "line 1, column 13: a number of 5000 char"),
    "an integer in base 60": ("horizon: " + "1:" * 60_000 + "1", "horizon: a number of 120001"),
    "a tag that lies": ("horizon: !!int abc", "line 1, column 10: horizon: 'abc' is no whole num"),
    "code in a tag": ("horizon: !!python/object/apply:os.getpid []", "a value tagged"),
    "an odd date": ("horizon: 2024-99-99", "horizon: expected a whole number"),
    "a date tagged as one": ("horizon: !!timestamp 2024-99-99", "a value tagged"),
    "a list as a key": ("? [a, b]\n: 1", "line 1, column 3: a key that is a mapping or a list"),
    "a mapping as a key": ("{a: 1}: 2", "a key that is a mapping or a list"),
    "a key given twice": ("horizon: 1\nhorizon: 2", "line 2, column 1: key 'horizon' is given tw"),
    "a nested key given twice": (
        "rules: {rewards: {time: 1, time: 2}}",
        "column 28: rules.rewards: key 'time' is given twi",
    ),
    "the same key twice in JSON": ('{"horizon": 1, "horizon": 2}', "key 'horizon' is given twice"),
    "lists in lists": ("[" * 100_000, "nested deeper than 32"),
    "mappings in mappings": ("{a: " * 50_000, "nested deeper than 32"),
    "nested JSON": ('{"a":' * 100_000, "nested"),
    "blocks in blocks": ("\n".join(" " * k + "a:" for k in range(600)), "nested deeper than 32"),
    "aliases that multiply": (
        "a: &a [1, 1, 1, 1, 1, 1, 1, 1, 1]\n"
        + "".join(f"{y}: &{y} [{', '.join([f'*{x}'] * 9)}]\n" for x, y in pairwise("abcdefghi")),
        "more than 20000 values",
    ),
    "aliases that nest": (
        "k0: &a0 [1]\n"
        + "".join(f"k{i + 1}: &a{i + 1} {'[' * 9}*a{i}{']' * 9}\n" for i in range(40)),
        "nested deeper than 32",
    ),
    "merge keys that multiply": ("a: &a {x: 1}\nb: {<<: [*a, *a]}", "b: a merge key <<"),
    "an alias inside of itself": ("a: &a [*a]", "nested deeper than 32"),
    "an alias of nothing": ("a: *b", "found undefined alias"),
    "200,000 values": ("- 1\n" * 60_000, "more than 20000 values"),
    "100,000 keys": ("".join(f"{k}: 1\n" for k in range(30_000)), "more than 20000 values"),
    "a megabyte": ("# " * 500_000, "has 1000000 characters, expected at most 262144"),
    "a control character": ("horizon: 1\n\x07", r"line 2, column 1: the character '\x07'"),
    "half a character": ('task: "\\ud800"', "half a character"),
    "half a character in JSON": ('{"task": "\\ud800"}', "half a character"),
    "two documents": ("horizon: 1\n---\nhorizon: 2", "expected a single document"),
    "nothing": ("", "expected a mapping of keys to values"),
    "infinity": ("control_dt: .inf", "control_dt: '.inf' is no finite number"),
    "infinity in JSON": ('{"control_dt": 1e999}', "1e999 is not a finite number"),
}

PRODUCTS = {
    "a million robots": ("team: [{count: 1000000}]", r"team: 1,000,000 robots.*[0-9.]+ TiB"),
    "2^31 rays": ("observation: {kind: lidar, n_rays: 2147483648}", r"observation: .* [TG]iB"),
    "cells": ("observation: {kind: occupancy, cells: 100000}", r"observation: .* [TP]iB"),
    "neighbors": ("observation: {kind: bearing, n_neighbors: 1000000000}", "observation: .*iB"),
    "a stack": ("observation: {kind: state, stack: 100000}", "observation.stack: 100,000 frames"),
    "a sensor's delay": ("observation: {kind: state, delay: 1000000}", "delay: 1,000,000"),
    "the radio's delay": ("communication: {kind: broadcast, delay: 99999}", "communication.delay"),
    "a message": (
        "communication: {kind: broadcast, payload: learned, message_size: 99999999}",
        "observation: 300,0.* numbers for each robot",
    ),
    "obstacles": ("obstacles: {circles: 100000}", "obstacles: 100,004 of them"),
    "shelves": ("rules: {task: warehouse, aisles: 100000, blocks: 100000}", "les: 10,000,000,0"),
    "bays": ("rules: {task: warehouse, bays: 100000000}", "rules: 600,000,004 places"),
    "a horizon": ("horizon: 1000000000", "horizon: 1,000,000,000 steps, at most 1,000,000"),
    "physics steps": ("{control_dt: 1000, physics_dt: 0.001}", "physics_dt: 1,000,000 phys"),
    "rays x frames x robots": (
        "{team: [{count: 256}], observation: {kind: lidar, n_rays: 1024, stack: 40}}",
        r"one copy of the world takes about [0-9.]+ [GM]iB.*256 robots.*1,024 rays x 40 frames",
    ),
    "an episode": (
        "{horizon: 900000, observation: {kind: lidar, n_rays: 1024}}",
        r"one recorded episode takes about [0-9.]+ GiB, at most 4 GiB.*horizon \(900,000 steps\)",
    ),
    "robots that match slots": (
        "{team: [{count: 1024}], rules: {task: formation}}",
        r"one control step takes about [0-9.]+ s, at most 1 s",
    ),
    "many attempts of few robots": (
        "{team: [{count: 8}], spawn: {max_attempts: 2000000}, "
        "obstacles: {circles: 1, boxes: 0, corners: 0, pockets: 0}}",
        "drawing a layout takes up to about .*max_att",
    ),
    "attempts": ("spawn: {max_attempts: 1000000000}", "takes up to about .*max_att"),
}


@pytest.mark.parametrize("name", BOMBS)
def test_text_that_is_no_document_is_refused_with_its_place(name: str, each: Prober) -> None:
    """Row 49: whatever the parser stumbles over, within 10 s and 1 GB."""
    text, message = BOMBS[name]
    found = each.outcome(text)
    assert found.startswith("refused: SpecError: "), found
    assert message in found


@pytest.mark.parametrize("name", PRODUCTS)
def test_what_costs_too_much_is_refused_with_the_estimate(name: str, each: Prober) -> None:
    """Row 50: single counts and products of them, before anything of that size is made."""
    text, message = PRODUCTS[name]
    found = each.outcome(text)
    assert found.startswith("refused: SpecError: "), found
    assert re.search(message, found), found
    assert re.search("takes about|estimated|takes up to", found), found


def test_large_worlds_that_research_needs_are_worlds(each: Prober) -> None:
    """Row 50: the bounds are not in the way."""
    arena = "arena: {width: 40, height: 40}"
    for text in (
        f"{{team: [{{count: 256}}], {arena}, horizon: 40}}",
        f"{{team: [{{count: 256}}], {arena}, observation: {{kind: lidar, n_rays: 64}}}}",
        "observation: {kind: lidar, n_rays: 1024}",
        "observation: {kind: lidar, n_rays: 64, stack: 64}",
        "observation: {kind: occupancy, cells: 64}",
        f"{{team: [{{count: 64}}], {arena}, communication: {{kind: broadcast, delay: 20}}}}",
    ):
        assert each.outcome(text) == "world: coop_nav", text


@pytest.mark.parametrize("task", ["coop_nav", "transport"])
def test_an_arena_too_large_to_be_mapped_is_refused_by_those_who_plan(task: str) -> None:
    """Row 50: the world is fine, a planner's maps of it are not."""
    spec = preset(task).with_updates(arena={"width": 1000, "height": 1000})
    step = make_env(spec).reset(np.array([3], np.uint64))
    assert np.isfinite(step.states).all()
    with pytest.raises(SpecError, match=r"maps of the arena of 1000 x 1000 m take [0-9.]+ GiB"):
        make_policy("scripted", spec)
    assert make_policy("straight", spec)


@pytest.mark.parametrize("value", ["1e308", "1e39", "1e7", "-1", "'x'"])
def test_weights_that_make_rewards_infinite_are_refused(value: str) -> None:
    """Row 51: what could overflow float32 in an episode."""
    with pytest.raises(
        SpecError, match=r"rules\.coop_nav\.rewards\.progress: .*(at most|at least|number)"
    ):
        TaskSpec.from_text(f"rules: {{task: coop_nav, rewards: {{progress: {value}}}}}")


def test_the_largest_weights_make_finite_returns() -> None:
    """Row 51: a whole episode's sum and its square, in float32."""
    rewards = dict.fromkeys(NavigationRewards.model_fields, 1e6) | {"team_share": 1.0}
    spec = TaskSpec.parse({"rules": {"task": "coop_nav", "rewards": rewards}, "horizon": 20})
    env = make_env(spec, 4)
    env.reset(np.arange(4, dtype=np.uint64))
    total = np.zeros((4, spec.n_agents), np.float32)
    for _ in range(spec.horizon):
        total += env.step(np.ones((4, spec.n_agents, 2))).rewards
    assert np.isfinite(total**2 * np.float32(1e6)).all()
    assert np.abs(total).max() > 1e6


BAD_NAMES = [
    "", " ", ".", "..", "../../x", "a/../b", "/etc/passwd", "a\nb", "a\x00b", "\x1b[31m",
    "a\u202eb",
    f"rob{CYRILLIC_A}t", "\ufb01", "con", "NUL.txt", "a" * 300, "<b>", "a|b", "`a`", "-rf", "~",
    "$HOME",
]  # fmt: skip


@pytest.mark.parametrize("name", BAD_NAMES)
def test_strange_names_are_refused_wherever_they_would_be_used(name: str) -> None:
    """Row 48: names of roles and agents, labels, policies, tiers, checkpoints."""
    policy = {"label": "a", "name": "random"}
    recipe = {"id": "coop_nav-a-v0", "tier": "a", "spec": {}, "policies": [policy]}
    box = {"kind": "box", "shape": [1], "dtype": "float32"}
    agent = {"name": "a", "observation": box, "action": box}
    recorded = {"task": "t", "agents": [agent], "state_size": 1, "state_from": "environment"}
    assert Recipe.parse(recipe)
    assert RecordedSpec.parse(recorded)
    bad: list[tuple[type[Frozen], dict[str, object], str]] = [
        (TaskSpec, {"team": [{"name": name}]}, r"team\.0\.name: "),
        (Recipe, {**recipe, "tier": name}, "tier: "),
        (Recipe, {**recipe, "id": name}, "id: "),
        (Recipe, {**recipe, "policies": [{**policy, "label": name}]}, r"policies\.0\.label: "),
        (Recipe, {**recipe, "policies": [{**policy, "name": name}]}, r"policies\.0\.name: "),
        (Recipe, {**recipe, "policies": [{**policy, "checkpoint": name}]}, r"0\.checkpoint: "),
        (RecordedSpec, {**recorded, "agents": [{**agent, "name": name}]}, r"agents\.0\.name: "),
        (RecordedSpec, {**recorded, "task": name}, "task: "),
        (Study, {"name": name, "datasets": ["a"], "algorithms": {}}, "name: "),
    ]
    for model, data, place in bad:
        if name == "con" and model in (RecordedSpec, Study) and "agents" not in place:
            continue  # a plain word there, and no file's name
        with pytest.raises(SpecError, match=place) as caught:
            model.parse(data)
        assert str(caught.value).isprintable()


def test_strange_names_in_the_data_of_others_are_errors_of_ours(tmp_path: Path) -> None:
    """Row 48: labels given to a recorder, agents of an environment, folders of other formats."""
    with pytest.raises(SpecError, match="is no label"):
        Recorder(Counting(), id="counting_v1-a-v0", path=tmp_path / "a", policies=("a\nb",))
    env = Counting()
    env.possible_agents = ["../../x", "b"]
    with pytest.raises(SpecError, match="is no name"):
        Recorder(env, id="counting_v1-a-v0", path=tmp_path / "b")
    shapes = AgentShapes(observations=(2,), actions=(1,), choices=((),), states=0)
    with pytest.raises(SpecError, match="is no name"):
        spec_from_shapes("a", shapes, Choices(agents=("a\x1b",)))
    assert list(tmp_path.iterdir()) == []


def test_robots_of_two_roles_have_different_names() -> None:
    """Row 48: a dictionary of robots loses none of them."""
    for names in (("robot", "robot"), ("robot", "Robot")):
        with pytest.raises(SpecError, match="several roles named robot, expected a `name` of its"):
            TaskSpec.parse({"team": [{"name": name, "count": 2} for name in names]})
    team = TaskSpec.parse({"team": [{"name": "a", "count": 2}, {"name": "a_1", "count": 2}]})
    assert len(set(team.agent_names)) == 4


def test_hashes_of_everything_published_stay_what_they_are(update_golden: bool) -> None:
    """Row 52: bounds refuse, and change nothing that is allowed."""
    hashes = {name: preset(name).hash() for name in preset_names()}
    file = ROOT / "tests" / "golden" / "presets.json"
    if update_golden:
        file.write_text(json.dumps(hashes, indent=1) + "\n")
    assert hashes == json.loads(file.read_text())
    recipes = {name: recipe.hash() for name, recipe in shipped_recipes().items()}
    assert recipes == {name: entry.recipe_hash for name, entry in published().items()}
    for recipe in [*shipped_recipes().values()][::5]:
        assert Recipe.from_text(recipe.to_json()) == recipe == Recipe.from_text(recipe.to_yaml())


@pytest.mark.parametrize("n_mutated", [24, *slow(3_000)])
def test_mutated_specs_are_refused_or_finite_worlds(each: Prober, n_mutated: int) -> None:
    """Row 53: many presets, each changed in a few places."""
    kinds = probe(each, n_mutated)
    assert min(kinds["refused"], kinds["world"]) > n_mutated // 7


@pytest.mark.parametrize("n_mutated", [8, *slow(300)])
def test_mutated_recipes_recordings_edits_and_studies_are_refused_or_read(n_mutated: int) -> None:
    """Row 53: what else comes as a document; refused in one sentence, or read as it is written."""
    policy = {"label": "a", "name": "external"}
    common = {"id": "coop_nav-a-v0", "tier": "a", "spec": {"horizon": 9}, "policies": [policy]}
    space = {"kind": "dict", "spaces": {"x": {"kind": "box", "shape": [2], "dtype": "float32"}}}
    agent = {"name": "a", "observation": space, "action": {"kind": "discrete", "n": 3}}
    recorded = {"kind": "recorded", "task": "t", "agents": [agent], "state_size": 2}
    recorded |= {"state_from": "environment"}
    parent = {"id": "coop_nav-a-v0", "digest": "0" * 64, "episodes": [1, 2, 5]}
    documents: list[tuple[Callable[[Any], Frozen], dict[str, Any]]] = [
        (_origin, json.loads(shipped_recipes()["coop_nav-medium-v1"].to_json())),
        (_origin, {**common, "kind": "recording", "spec": recorded, "source": "recorder"}),
        (_origin, {**common, "kind": "edit", "parents": [parent], "operation": "filter"}),
        (Study.parse, parse_document(SMOKE.read_text(), "smoke")),
    ]
    n_refused = 0
    for read, data in documents:
        assert read(data)
        for k in range(n_mutated):
            try:
                found = read(mutated(data, f"{k}"))
            except SpecError as error:
                assert str(error).isprintable()  # noqa: PT017 (some are right)
                n_refused += 1
            else:
                assert type(found).from_text(found.to_json()) == found
                assert found.hash()
    assert n_refused > n_mutated


def _origin(data: Any) -> Frozen:
    return parse_origin(data, "the case")  # type: ignore[return-value]  # every kind is Frozen
