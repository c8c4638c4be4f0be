"""Records a policy in all copies of a VMAS environment.

VMAS (Bettini et al., "VMAS: A Vectorized Multi-Agent Simulator for Collective Robot Learning",
DARS 2022) steps many copies at once and seeds them together: a copy's episode follows from the seed
of the reset and the number of copies. An episode's seed here is `reset seed * copies + copy`.
"""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from swarmdata.datasets.dataset import Dataset
from swarmdata.errors import SpecError
from swarmdata.record.agent_reader import SUCCESS_KEYS, combine_outcomes
from swarmdata.record.batch_recording import check_request, played_episode, record_batches
from swarmdata.record.episode_buffer import Outcome
from swarmdata.record.recording_description import (
    clean_name,
    foreign_spec,
    library_version,
    make_recording,
)
from swarmdata.record.recording_folder import Limits
from swarmdata.record.reset_seeds import SeedStream
from swarmdata.specs.origins import RecordedAgent, RecordedSpec
from swarmdata.specs.recipe import PolicySource, Splits
from swarmdata.specs.spaces import BoxSpace, flatten, space_of, stack_agents, width
from swarmdata.types import Bool, Episode, Float

VmasPolicy = Callable[[Any], Any]
"""Maps VMAS's observations, a list or dictionary of tensors [E, ...], to actions of all agents, a
list or dictionary of tensors [E, A]."""


def record_vmas(
    env: Any,
    policy: VmasPolicy,
    n_episodes: int,
    *,
    id: str,
    path: Path | str,
    task: str | None = None,
    policies: Sequence[str | PolicySource] = ("mine",),
    options: Mapping[str, Any] | None = None,
    metadata: Mapping[str, str] | None = None,
    seed: int | None = None,
    splits: Splits | None = None,
    limits: Limits | None = None,
) -> Dataset:
    """Plays episodes in all copies of a VMAS environment at once and makes a dataset of them.

    Copies that end early wait for the others. After a kill, a call with the same arguments
    continues the recording. States are the concatenated observations, because VMAS has no state.

    Args:
        env: `vmas.make_env(..., max_steps=T, terminated_truncated=True)`; its copies are reset.
        policy: acts in all copies.
        n_episodes: number of episodes of the dataset.
        id: id of the dataset, `<task>[-<variant>]-<name>-v<k>`.
        path: folder of the dataset, which must not exist.
        task: name of the scenario; by default that of its file.
        policies: label or description of the policy.
        options: JSON values that the environment was made with.
        metadata: information for readers, such as `author`, `license`, `description` and `code`.
        seed: seed of the splits and resets; by default derived from `id`.
        splits: how many episodes are held out.
        limits: when finished episodes are written.

    Raises:
        SpecError: the environment does not tell truncation from termination, or cannot be stored.
        SchemaError: a value is not finite or has the wrong shape.
        BuildError: `path` exists, or another process is recording to it.
    """
    check_request(path, policies)
    spec = _spec_of(env, task, options)
    recording = make_recording(spec, id, policies, metadata, seed, splits)

    def play(seeds: SeedStream) -> list[Episode]:
        return _play(env, policy, spec, seeds.draw())

    def drawn(recorded: set[int]) -> set[int]:
        counts = Counter(seed // int(env.num_envs) for seed in recorded)
        return {seed for seed, n in counts.items() if n == int(env.num_envs)}  # of all copies

    return record_batches(recording, path, n_episodes, limits, play, drawn)


def _spec_of(env: Any, task: str | None, options: Mapping[str, Any] | None) -> RecordedSpec:
    if env.max_steps is None or not env.terminated_truncated:
        raise SpecError(
            f"the VMAS environment has max_steps={env.max_steps} and "
            f"terminated_truncated={env.terminated_truncated}: make it with max_steps=T and "
            "terminated_truncated=True. Otherwise truncations look like terminations, and values "
            "would not be bootstrapped where they must be."
        )
    agents = []
    for index, agent in enumerate(env.agents):
        key = agent.name if env.dict_spaces else index
        observation = space_of(env.observation_space[key], f"observation space of {agent.name}")
        action = space_of(env.action_space[key], f"action space of {agent.name}")
        content = {"name": agent.name, "observation": observation, "action": action}
        agents.append(RecordedAgent.parse(content, "the scenario"))
    # VMAS loads scenarios from files, without a module's name
    file = Path(type(env.scenario).make_world.__code__.co_filename)
    return foreign_spec(
        task or clean_name(file.stem),
        {"num_envs": env.num_envs, **(options or {})},  # episodes depend on both
        agents=tuple(agents),
        library="vmas",
        version=library_version("vmas"),
        horizon=env.max_steps,
        state_size=sum(width(agent.observation) for agent in agents),
    )


def _play(env: Any, policy: VmasPolicy, spec: RecordedSpec, seed: int) -> list[Episode]:
    """Plays one episode in each copy, from one reset."""
    E, N = env.num_envs, spec.n_agents
    alive, lengths = np.ones(E, np.bool_), np.zeros(E, np.int64)
    observations = env.reset(seed=seed)
    seen, actions_taken, paid = [_rows_by_agent(spec, observations, "observation", E)], [], []
    ends = [(False, "")] * E  # whether it was cut, and why it ended
    while alive.any():
        actions = policy(observations)
        # copied before the environment can change them
        actions_taken.append(stack_agents(_rows_by_agent(spec, actions, "action", E)))
        observations, rewards, terminated, truncated, infos = env.step(actions)
        seen.append(_rows_by_agent(spec, observations, "observation", E))
        paid.append(stack_agents(_rows_by_agent(spec, rewards, "reward", E))[..., 0])
        ended, cut = _flags(terminated, E), _flags(truncated, E)
        lengths += alive
        for copy in np.flatnonzero(alive & (ended | cut)).tolist():
            outcome, is_cut = _outcome(infos, copy), bool(not ended[copy])
            unsolved = "horizon" if is_cut else outcome or "ended"
            ends[copy] = is_cut, "success" if outcome == "success" else unsolved
        alive &= ~ended & ~cut
    observed = np.stack([stack_agents(rows) for rows in seen], 1)  # [E, T + 1, N, O]
    states = np.stack([np.concatenate(rows, axis=1) for rows in seen], 1)
    taken, rewarded = np.stack(actions_taken, 1), np.stack(paid, 1)
    return [
        played_episode(
            seed * E + copy, observed[copy, : T + 1], states[copy, : T + 1], taken[copy, :T],
            rewarded[copy, :T], np.zeros((T, N), np.bool_), is_cut=is_cut, reason=reason,
        )
        for copy, (T, (is_cut, reason)) in enumerate(zip(lengths.tolist(), ends, strict=True))
    ]  # fmt: skip


def _rows_by_agent(spec: RecordedSpec, given: Any, what: str, n_copies: int) -> list[Float]:
    """Copies of each agent's values as rows, [E, F_i]."""
    values = [given[agent.name] for agent in spec.agents] if isinstance(given, dict) else given
    number = BoxSpace(shape=(1,), dtype="float32")  # of a reward
    return [
        flatten(
            getattr(agent, what, number), _arrays(value), f"{what} of {agent.name}", (n_copies,)
        )
        for agent, value in zip(spec.agents, values, strict=True)
    ]


def _arrays(value: Any) -> Any:
    """Tensors [E, ...], or dictionaries of them, as arrays."""
    if isinstance(value, dict):
        return {key: _arrays(each) for key, each in value.items()}
    return np.asarray(value.detach().cpu().numpy() if hasattr(value, "detach") else value)


def _flags(tensor: Any, n_copies: int) -> Bool:
    flags: Bool = _arrays(tensor).reshape(n_copies).astype(np.bool_)
    return flags


def _outcome(infos: Any, copy: int) -> Outcome:
    return combine_outcomes(
        bool(_arrays(info[key])[copy].all())
        for info in (infos.values() if isinstance(infos, dict) else infos)
        for key in SUCCESS_KEYS
        if key in info
    )
