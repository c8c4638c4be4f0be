"""Mixture: several datasets of one spec as one, of which batches hold chosen parts."""

import hashlib
import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, replace
from itertools import chain
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmdata.datasets.normalization import Moments
from swarmdata.datasets.sampling import BatchStream, RowSampler
from swarmdata.datasets.views import Choice, TrainingData, View
from swarmdata.errors import SchemaError, SpecError, UnknownNameError
from swarmdata.interfaces import VecEnv
from swarmdata.numerics.random import derive, uniform
from swarmdata.registry.published import Reference
from swarmdata.specs.origins import Spec
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Batch, Bool, Double, Episode, Int, Seeds, Wanted, shortened

ENDS = frozenset({"rewards", "terminations", "truncations"})
"""Fields that say who acts where no agent leaves before its team; rewards, how many agents."""

LONGEST_ID = 96  # characters of a mixture's id, which is part of the names of result files


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Mixture(TrainingData["MixtureSampler"]):
    """Datasets of one spec, each with the probability that a row of a batch comes from it.

    It has what training needs of a `Dataset`: `moments` are those of rows that are drawn so, and
    `id`, `digest` and `view` say what was mixed, and how.
    """

    parts: tuple[View[Any], ...]  # the datasets; none is empty
    weights: tuple[float, ...]  # probabilities of the parts, which sum to 1

    @property
    def id(self) -> str:
        """The ids of the parts, such as `coop_nav-medium-v1+coop_nav-expert-v1`."""
        return "+".join(part.id for part in self.parts)

    @property
    def digest(self) -> str:
        """SHA-256 of the parts' digests and weights, hex."""
        return hashlib.sha256(self.view.encode()).hexdigest()

    @property
    def view(self) -> str:
        """Canonical JSON of the weights, digests and views of the parts."""
        parts = [
            {"id": part.id, "digest": part.digest, "view": part.view, "weight": weight}
            for part, weight in zip(self.parts, self.weights, strict=True)
        ]
        return json.dumps({"mixture": parts}, sort_keys=True, separators=(",", ":"))

    @property
    def spec(self) -> Spec:
        """What was recorded in all parts."""
        return self.parts[0].spec

    @property
    def own_spec(self) -> Spec:
        """What was recorded, with the models of the first part."""
        return self.parts[0].own_spec

    @property
    def task(self) -> TaskSpec:
        """The task that was recorded, as `Dataset.task`."""
        return self.parts[0].task

    @property
    def references(self) -> Reference | None:
        """Anchors of the normalized score, if known."""
        return self.parts[0].references

    @property
    def n_episodes(self) -> int:
        """Episodes of all parts."""
        return len(self)

    @property
    def n_steps(self) -> int:
        """Joint steps of all parts."""
        return sum(part.n_steps for part in self.parts)

    @property
    def moments(self) -> Moments:
        """Moments of observations and rewards over rows that are drawn with the weights."""
        found = [part.moments for part in self.parts]
        means = np.stack([s.observation_mean for s in found])
        stds = np.stack([s.observation_std for s in found])
        observation_mean, observation_std = _mixed(means, stds, self.weights)
        rewards = (
            np.array([[s.reward_mean] for s in found]),
            np.array([[s.reward_std] for s in found]),
        )
        (reward_mean,), (reward_std,) = _mixed(*rewards, self.weights)
        return Moments(observation_mean, observation_std, float(reward_mean), float(reward_std))

    def __len__(self) -> int:
        return sum(map(len, self.parts))

    def __iter__(self) -> Iterator[Episode]:
        return (episode for part in self.parts for episode in part)

    def __repr__(self) -> str:
        parts = zip(self.weights, self.parts, strict=True)
        named = ", ".join(f"{weight:.3g} {part.id}" for weight, part in parts)
        return shortened(
            f"<Mixture of {named}: {len(self):,} episodes, {self.n_steps:,} steps, "
            f"{self.spec.n_agents} agents>"
        )

    def step_weights(self) -> Double:
        """Returns how much a step of each episode counts, [n]: on average 1."""
        shares = [
            w * self.n_steps / p.n_steps for w, p in zip(self.weights, self.parts, strict=True)
        ]
        return np.repeat(shares, [len(part) for part in self.parts])

    def read(self, *names: str) -> Iterator[tuple[NDArray[Any], ...]]:
        return chain.from_iterable(part.read(*names) for part in self.parts)

    def side(self, name: str) -> "Mixture":
        """The same mixture with the agents of one side alone; raises as `Dataset.side` does."""
        return replace(self, parts=tuple(part.side(name) for part in self.parts))

    def _chosen(self, choice: Choice) -> "Mixture":
        found, unknown = [], []
        for part in self.parts:
            try:
                found.append(part._chosen(choice))
            except UnknownNameError as error:  # such as a policy of the other parts
                unknown.append(error)
                found.append(part[:0])
        if len(unknown) == len(self.parts):
            raise unknown[0]
        kept = [(p, w) for p, w in zip(found, self.weights, strict=True) if len(p)]
        if not kept:
            returns = np.concatenate([part.episodes.team_return for part in self.parts])
            raise SchemaError(
                f"no episode of {self.id} is left; their team returns are {returns.min():.6g} to "
                f"{returns.max():.6g}. Widen the filter."
            )
        return Mixture(tuple(p for p, _ in kept), _normalized([w for _, w in kept]))

    def _sampler(self, **sizes: Any) -> "MixtureSampler":
        return MixtureSampler([part.sampler(**sizes) for part in self.parts], self.weights)

    def make_env(self, n_copies: int = 1, *, n_threads: int = 1) -> VecEnv:
        return self.parts[0].make_env(n_copies, n_threads=n_threads)

    def normalized_score(self, returns: Sequence[float] | Double | float) -> Double:
        return self.parts[0].normalized_score(returns)


class MixtureSampler(BatchStream):
    """Draws rows of several samplers.

    An index counts the rows of all parts, one after the other. The window of a streamed part moves
    with the rows that are drawn from it, so that each of its transitions is drawn once in a pass on
    average, as without the other parts.
    """

    def __init__(self, samplers: Sequence[RowSampler], weights: Sequence[float]) -> None:
        super().__init__(samplers[0].batch_size, samplers[0].seed)
        self._samplers, self._weights = tuple(samplers), tuple(weights)
        self._bounds = np.cumsum(weights)[:-1]
        self._starts = np.cumsum([0, *(each.n_rows for each in samplers)])
        self._agents_leave = any(each.agents_leave for each in samplers)
        self._lacking = {  # fields that a part has not recorded
            field
            for field, array in (("log_probs", "log_probs"), ("costs", "events"))
            if not all(each.width(array) for each in samplers)
        }
        # of each part, in the mixture
        self._first_episodes = np.cumsum([0, *(each.n_episodes for each in samplers)])
        self._dtypes = {  # of one part images may be bytes, and of another float32
            f"{prefix}{name}": np.result_type(*(each.dtype(name) for each in samplers))
            for name in ("observations", "states")
            for prefix in ("", "next_")
        }

    def _n_ahead(self) -> int:
        return 1  # windows move with each batch

    def _drawn(self, numbers: Seeds) -> Int:
        parts = np.searchsorted(self._bounds, uniform(derive(self.seed, 1, numbers)), side="right")
        places = uniform(derive(self.seed, 0, numbers))
        index = np.empty(len(numbers), np.int64)
        for part, sampler in enumerate(self._samplers):
            own, n_before = parts == part, int(int(numbers[0]) * self._weights[part])  # on average
            index[own] = self._starts[part] + sampler.pick(places[own], n_before)
        return index

    def gather(self, index: Int, wanted: Wanted = None) -> Batch:
        """Fields that a part has not recorded are None, but who acts is known of all or none."""
        if index.size and not 0 <= index.min() <= index.max() < self._starts[-1]:
            raise IndexError(
                f"index {index.min()} to {index.max()}, expected 0 to {self._starts[-1] - 1}"
            )
        parts = np.searchsorted(self._starts, index, side="right") - 1
        present = [part for part in range(len(self._samplers)) if (parts == part).any()]
        owns = [parts == part for part in present]
        batches = [
            self._gather(part, index[own], wanted) for part, own in zip(present, owns, strict=True)
        ]
        values: dict[str, Any] = {}
        for field in fields(Batch):
            found = [getattr(batch, field.name) for batch in batches]
            if field.name in self._lacking or any(each is None for each in found):
                values[field.name] = None
                continue
            dtype = self._dtypes.get(field.name, found[0].dtype)
            whole = np.empty((*index.shape, *found[0].shape[1:]), dtype)
            for own, each in zip(owns, found, strict=True):
                whole[own] = each
            values[field.name] = whole
        return Batch(**values)

    def _gather(self, part: int, index: Int, wanted: Wanted) -> Batch:
        sampler, index = self._samplers[part], index - self._starts[part]
        batch = sampler.gather(index, wanted)
        if self._agents_leave and not sampler.agents_leave:
            batch = replace(batch, **_presence(sampler.gather(index, ENDS), wanted))
        if batch.episodes is None:
            return batch
        return replace(batch, episodes=batch.episodes + self._first_episodes[part])

    def identity(self) -> dict[str, int]:
        shared = self._samplers[0].settings()
        own = {
            f"{name}_{part}": value
            for part, sampler in enumerate(self._samplers)
            for name, value in sampler.identity().items()
            if name not in shared
        }
        return shared | own


def mix(parts: Sequence[View[Any]], weights: Sequence[float] | None = None) -> Mixture:
    """Mixes datasets of one spec.

    Args:
        parts: the datasets, all in files or all streamed.
        weights: in proportion to which rows come from each; None: its number of transitions, so
            that all transitions are equally likely.

    Raises:
        SchemaError: the datasets were recorded with different specs, there are none, or one has no
            episodes.
        SpecError: there is not one positive weight for each dataset, or the ids are too long.
    """
    if not parts:
        raise SchemaError("there are no datasets to mix, expected at least one")
    if empty := [part.id for part in parts if not len(part)]:
        raise SchemaError(f"{', '.join(empty)} has no episodes to mix; widen its filter")
    first = parts[0]
    for other in parts[1:]:
        if other.spec != first.spec:
            ours, theirs = (each.spec.model_dump(mode="json") for each in (first, other))
            names = [n for n in {**ours, **theirs} if ours.get(n) != theirs.get(n)]
            raise SchemaError(
                f"{other.id} cannot be mixed with {first.id}: their specs differ in "
                f"{', '.join(names)}, expected equal ones; load both with the same observation and "
                "communication models."
            )
    found = [part.n_steps for part in parts] if weights is None else weights
    if len(found) != len(parts) or not all(0 < weight < np.inf for weight in found):
        raise SpecError(
            f"the weights of a mixture are {list(found)}, expected a positive number for each of "
            f"its {len(parts)} datasets"
        )
    mixture = Mixture(tuple(parts), _normalized(found))
    if len(mixture.id) > LONGEST_ID:
        raise SpecError(
            f"the ids of the mixture {mixture.id!r} have {len(mixture.id)} characters together, "
            f"expected at most {LONGEST_ID}; mix fewer datasets"
        )
    return mixture


def _presence(batch: Batch, wanted: Wanted) -> dict[str, Bool]:
    """The wanted fields of who acts, where all agents act until their team ends."""
    found = {
        "alive": batch.mask,
        "agent_terminations": batch.terminations,
        "next_alive": batch.mask & ~(batch.terminations | batch.truncations),
    }
    n_agents = batch.rewards.shape[-1]
    return {
        name: np.repeat(of_team[..., None], n_agents, axis=-1)
        for name, of_team in found.items()
        if wanted is None or name in wanted
    }


def _normalized(weights: Sequence[float]) -> tuple[float, ...]:
    total = sum(weights)
    return tuple(weight / total for weight in weights)


def _mixed(means: Double, stds: Double, weights: Sequence[float]) -> tuple[Double, Double]:
    """Mean and deviation of a mixture, [F], of those of its parts, [P, F]."""
    mean = np.average(means, axis=0, weights=weights)
    square = np.average(np.square(stds) + np.square(means - mean), axis=0, weights=weights)
    return mean, np.sqrt(square)
