"""Episodes of JaxMARL and CAMAR become datasets, with the last observation of each."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swarmdata.audit import audit
from swarmdata.datasets.dataset import Dataset
from swarmdata.errors import BuildError, SchemaError, SpecError
from swarmdata.record import record_jax
from swarmdata.specs.origins import RecordedSpec
from swarmdata.types import END_REASONS
from tests.record.worlds import spec_of

jax = pytest.importorskip("jax", reason="environments in JAX")
jnp = jax.numpy
pytestmark = [
    pytest.mark.slow,  # importing and compiling take seconds
    pytest.mark.filterwarnings("ignore::DeprecationWarning"),
]


def check(dataset: Dataset) -> RecordedSpec:
    assert audit(dataset.path, progress=False).problems == ()
    spec = spec_of(dataset)
    assert spec.state_from == "environment"
    return spec


class Count:
    """Of JaxMARL's kind: a counter and a hidden number. Agent `b` leaves after two steps."""

    agents, num_agents, max_steps = ("a", "b"), 2, 4

    def __init__(self, is_late: bool = False) -> None:
        self.is_late = is_late  # ends after max_steps + 1 steps, as MPE does

    def observation_space(self, agent: str) -> Any:
        return Box(-np.inf, np.inf, (3 if agent == "a" else 2,))

    def action_space(self, agent: str) -> Any:
        return Box(-1.0, 1.0, (1,))

    def reset(self, key: Any) -> tuple[Any, Any]:
        state = {"key": key, "number": jax.random.uniform(key), "step": jnp.uint32(0)}
        return self._observe(state), state

    def step_env(self, key: Any, state: Any, actions: Any) -> tuple[Any, ...]:
        state = {**state, "step": state["step"] + 1}
        over = state["step"] >= self.max_steps + self.is_late
        lucky = (state["number"] > 0.5) & (state["step"] >= 3)
        ended = {"a": over | lucky, "b": over | lucky | (state["step"] >= 2)}
        ended["__all__"] = ended["a"]
        rewards = {name: actions[name][0] + 10.0 for name in self.agents}
        return self._observe(state), state, rewards, ended, {}

    def _observe(self, state: Any) -> dict[str, Any]:
        seen = jnp.stack([state["step"] * 1.0, state["number"], state["number"] * 2])
        return {"a": seen, "b": seen[:2]}


class Box:
    """As JaxMARL's: bounds may be numbers, and the dtype is JAX's."""

    def __init__(self, low: float, high: float, shape: tuple[int, ...]) -> None:
        self.low, self.high, self.shape, self.dtype = low, high, shape, jnp.float32


def act(key: Any, observations: Any) -> dict[str, Any]:
    return {name: observations[name][1:2] / 2 for name in observations}


def record(path: Path, env: Any = None, n: int = 20, **more: Any) -> Dataset:
    more = {"task": "count", "n_copies": 8, **more}
    return record_jax(env or Count(), act, n, id="count-mine-v0", path=path, **more)


def lucky(state: Any) -> Any:
    return (state["number"] > 0.5) & (state["step"] >= 3)


def test_episodes_end_where_they_ended(tmp_path: Path) -> None:
    dataset = record(tmp_path / "ds", solved=lucky)
    spec = check(dataset)
    assert (spec.horizon, spec.state_size) == (4, 2)
    assert spec.options["state"] == {"['number']": [], "['step']": []}, "keys are no numbers"
    reasons = set()
    for episode in dataset:
        number = episode.states[0, 0]
        T = 3 if number > 0.5 else 4
        assert len(episode) == T
        np.testing.assert_array_equal(episode.observations[:, 0, 0], np.arange(T + 1))
        np.testing.assert_array_equal(episode.states[:, 1], np.arange(T + 1))
        np.testing.assert_array_equal(episode.observations[:, 1, 0], [0, 1, 2, 0, 0][: T + 1])
        np.testing.assert_allclose(episode.actions[:, 0, 0], number / 2, rtol=1e-6)
        np.testing.assert_allclose(episode.rewards[:2, 1], 10 + number / 2, rtol=1e-6)
        assert not episode.rewards[2:, 1].any()
        assert episode.alive is not None
        assert episode.agent_terminations is not None
        assert episode.alive[:, 1].tolist() == [True, True, *[False] * (T - 1)]
        assert np.flatnonzero(episode.agent_terminations[:, 1]).tolist() == [1]
        reasons.add(END_REASONS[episode.end_reason])
        assert bool(episode.truncations[-1]) == (number <= 0.5)
    assert reasons == {"success", "horizon"}


def test_the_step_after_max_steps_is_found(tmp_path: Path) -> None:
    assert check(record(tmp_path / "ds", Count(is_late=True))).horizon == 5
    with pytest.raises(SchemaError, match="has not ended after 4 steps"):
        record(tmp_path / "other", Count(is_late=True), horizon=4)


def test_an_episode_follows_from_its_seed(tmp_path: Path) -> None:
    few, many = record(tmp_path / "few"), record(tmp_path / "many", n_copies=16)
    assert few.digest == many.digest
    with pytest.raises(BuildError, match="exists"):
        record(tmp_path / "few")


def test_what_is_no_environment_is_refused(tmp_path: Path) -> None:
    with pytest.raises(SpecError, match="neither an environment of JaxMARL"):
        record(tmp_path / "ds", object())
    env = Count()
    env.max_steps = None  # type: ignore[assignment]
    with pytest.raises(SpecError, match="no max_steps"):
        record(tmp_path / "ds", env)


def test_jaxmarl(tmp_path: Path) -> None:
    jaxmarl = pytest.importorskip("jaxmarl")
    env = jaxmarl.make("MPE_simple_spread_v3", action_type="Continuous")

    def push(key: Any, observations: Any) -> Any:
        keys = jax.random.split(key, env.num_agents)
        return {name: jax.random.uniform(k, (5,)) for name, k in zip(env.agents, keys, strict=True)}

    dataset = record_jax(
        env, push, 20, id="simple_spread-mine-v0", path=tmp_path / "ds", task="simple_spread",
        n_copies=16,
    )  # fmt: skip
    spec = check(dataset)
    assert (spec.library, spec.horizon) == ("jaxmarl", env.max_steps + 1)
    assert dataset.episodes.lengths.tolist() == [26] * 20
    episode = dataset[0]
    columns = spec.options["state"]
    assert columns["p_pos"] == [6, 2]
    before = list(columns.values())[: list(columns).index("p_pos")]
    first = sum(int(np.prod(shape)) for shape in before)
    positions = episode.states[:, first : first + 12].reshape(27, 6, 2)
    np.testing.assert_allclose(episode.observations[:, 0, 2:4], positions[:, 0], rtol=1e-6)
    moved = np.abs(np.diff(positions[:, :3], axis=0)).max(axis=(1, 2))
    assert moved.max() < 0.5, "the last state is none of another episode"


def test_camar(tmp_path: Path) -> None:
    camar = pytest.importorskip("camar")
    env = camar.camar_v0(map_kwargs={"num_agents": 3}, max_steps=60)

    def drive(key: Any, observations: Any) -> Any:
        return jnp.clip(2 * observations[:, :2], -1, 1)

    dataset = record_jax(env, drive, 20, id="camar-mine-v0", path=tmp_path / "ds", n_copies=16)
    spec = check(dataset)
    assert spec.library == "camar"
    assert spec.n_agents == 3
    for episode in dataset:
        ended = END_REASONS[episode.end_reason]
        assert ended == ("success" if len(episode) < 60 else ended)
        assert bool(episode.terminations[-1]) == (ended == "success")
