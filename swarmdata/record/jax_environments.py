"""Records a policy in many copies of a JAX environment: JaxMARL's, and CAMAR.

Episodes are played whole, by one compiled `scan` over the steps of all copies, and cut where they
ended. JaxMARL's `step` resets a copy that has ended and returns the first observation of the next
episode; `step_env`, which is used here, returns the last one of this episode.

Rutherford et al., "JaxMARL: Multi-Agent RL Environments and Algorithms in JAX", NeurIPS 2024;
Pshenitsyn et al., "CAMAR: Continuous Actions Multi-Agent Routing", AAAI 2026.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmdata.datasets.dataset import Dataset
from swarmdata.errors import SchemaError, SpecError
from swarmdata.record.batch_recording import check_request, played_episode, record_batches
from swarmdata.record.recording_description import (
    clean_name,
    foreign_spec,
    library_of,
    make_recording,
)
from swarmdata.record.recording_folder import Limits
from swarmdata.record.reset_seeds import SeedStream, default_seed
from swarmdata.specs.origins import RecordedAgent
from swarmdata.specs.recipe import PolicySource, Splits
from swarmdata.specs.spaces import BoxSpace, Space, common_bound, space_of, stack_agents
from swarmdata.types import Bool, Episode, Float

JaxPolicy = Callable[[Any, Any], Any]
"""Maps a random key and the observations of one copy, as the environment gives them, to the
actions that it takes. It is compiled, for all copies at once."""


def record_jax(
    env: Any,
    policy: JaxPolicy,
    n_episodes: int,
    *,
    id: str,
    path: Path | str,
    n_copies: int = 64,
    task: str | None = None,
    horizon: int | None = None,
    solved: Callable[[Any], Any] | None = None,
    policies: Sequence[str | PolicySource] = ("mine",),
    options: Mapping[str, Any] | None = None,
    metadata: Mapping[str, str] | None = None,
    seed: int | None = None,
    splits: Splits | None = None,
    limits: Limits | None = None,
) -> Dataset:
    """Plays episodes in copies of a JAX environment and makes a dataset of them.

    `env` is of JaxMARL (`reset`, `step_env`, dictionaries by agent), or like CAMAR's (`reset` and a
    `step` that resets nothing, arrays with an agent axis). An episode follows from its seed. After
    a kill, a call with the same arguments continues the recording. States are the numbers in the
    environment's state, without random keys; `options` of the spec names them in order. Masks of
    actions are not recorded.

    Args:
        env: the environment, not wrapped.
        policy: acts in every copy.
        n_episodes: number of episodes of the dataset.
        id: id of the dataset, `<task>[-<variant>]-<name>-v<k>`.
        path: folder of the dataset, which must not exist.
        n_copies: episodes that are played at the same time.
        task: name of the environment; by default that of its class.
        horizon: most steps of an episode. JAX environments do not tell truncation from termination:
            an end after so many steps is a truncation unless the task was solved. By default the
            environment's `max_steps`, or one more if some of the first `n_copies` episodes last so
            long, which is how JaxMARL's MPE and CAMAR count.
        solved: whether a task is solved in a state, for one copy; by default CAMAR's `on_goal` of
            all agents, and nothing for JaxMARL.
        policies: label or description of the policy.
        options: JSON values that the environment was made with.
        metadata: information for readers, such as `author`, `license`, `description` and `code`.
        seed: seed of the splits and resets; by default derived from `id`.
        splits: how many episodes are held out.
        limits: when finished episodes are written.

    Raises:
        SpecError: the environment is of neither kind, cannot be stored, or has no known horizon.
        SchemaError: an episode is longer than the horizon, or a value is not finite.
        BuildError: `path` exists, or another process is recording to it.
    """
    check_request(path, policies)
    seed = default_seed(id) if seed is None else seed
    world = _world_of(env, horizon, solved)
    player = _Player(world, policy, horizon or world.n_steps)
    if horizon is None:
        first = SeedStream(seed, set())
        played = player.play([first.draw() for _ in range(n_copies)])
        player.horizon -= max(map(len, played)) < world.n_steps  # none needs the last step
    (library, version), columns = library_of(env), player.state_columns()
    spec = foreign_spec(
        task or clean_name(type(env).__name__), {**(options or {}), "state": columns},
        agents=world.agents, library=library, version=version, horizon=player.horizon,
        state_size=sum(map(math.prod, columns.values())), state_from="environment",
    )  # fmt: skip
    recording = make_recording(spec, id, policies, metadata, seed, splits)

    return record_batches(
        recording, path, n_episodes, limits,
        play=lambda seeds: player.play([seeds.draw() for _ in range(n_copies)]),
    )  # fmt: skip


@dataclass(frozen=True, slots=True)
class _World:
    """What both kinds of environments have in common; functions are of one copy."""

    agents: tuple[RecordedAgent, ...]
    n_steps: int  # in which every episode ends
    reset: Callable[[Any], tuple[Any, Any]]  # key -> observations, state
    step: Callable[[Any, Any, Any], tuple[Any, Any, Any, Any]]
    """Key, state, actions -> observations, state, rewards, and which agents and the team ended."""
    by_agent: Callable[[Any], list[NDArray[Any]]]  # observations or actions -> of each agent
    solved: Callable[[Any], Any] | None  # state -> whether the task is solved


def _world_of(env: Any, horizon: int | None, solved: Callable[[Any], Any] | None) -> _World:
    is_jaxmarl = hasattr(env, "step_env")
    if not is_jaxmarl and not hasattr(env, "map_generator"):
        raise SpecError(
            f"{env} is neither an environment of JaxMARL (it has no step_env) nor of CAMAR (it has "
            "no map_generator), or is wrapped; pass the environment itself"
        )
    most: int | None = getattr(env, "max_steps", None)
    n_steps = horizon if most is None or horizon is not None else most + 1
    if n_steps is None:
        raise SpecError(f"{env} has no max_steps; pass the most steps of an episode as `horizon`")
    return (_jaxmarl if is_jaxmarl else _camar)(env, int(n_steps), solved)


def _jaxmarl(env: Any, n_steps: int, solved: Callable[[Any], Any] | None) -> _World:
    names = tuple(env.agents)
    agents = tuple(
        RecordedAgent(
            name=name,
            observation=_space(env.observation_space(name), f"observation space of {name}"),
            action=_space(env.action_space(name), f"action space of {name}"),
        )
        for name in names
    )

    def step(key: Any, state: Any, actions: Any) -> tuple[Any, Any, Any, Any]:
        observations, state, rewards, ended, _ = env.step_env(key, state, actions)
        flags = [ended[name] for name in (*names, "__all__")]
        return observations, state, [rewards[name] for name in names], flags

    return _World(agents, n_steps, env.reset, step, lambda given: [given[n] for n in names], solved)


def _camar(env: Any, n_steps: int, solved: Callable[[Any], Any] | None) -> _World:
    n_agents = int(env.num_agents)
    observation = BoxSpace(shape=(int(env.observation_size),), dtype="float32")
    action = BoxSpace(shape=(int(env.action_size),), dtype="float32", low=-1.0, high=1.0)
    agents = tuple(
        RecordedAgent(name=f"agent_{k}", observation=observation, action=action)
        for k in range(n_agents)
    )

    def step(key: Any, state: Any, actions: Any) -> tuple[Any, Any, Any, Any]:
        observations, state, rewards, ended, _ = env.step(key, state, actions)
        flags = [ended] * (n_agents + 1)
        return observations, state, [rewards[k, 0] for k in range(n_agents)], flags

    def split(given: Any) -> list[NDArray[Any]]:
        return [given[..., k, :] for k in range(n_agents)]

    at_goal = solved or (lambda state: state.on_goal.all())
    return _World(agents, n_steps, env.reset, step, split, at_goal)


def _space(space: Any, where: str) -> Space:
    """A space of JaxMARL; the bounds of its boxes may be numbers, and their dtypes are JAX's."""
    if type(space).__name__ != "Box":
        return space_of(space, where)
    low, high = (np.broadcast_to(each, space.shape) for each in (space.low, space.high))
    dtype = np.dtype(space.dtype).name
    return BoxSpace(
        shape=tuple(space.shape), dtype=dtype, low=common_bound(low), high=common_bound(high)
    )


class _Player:
    def __init__(self, world: _World, policy: JaxPolicy, horizon: int) -> None:
        import jax  # noqa: PLC0415  (the user's environment has it)

        self._world, self._policy, self.horizon = world, policy, horizon
        self._play = jax.jit(jax.vmap(self._one))

    def _one(self, seed: Any) -> Any:
        """An episode of `n_steps` steps, which goes on after its end: T first."""
        import jax  # noqa: PLC0415
        import jax.numpy as jnp  # noqa: PLC0415

        world = self._world
        key_reset, key_steps = jax.random.split(jax.random.PRNGKey(seed))
        observations, state = world.reset(key_reset)

        def step(now: Any, key: Any) -> Any:
            observations, state = now
            key_policy, key_step = jax.random.split(key)
            actions = self._policy(key_policy, observations)
            *after, rewards, ended = world.step(key_step, state, actions)
            is_solved = False if world.solved is None else world.solved(after[1])
            return tuple(after), (*after, actions, jnp.stack(rewards), jnp.stack(ended), is_solved)

        keys = jax.random.split(key_steps, world.n_steps)
        _, (*rest, actions, rewards, ended, is_solved) = jax.lax.scan(
            step, (observations, state), keys
        )
        shown = [
            jax.tree.map(lambda first, later: jnp.concatenate([first[None], later]), *both)
            for both in zip(jax.tree.map(jnp.asarray, (observations, state)), rest, strict=True)
        ]
        return shown[0], _numbers(shown[1]), actions, rewards, ended, is_solved

    def state_columns(self) -> dict[str, list[int]]:
        """Shape of each part of a state, in the order of its columns."""
        import jax  # noqa: PLC0415

        states = jax.eval_shape(self._one, np.int32(0))[1]
        return {name: list(leaf.shape[1:]) for name, leaf in states.items()}

    def play(self, seeds: Sequence[int]) -> list[Episode]:
        """One episode of each seed; SchemaError if one is longer than the horizon."""
        import jax  # noqa: PLC0415

        played = jax.tree.map(np.asarray, self._play(np.array(seeds, np.int32)))
        shown, states, actions, *results = played
        by_agent = [
            stack_agents([_rows(each) for each in self._world.by_agent(given)])
            for given in (shown, actions)
        ]
        numbers = np.concatenate([_rows(each) for each in states.values()], axis=-1)
        return [
            self._episode(
                seed, *(each[copy] for each in (*by_agent, numbers.astype(np.float32), *results))
            )
            for copy, seed in enumerate(seeds)
        ]

    def _episode(
        self, seed: int, observations: Float, actions: Float, states: Float, rewards: Float,
        ended: Bool, is_solved: Bool,
    ) -> Episode:  # fmt: skip
        """An episode up to its end, of which the arrays hold more."""
        horizon, N = self.horizon, len(self._world.agents)
        if not ended[:horizon, N].any():
            raise SchemaError(
                f"the episode of seed {seed} has not ended after {horizon} steps; pass the most "
                "steps of an episode as `horizon`"
            )
        T = int(np.argmax(ended[:, N])) + 1
        success = bool(is_solved[T - 1])
        is_cut = not success and horizon == T
        unsolved = "ended" if self._world.solved is None else "failure"
        return played_episode(
            seed, observations[: T + 1], states[: T + 1], actions[:T], rewards[:T], ended[:T, :N],
            is_cut=is_cut, reason="success" if success else "horizon" if is_cut else unsolved,
        )  # fmt: skip


def _numbers(state: Any) -> dict[str, Any]:
    """The numbers in states [T + 1, ...] by the names of their fields, without random keys.

    Keys of the old kind are arrays of two or four uint32.
    """
    import jax  # noqa: PLC0415

    leaves, _ = jax.tree_util.tree_flatten_with_path(state)
    return {
        jax.tree_util.keystr(path).lstrip("."): leaf
        for path, leaf in leaves
        if not jax.dtypes.issubdtype(leaf.dtype, jax.dtypes.prng_key)
        and not (leaf.dtype == np.uint32 and leaf.shape[1:] in ((2,), (4,)))
    }


def _rows(values: NDArray[Any]) -> NDArray[Any]:
    """An array [E, T, ...] as rows [E, T, F]."""
    rows = values.reshape(*values.shape[:2], -1)
    return rows if rows.dtype == np.uint8 else rows.astype(np.float32)
