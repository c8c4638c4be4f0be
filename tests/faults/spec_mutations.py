"""Specs that are wrong in one or a few places, and a process that tries what they describe.

Run as a program it reads one case a line and answers with one line each: what became of it. The
test beside it ends the process if an answer takes too long; memory is bounded by the system.
"""

import json
import random
import resource
import sys
import traceback
from collections.abc import Iterator
from copy import deepcopy
from pathlib import Path
from typing import Any

EXTRA_BYTES = 1 << 30
"""What a case may take beyond a warm process."""

N_STEPS = 4

NUMBERS = [
    0, -1, 1, 2, 3, 7, 64, 255, 256, 1000, 1024, 65_536, 10**6, 2**31, 2**31 - 1, 2**32, 2**63,
    2**64, 10**30, 0.0, -0.0, 1e-300, 1e-30, 1e-12, 1e-9, 1e-6, 1e-3, 0.01, 0.1, 0.5, 1.5, 10.0,
    1e3, 1e4, 1e6, 1e9, 1e12, 1e30, 1e100, 1e308, float("inf"), float("-inf"), float("nan"),
]  # fmt: skip
FACTORS = [-1, 0.1, 0.5, 0.9, 1.1, 2, 3, 10, 30, 100, 1000, 1e6]
EDGES = [1e-3, 1e-2, 0.1, 1.0, 10.0, 100.0, 1000.0, 1e6]
STRANGE: list[Any] = [
    None, True, False, "", "x", "../../x", "a\nb", "\x00", "CON", "r\u043ebot", "a" * 300,
    "robot_0", "\ud800", "1e3", "0x10", "2024-99-99", [], {}, [[]], [1, 2, 3], {"kind": "none"},
]  # fmt: skip
MODELS: dict[str, list[dict[str, Any]]] = {
    "observation": [
        {"kind": "state", "n_neighbors": 300, "n_obstacles": 300},
        {"kind": "lidar", "n_rays": 1024, "stack": 4},
        {"kind": "lidar", "n_rays": 360, "delay": 900, "dropout": 1.0},
        {"kind": "bearing", "n_neighbors": 64, "noise": {"position": 1e3, "range": 1e3}},
        {"kind": "occupancy", "cells": 65, "cell_size": 0.001},
        {"kind": "occupancy", "cells": 3, "cell_size": 1000.0, "stack": 64},
    ],
    "communication": [
        {"kind": "none"},
        {"kind": "broadcast", "payload": "learned", "message_size": 512},
        {"kind": "broadcast", "payload": "state", "delay": 1000, "bits": 1, "slots_in_step": 3},
        {"kind": "broadcast", "topology": "nearest", "n_nearest": 500, "messages_per_step": 1},
        {"kind": "broadcast", "topology": "star", "bursts": {"enter": 1.0, "leave": 0.0}},
    ],
}
NOISE = [
    "&a ", "*a", "!!int ", "!!python/object:os.system ", "- ", ": ", "? ", "[", "{", "]", "}", "\t",
    "\n", "#", "'", '"', "|", ">", "%YAML 1.1\n", "---\n", "...\n", "<<: *a\n", "9" * 5000, "\x07",
    "\ufeff", "!!set ", "!!binary ", "2024-13-45", "1:1:1:1", ".inf", "0o", "0x",
]  # fmt: skip
CHARACTERS = "\x00\x07\t\n\x85\u2028\ufeff\U0001f600"


def cases(n: int, seed: int) -> Iterator[str]:
    """Texts of n mutated specs: of every preset in turn, changed as data or as text."""
    from swarmdata.registry.presets import preset, preset_names

    names = preset_names()
    whole = {name: preset(name).model_dump(mode="json") for name in names}
    for k in range(n):
        draw = random.Random(f"{seed}/{k}")
        data = json.loads(json.dumps(whole[names[k % len(names)]]))
        if draw.random() < 0.4:
            _stretch(draw, data)
        else:
            for _ in range(draw.choice((1, 1, 1, 2, 3))):
                _mutate(draw, data, whole)
        text = json.dumps(data)
        if draw.random() < 0.15:
            text = _garble(draw, preset(names[k % len(names)]).to_yaml())
        yield text


def mutated(data: dict[str, Any], seed: str) -> dict[str, Any]:
    """A copy of any document with one to three places changed."""
    draw, copy = random.Random(seed), json.loads(json.dumps(data))
    for _ in range(draw.choice((1, 1, 2, 3))):
        _change(draw, *draw.choice(list(_places(copy))))
    return dict(copy)


def _mutate(draw: random.Random, data: dict[str, Any], whole: dict[str, Any]) -> None:
    """Changes one place of a spec."""
    kind = draw.random()
    if kind < 0.1:
        part = draw.choice(("observation", "communication"))
        data[part] = dict(draw.choice(MODELS[part]))
    elif kind < 0.2:
        part = draw.choice(("rules", "team", "arena", "spawn", "obstacles"))
        data[part] = json.loads(json.dumps(whole[draw.choice(list(whole))][part]))
    else:
        holder, key = draw.choice(list(_places(data)))
        _change(draw, holder, key)


def _stretch(draw: random.Random, data: dict[str, Any]) -> None:
    """Changes several numbers to the edges of what may be allowed."""
    if draw.random() < 0.5:
        part = draw.choice(("observation", "communication"))
        data[part] = dict(draw.choice(MODELS[part]))
    numbers = [
        (holder, key)
        for holder, key in _places(data)
        if isinstance(holder[key], int | float) and not isinstance(holder[key], bool)
    ]
    for holder, key in draw.sample(numbers, draw.randrange(1, 7)):
        old = holder[key]
        is_whole = isinstance(old, int)
        new = draw.choice(EDGES) if draw.random() < 0.5 else old * draw.choice(FACTORS[1:])
        holder[key] = max(1, int(new)) if is_whole else new


def _places(value: Any) -> Iterator[tuple[Any, Any]]:
    """Every place of a nested value, as what holds it and its key."""
    items = value.items() if isinstance(value, dict) else enumerate(value)
    for key, inner in list(items):
        yield value, key
        if isinstance(inner, dict | list):
            yield from _places(inner)


def _change(draw: random.Random, holder: Any, key: Any) -> None:
    old = holder[key]
    is_number = isinstance(old, int | float) and not isinstance(old, bool)
    choice = draw.random()
    if is_number and choice < 0.45:
        factor = draw.choice(FACTORS)
        holder[key] = type(old)(old * factor)
    elif is_number and choice < 0.9:
        holder[key] = draw.choice(NUMBERS)
    elif isinstance(old, list) and old and choice < 0.6:
        holder[key] = [each for _ in range(draw.choice((2, 3, 100))) for each in deepcopy(old)]
    elif isinstance(holder, dict) and choice < 0.7:
        holder[draw.choice(("horizn", "", "a\nb", "x" * 200))] = deepcopy(draw.choice(STRANGE))
    elif choice < 0.8:
        del holder[key]
    else:
        holder[key] = deepcopy(draw.choice(STRANGE))


def _garble(draw: random.Random, text: str) -> str:
    """Changes characters of a text in YAML."""
    for _ in range(draw.choice((1, 1, 2, 5))):
        at = draw.randrange(len(text))
        kind = draw.randrange(4)
        if kind == 0:
            text = text[:at] + draw.choice(NOISE) + text[at:]
        elif kind == 1:
            text = text[:at] + text[at + draw.randrange(1, 40) :]
        elif kind == 2:
            text = text[:at] + text[max(0, at - draw.randrange(1, 200)) :]
        else:
            text = text[:at] + draw.choice(CHARACTERS) + text[at:]
    return text


def outcome(text: str) -> str:
    """What becomes of a spec: "refused: ...", "world: ...", or "broken: ..."."""
    from swarmdata.errors import SwarmdataError
    from swarmdata.specs.task_spec import TaskSpec

    try:
        spec = TaskSpec.from_text(text, "the case")
        problem = _flaw(spec)
    except SwarmdataError as error:
        message = str(error)
        if len(message) > 4000 or not message.isprintable():
            return f"broken: the message is no sentence: {message!r:.300}"
        return f"refused: {type(error).__name__}: {message}"
    except BaseException:
        return f"broken: {traceback.format_exc()[-1500:]}"
    return f"broken: {problem}" if problem else f"world: {spec.task}"


def _flaw(spec: Any) -> str | None:
    """What is wrong with a world that was not refused, None if it is right."""
    import numpy as np

    from swarmdata.registry.components import make_env

    if len(set(spec.agent_names)) != spec.n_agents:
        return "two robots have one name"
    if type(spec).from_text(spec.to_json()) != spec:
        return "it is not read again as it was written"
    env, numbers = make_env(spec), np.random.default_rng(0)
    step = env.reset(np.array([3], np.uint64))
    for k in range(N_STEPS + 1):
        for name in ("observations", "states", "rewards", "sent"):
            if not np.isfinite(getattr(step, name)).all():
                return f"{name} are not finite after {k} steps"
        actions = numbers.uniform(-1, 1, (1, spec.n_agents, spec.action_size))
        step = env.step(actions.astype(np.float32))
    return None


def _warm_up() -> None:
    """Loads, and where need be compiles, what any world needs."""
    from swarmdata.registry.presets import preset, preset_names

    base = {name: preset(name).model_dump(mode="json") for name in preset_names()}
    for name, data in base.items():
        _expect_a_world(name, data)
    for part, models in MODELS.items():
        for model in models:
            _expect_a_world(str(model), {**base["coop_nav"], part: model})


def _expect_a_world(name: str, data: dict[str, Any]) -> None:
    found = outcome(json.dumps(data))
    if not found.startswith("world"):
        raise SystemExit(f"{name}: {found}")


def _limit_memory() -> None:
    status = Path("/proc/self/status").read_text()
    used = next(int(line.split()[1]) << 10 for line in status.splitlines() if "VmData" in line)
    resource.setrlimit(resource.RLIMIT_DATA, (used + EXTRA_BYTES, used + EXTRA_BYTES))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def main() -> None:
    """Answers cases until there are no more."""
    _warm_up()
    _limit_memory()
    print("ready", flush=True)
    for line in sys.stdin:
        print(json.dumps(outcome(json.loads(line))), flush=True)


if __name__ == "__main__":
    main()
