"""Where policies from data of `transport` push more than a clone, into docs/measurements.md.

    swarmdata study cards/studies/regimes.yaml --only '*/transport-medium-expert'
    python -m tests.benchmarks.bench_detours --runs runs/study-regimes

A robot in front of the payload has to go around it before it can push, which takes seconds. In the
steps of a clone's episodes, the difference of another policy's command to the clone's is split into
its part along the payload's way to the goal, and its part around the payload, towards the side from
which the robot can push.
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")

import argparse
from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np

import swarmdata
from swarmdata.interfaces import Policy
from swarmdata.learn.policies.torch_policy import StepFunction
from swarmdata.learn.training.run_folder import load_run
from swarmdata.numerics.random import block_seeds
from swarmdata.registry.components import make_env
from swarmdata.rollouts.rollout import rollout
from swarmdata.specs.state_layout import N_COLUMNS, TX, TY, X, Y
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Bool, Double, Float, Int, Step
from tests.benchmarks.bench_deviations import CLONE
from tests.benchmarks.measuring import table, write_section

DATASET = "transport-medium-expert"

OTHERS = ("filtered_bc", "maddpg_bc", "iql", "vdn")

N_EPISODES = 64
"""Of the validation seeds, for each training seed."""

CONTACT = 0.02
"""A robot this near to the payload (m) counts as touching it."""

ASIDE = 0.3
"""Cosine of the angle at the payload, between the robot and the goal, up to which it is beside."""


@dataclass(frozen=True, slots=True, eq=False)
class Watched(StepFunction):
    """A clone; keeps the states of its steps, its commands, and those of others in its place."""

    clone: Policy
    others: Sequence[Policy]
    states: list[Double] = field(default_factory=list)  # [E, S] of each step
    commands: list[Float] = field(default_factory=list)  # [1 + others, E, N, 2], the clone's first

    @property
    def uses_state(self) -> bool:
        return any(policy.uses_state for policy in (self.clone, *self.others))

    def reset(self, step: Step, copies: Int) -> None:
        for policy in (self.clone, *self.others):
            policy.reset(step, copies)

    def step_actions(self, step: Step) -> Float:
        commands = np.stack([policy.act(step) for policy in (self.clone, *self.others)])
        self.states.append(step.states.astype(np.float64))
        self.commands.append(commands)
        return commands[0]


class Places(NamedTuple):
    """Where robots are at the payload, and their directions there, unit vectors [B, N, 2]."""

    regions: dict[str, Bool]  # name -> [B, N]
    along: Double  # from the payload's centre to its goal
    around: Double  # from the robot around the payload, away from the goal's side


def places(states: Double, n_agents: int, reach: float) -> Places:
    """The places of robots in states [B, S].

    Args:
        states: of `transport`.
        n_agents: N.
        reach: distance of centres (m) up to which a robot touches the payload.
    """
    robots = states[:, : N_COLUMNS * n_agents].reshape(-1, n_agents, N_COLUMNS)
    payload = states[:, None, N_COLUMNS * n_agents :][..., :2]
    along = _unit(robots[..., [TX, TY]] - payload)
    offsets = robots[..., [X, Y]] - payload
    outward = _unit(offsets)
    cosine = (outward * along).sum(-1, keepdims=True)
    around = _unit(cosine * outward - along)
    touches = np.linalg.norm(offsets, axis=-1) <= reach
    side = cosine[..., 0]
    regions = {
        "away from it": ~touches,
        "in front": touches & (side > ASIDE),
        "beside": touches & (np.abs(side) <= ASIDE),
        "behind": touches & (side < -ASIDE),
    }
    return Places(regions, along, around)


def _unit(vectors: Double) -> Double:
    lengths = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.asarray(vectors / np.maximum(lengths, 1e-9))


def watched(spec: TaskSpec, policies: Sequence[Policy], n_episodes: int) -> tuple[Double, Double]:
    """States of the first policy's steps [B, S], and the commands of all there [P, B, N, 2]."""
    team = Watched(policies[0], policies[1:])
    env = make_env(spec, n_episodes)
    with closing(env):
        for _ in rollout(env, team, block_seeds("validation", n_episodes)):
            pass
    return np.concatenate(team.states), np.concatenate(team.commands, axis=1).astype(np.float64)


def shares(found: Places, commands: Double) -> Double:
    """Parts along and around, [2, regions, P]: of the clone, and of differences to it."""
    vectors = np.concatenate([commands[:1], commands[1:] - commands[:1]])
    parts = [(vectors * way).sum(-1) for way in (found.along, found.around)]
    return np.array([[p[:, rows].mean(-1) for rows in found.regions.values()] for p in parts])


def reach_of(spec: TaskSpec) -> float:
    """The distance of centres (m) up to which a robot touches the payload, a disc."""
    payload = spec.rules.model_dump()["payload"]
    assert payload["shape"] == "circle", payload
    return float(payload["half_length"] + spec.robots[0].radius + CONTACT)


HEAD = ("policy", "away from it", "in front", "beside", "behind")

INTRO = f"""Commands of clones (`{CLONE}`) of `{DATASET}` in the steps of {N_EPISODES} validation
episodes, and in the same states the differences of other policies' commands to them, in units of
the largest command: their part along the payload's way to its goal, and their part around the
payload, towards the side from which it can be pushed there. Robots within {100 * CONTACT:.0f} cm of
the payload are in front of it, on the goal's side, beside it or behind it; others are away
from it. Means over 5 seeds, along and around, bold where all seeds have one sign (`python -m
tests.benchmarks.bench_detours`).
"""


def shown(values: Double) -> str:
    """The mean of the seeds' values [K], bold if all have one sign."""
    text = f"{values.mean():+.3f}"
    return f"**{text}**" if abs(np.sign(values).sum()) == len(values) else text


def main() -> None:
    """Measures the policies of the study in a folder."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("--runs", type=Path, default=Path("runs/study-regimes"))
    options = parser.parse_args()
    spec = swarmdata.load(DATASET).spec
    assert isinstance(spec, TaskSpec)
    names = (CLONE, *OTHERS)
    folders = [options.runs / "cells" / name / DATASET / name for name in names]
    found = []  # [K, 2, regions, P]
    for policies in zip(*map(load_run, folders), strict=True):
        states, commands = watched(spec, policies, N_EPISODES)
        found.append(shares(places(states, commands.shape[2], reach_of(spec)), commands))
    values = np.array(found)
    rows = []
    for p, name in enumerate(names):
        cells = [", ".join(map(shown, values[:, :, r, p].T)) for r in range(values.shape[2])]
        rows.append((f"`{name}`" if p == 0 else f"`{name}` − `{CLONE}`", *cells))
    write_section("Where policies push", f"{INTRO}\n{table(HEAD, rows)}")


if __name__ == "__main__":
    main()
