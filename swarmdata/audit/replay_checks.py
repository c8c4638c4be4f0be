"""Replays logged actions in the world, and compares the result with everything stored."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from swarmdata.analysis.coverage import spread
from swarmdata.audit.findings import Remarks, note, problem
from swarmdata.audit.subject import Subject
from swarmdata.cards.references import made_with
from swarmdata.errors import SpawnError, SwarmdataError
from swarmdata.interfaces import Policy, VecEnv
from swarmdata.registry.components import make_env
from swarmdata.registry.published import changed_versions
from swarmdata.rollouts.recipe_episodes import SIMULATED_COPIES, make_source_policy
from swarmdata.rollouts.rollout import end_reasons
from swarmdata.runtime.native_libraries import ThreadLimit
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Bool, Float, Int, Step

STEP_ARRAYS = ("rewards", "reward_terms", "terminations", "truncations", "events")
"""Arrays with a row per step, in the order in which they are compared."""

STATE_ARRAYS = ("states", "observations", "sent", "delivered", "ages")
"""Arrays with a row per state."""

WITHOUT_AGENTS = ("episodes/layouts", "states")
"""Arrays without an axis of agents, among those that are compared before the first step."""

MOST_DIFFERENCES_SHOWN = 3  # differences that are described one by one


@dataclass(frozen=True, slots=True)
class Difference:
    """The first place in an episode where a stored array differs from the replay."""

    episode: int  # stored number
    step: int
    array: str
    agent: int | None  # None: the array has no agent axis
    stored: str
    replayed: str

    def __str__(self) -> str:
        agent = "" if self.agent is None else f", agent {self.agent}"
        return (
            f"episode {self.episode}, step {self.step}{agent}: {self.array} is {self.stored}, "
            f"replayed {self.replayed}"
        )


def replay(subject: Subject) -> Remarks:
    """Replayed actions give the stored arrays bit for bit, on a sample of the episodes.

    If a policy of the recipe can be built, it must choose the same actions, with the same
    log-probabilities. Such a replay finds shifted rewards (D4RL issues 158, 194), other conventions
    of rewards (199), rows that were not copied (84, 100) and swapped tiers (76).
    """
    task = subject.task
    if task is None:
        yield note("the actions of other environments cannot be replayed")
        return
    if subject.sample < 1:
        yield note("no episodes were replayed, as requested")
        return
    chosen = sample(subject)
    absent = [name for name in ("log_probs", "events") if not subject.arrays[name].size]
    if absent:
        yield note(f"{' and '.join(absent)} were not recorded, and are not compared")
    policies: dict[int, Policy | None] = {}
    for index in np.unique(subject.table.policy[chosen]).tolist():
        source = subject.origin.policies[index]
        try:
            policies[index] = make_source_policy(source, task, subject.path)
        except (SwarmdataError, TypeError) as error:  # TypeError: unknown options
            policies[index] = None
            say = note if subject.origin.recipe is None else problem  # others claim less
            yield say(f"{source.label} cannot be built, so its choices were not compared: {error}")
    yield from _report(subject, list(_replay(subject, task, chosen, policies)), len(chosen))


def sample(subject: Subject) -> Int:
    """Stored numbers of the episodes to replay: equally many of each policy, or all it has."""
    policies = np.unique(subject.table.policy)
    each = -(-subject.sample // len(policies))
    groups = [spread(np.flatnonzero(subject.table.policy == policy), each) for policy in policies]
    return np.concatenate(groups)


def _replay(
    subject: Subject, task: TaskSpec, chosen: Int, policies: Mapping[int, Policy | None]
) -> Iterator[Difference]:
    """Yields the first difference of each chosen episode, policy after policy."""
    groups = {index: chosen[subject.table.policy[chosen] == index] for index in policies}
    env = make_env(task, min(SIMULATED_COPIES, max(map(len, groups.values()))))
    total = int(subject.table.lengths[chosen].sum())
    hidden = None if subject.progress else True  # None: hidden where there is no terminal
    with tqdm(total=total, desc="replay", unit="step", leave=False, disable=hidden) as bar:
        for index, group in groups.items():
            for first in range(0, len(group), env.n_copies):
                wave = group[first : first + env.n_copies]
                yield from _Wave(subject, env, wave, policies[index]).run(bar)


class _Wave:
    """Episodes of one policy, replayed side by side; its choices are compared if it is known."""

    def __init__(self, subject: Subject, env: VecEnv, wave: Int, policy: Policy | None) -> None:
        self.subject, self.env, self.wave, self.policy = subject, env, wave, policy
        self.lengths, self.limit = subject.table.lengths[wave], ThreadLimit()
        self.known: dict[int, Difference] = {}  # the first of each episode, by position in the wave
        self.same = np.ones(len(wave), dtype=np.bool_)  # which episodes have none so far

    def run(self, bar: Any) -> Iterator[Difference]:
        """Yields the first difference of each episode."""
        seeds = np.resize(self.subject.table.seeds[self.wave], self.env.n_copies)
        try:
            step = self.env.reset(seeds)
        except SpawnError as error:
            yield Difference(int(self.wave[0]), 0, "seeds", None, "some", f"an error: {error}")
            return
        self._compare("episodes/layouts", self.wave, step.layouts, 0)
        if self.policy is not None:
            self.policy.reset(step, np.arange(self.env.n_copies))
        self._compare_state(step, 0)
        for t in range(int(self.lengths.max())):
            actions = self._actions(t)
            self._compare_policy(step, actions, t)
            step = self.env.step(actions)
            for name in filter(self.subject.arrays.__contains__, STEP_ARRAYS):
                self._compare(name, self.subject.table.starts[self.wave] + t, step, t)
            self._compare_state(step, t + 1)
            ended = self.lengths == t + 1
            self._compare("episodes/end_reason", self.wave, end_reasons(step), t, ended)
            self.subject.release()
            bar.update(int((self.lengths > t).sum()))
            if len(self.known) == len(self.wave):
                break
        yield from self.known.values()

    def _actions(self, t: int) -> Float:
        """The stored joint actions of step t, zeros in copies whose episode is over, [E, N, A]."""
        stored = self.subject.arrays["actions"]
        actions = np.zeros((self.env.n_copies, *stored.shape[1:]), dtype=np.float32)
        running = np.flatnonzero(self.lengths > t)
        rows = stored[self.subject.table.starts[self.wave[running]] + t]
        actions[running] = np.where(np.isfinite(rows), rows, 0.0)  # `finite` names the others
        return actions

    def _compare_policy(self, step: Step, actions: Float, t: int) -> None:
        if self.policy is None:
            return
        rows = self.subject.table.starts[self.wave] + t
        with self.limit:
            chosen = self.policy.act(step)
        self._compare("actions", rows, chosen, t)
        if self.subject.arrays["log_probs"].size:
            self._compare("log_probs", rows, self.policy.log_probs(step, actions), t)

    def _compare_state(self, step: Step, t: int) -> None:
        for name in STATE_ARRAYS:
            self._compare(name, self.subject.state_starts[self.wave] + t, step, t)

    def _compare(
        self, name: str, rows: Int, values: Step | NDArray[Any], t: int, among: Bool | None = None
    ) -> None:
        """Records first differences of `rows` from the values, [E, ...] or those of a step.

        `among`: episodes of the wave to compare, [E]; all that have not ended by default.
        """
        array = self.subject.arrays[name]
        if not array.size:
            return
        last = self.lengths + (name in STATE_ARRAYS)
        live = np.flatnonzero((last > t if among is None else among) & self.same)
        if not len(live):
            return
        replayed = getattr(values, name) if isinstance(values, tuple) else values
        stored, got = array[rows[live]], replayed[live]
        differs = _bits_differ(stored, got)
        for k in np.flatnonzero(differs.reshape(len(live), -1).any(axis=1)).tolist():
            place = tuple(np.argwhere(differs[k])[0].tolist())
            self.same[live[k]] = False
            self.known[int(live[k])] = Difference(
                episode=int(self.wave[live[k]]),
                step=t,
                array=name,
                agent=place[0] if place and name not in WITHOUT_AGENTS else None,
                stored=f"{stored[k][place]!s}{_column(name, place)}",
                replayed=str(got[k][place]),
            )


def _bits_differ(one: NDArray[Any], other: NDArray[Any]) -> Bool:
    """Elementwise; a NaN equals itself, and 0 differs from -0."""
    words = np.dtype(f"u{one.dtype.itemsize}")
    pair = (np.ascontiguousarray(array).view(words) for array in (one, other))
    differs: Bool = np.not_equal(*pair)
    return differs


def _column(name: str, place: tuple[int, ...]) -> str:
    """Which number of a row it is, in words."""
    column = place if name in WITHOUT_AGENTS else place[1:]
    return f" (column {', '.join(map(str, column))})" if column else ""


def _report(subject: Subject, differences: list[Difference], n_replayed: int) -> Remarks:
    foreign = {
        each.episode for each in differences if each.step == 0 and each.array in WITHOUT_AGENTS
    }
    is_mixed = bool(subject.origin.parents)  # some may have seeds of their worlds, others not
    if not subject.origin.has_world_seeds and (
        len(foreign) == n_replayed or (is_mixed and foreign)
    ):
        first = next(each for each in differences if each.episode in foreign)
        yield note(
            f"the seeds of {len(foreign)} of {n_replayed} replayed episodes are not those of their "
            f"worlds, so these cannot be compared ({first})"
        )
        differences = [each for each in differences if each.episode not in foreign]
    if not differences:
        return
    provenance = subject.manifest.provenance
    world = subject.origin.spec.world
    here = made_with("pymunk" if world is None else world.backend)
    packages = {name: provenance[name] for name in here if name in provenance}
    changed = changed_versions(packages, here)
    versions = f" It was made with other versions: {', '.join(changed)}." if changed else ""
    shown = "; ".join(map(str, differences[:MOST_DIFFERENCES_SHOWN]))
    n_more = len(differences) - MOST_DIFFERENCES_SHOWN
    more = f"; and {n_more} more" if n_more > 0 else ""
    yield problem(
        f"{len(differences)} of {n_replayed} replayed episodes differ from the stored ones: "
        f"{shown}{more}.{versions}"
    )
