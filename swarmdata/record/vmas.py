"""Records a policy in all copies of a VMAS environment.

VMAS (Bettini et al., "VMAS: A Vectorized Multi-Agent Simulator for Collective Robot Learning",
DARS 2022) steps many copies at once and seeds them together: a copy's episode follows from the seed
of the reset and the number of copies. An episode's seed here is `reset seed * copies + copy`.
"""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmdata.datasets.dataset import Dataset
from swarmdata.errors import BuildError, SchemaError, SpecError
from swarmdata.record.episode_buffer import Outcome, StateRow, StepRow, Tape
from swarmdata.record.foreign_environment import clean_name, library_version
from swarmdata.record.recording_description import foreign_spec, recording_of
from swarmdata.record.reset_seeds import SeedStream, default_seed
from swarmdata.record.row_reader import SUCCESS
from swarmdata.record.session import Limits, RecordingFolder, Session
from swarmdata.specs.gymnasium_spaces import space_of
from swarmdata.specs.origins import RecordedAgent, RecordedSpec
from swarmdata.specs.recipe import PolicySource, Splits
from swarmdata.specs.spaces import width
from swarmdata.types import Bool, Float, no_messages

Policy = Callable[[Any], Any]
"""Observations as VMAS gives them, a list or dictionary of tensors [E, ...], to actions of all
agents, a list or dictionary of tensors [E, A]."""


def record_vmas(
    env: Any,
    policy: Policy,
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

    Copies that end early wait for the others. Killed and called again with the same arguments, it
    goes on. States are all observations in one: VMAS has no state.

    Args:
        env: `vmas.make_env(..., max_steps=T, terminated_truncated=True)`; its copies are reset.
        policy: acts in all copies.
        n_episodes: of the dataset.
        id: of the dataset: `<task>[-<variant>]-<name>-v<k>`.
        path: the dataset's folder, which must not exist.
        task: name of the scenario; by default that of its file.
        policies: one label, or more about the policy.
        options: that the environment was made with, JSON values.
        metadata: what readers should know: `author`, `license`, `description`, `code` and others.
        seed: of the splits and the resets; by default one that follows from `id`.
        splits: how many episodes are held out.
        limits: of what may be lost when the process is killed.

    Raises:
        SpecError: the environment does not tell its horizon from its end, or cannot be stored.
        SchemaError: a value that is not finite, or of the wrong shape.
        BuildError: `path` exists, or another process records to it.
    """
    if Path(path).exists():
        raise BuildError(f"{path} exists. Record to another path, or delete it.")
    if len(policies) != 1:
        raise SpecError(f"policies are {policies}, expected one: record_vmas plays one policy")
    spec = _spec_of(env, task, options)
    seed = default_seed(id) if seed is None else seed
    recording = recording_of(spec, id, policies, metadata, seed, splits or Splits())
    folder = RecordingFolder(Path(path), limits)
    try:
        folder.claim(Session(recording=recording, log_probs=False, masks=False))
        seeds = SeedStream(seed, {value // env.num_envs for value in folder.seeds()})
        while (missing := n_episodes - folder.n_episodes) > 0:
            for episode in _play(env, policy, spec, seeds.draw())[:missing]:
                folder.add(episode)
        return folder.finish()
    finally:
        folder.release()


def _spec_of(env: Any, task: str | None, options: Mapping[str, Any] | None) -> RecordedSpec:
    if env.max_steps is None or not env.terminated_truncated:
        raise SpecError(
            f"the VMAS environment has max_steps={env.max_steps} and "
            f"terminated_truncated={env.terminated_truncated}: make it with max_steps=T and "
            "terminated_truncated=True. Otherwise nobody can tell its horizon from an end, and "
            "values would not be bootstrapped where they must be."
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
    name = task or clean_name(file.stem)
    settings = {"num_envs": env.num_envs, **(options or {})}  # on which episodes depend
    spec = foreign_spec(agents, name, "vmas", library_version("vmas"), settings, env.max_steps)
    size = sum(width(agent.observation) for agent in agents)
    return spec.model_copy(update={"state_size": size})


def _play(env: Any, policy: Policy, spec: RecordedSpec, seed: int) -> list[Any]:
    """One episode of each copy, from one reset."""
    E = env.num_envs
    alive = np.ones(E, np.bool_)
    given = env.reset(seed=seed)
    layout = np.zeros((0, 8), np.float32)
    first = _states(spec, given, alive)
    tapes = [Tape(seed * E + copy, 0, layout, [first[copy]]) for copy in range(E)]
    outcomes: list[Outcome] = [None] * E
    while alive.any():
        actions = policy(given)
        taken = _joined(spec, actions, "action")  # a copy, before the environment has them
        given, rewards, terminated, truncated, infos = env.step(actions)
        ended, cut = _flags(terminated, E), _flags(truncated, E)
        reached = _states(spec, given, alive & ~ended & ~cut)
        paid = _joined(spec, rewards, "reward")
        for copy in np.flatnonzero(alive).tolist():
            step = _step_of(taken[copy], paid[copy], ended[copy], cut[copy])
            tapes[copy].add(step, reached[copy])
            if ended[copy] or cut[copy]:
                outcomes[copy] = _outcome(infos, copy)
        alive &= ~ended & ~cut
    return [tape.episode(outcome) for tape, outcome in zip(tapes, outcomes, strict=True)]


def _step_of(actions: Float, rewards: Float, is_ended: bool, is_cut: bool) -> StepRow:
    N = len(actions)
    return StepRow(
        actions=actions,
        log_probs=np.zeros(0, np.float32),
        rewards=rewards[:, 0],
        terminations=np.full(N, is_ended),
        truncations=np.full(N, is_cut and not is_ended),
        events=np.zeros((N, 0), np.uint8),
    )


def _states(spec: RecordedSpec, given: Any, alive: Bool) -> list[StateRow]:
    """What every copy has reached."""
    plain = _by_agent(spec, given, "observation")
    rows, states = _stacked(plain), np.concatenate(plain, axis=1)
    there = np.repeat(alive[:, None], spec.n_agents, axis=1)
    return [
        StateRow(rows[copy], states[copy], there[copy], None, **no_messages(spec.n_agents))
        for copy in range(len(alive))
    ]


def _joined(spec: RecordedSpec, given: Any, what: str) -> Float:
    """Values of all agents, padded to the widest, [E, N, F]."""
    return _stacked(_by_agent(spec, given, what))


def _stacked(plain: Sequence[Float]) -> Float:
    """Rows of each agent, [E, F_i], as [E, N, F]."""
    widest = max(rows.shape[1] for rows in plain)
    stacked = np.zeros((len(plain[0]), len(plain), widest), np.float32)
    for index, rows in enumerate(plain):
        stacked[:, index, : rows.shape[1]] = rows
    return stacked


def _by_agent(spec: RecordedSpec, given: Any, what: str) -> list[Float]:
    """Rows of each agent, [E, F_i], as new arrays; checked against the agent's space.

    Raises:
        SchemaError: of another width, or not finite.
    """
    values = [given[agent.name] for agent in spec.agents] if isinstance(given, dict) else given
    found = []
    for agent, value in zip(spec.agents, values, strict=True):
        rows = _numbers(value)
        sizes = {"observation": agent.observation, "action": agent.action}
        expected = width(sizes[what]) if what in sizes else 1
        if rows.shape[1] != expected or not np.isfinite(rows).all():
            raise SchemaError(
                f"{what}s of {agent.name} have shape {rows.shape} and "
                f"{int((~np.isfinite(rows)).sum())} values that are not finite, expected "
                f"[copies, {expected}] and none"
            )
        found.append(rows)
    return found


def _numbers(value: Any) -> Float:
    """A tensor [E, ...], or a dictionary of such in the order of its sorted keys, as [E, F]."""
    if isinstance(value, dict):
        return np.concatenate([_numbers(value[key]) for key in sorted(value)], axis=1)
    array: NDArray[Any] = _array(value)
    return array.reshape(len(array), -1).astype(np.float32)


def _array(tensor: Any) -> NDArray[Any]:
    return np.asarray(tensor.detach().cpu().numpy() if hasattr(tensor, "detach") else tensor)


def _flags(tensor: Any, n_copies: int) -> Bool:
    return _array(tensor).reshape(n_copies).astype(np.bool_)


def _outcome(infos: Any, copy: int) -> Outcome:
    """What the infos say of one copy, as `reading.Reader.outcome`."""
    each = infos.values() if isinstance(infos, dict) else infos
    said = [bool(_array(info[key])[copy].all()) for info in each for key in SUCCESS if key in info]
    return None if not said else "success" if all(said) else "failure"
