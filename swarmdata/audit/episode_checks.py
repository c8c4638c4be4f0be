"""Checks of episodes: their ends, seeds, order and splits, and the episode table."""

import numpy as np

from swarmdata.audit.findings import Remarks, note, problem
from swarmdata.audit.subject import Subject, blocks, some
from swarmdata.errors import SpecError
from swarmdata.numerics.random import EVALUATION_BASE
from swarmdata.rollouts.recipe_episodes import episode_seeds
from swarmdata.store import SPLITS
from swarmdata.store.arrays.running_moments import train_moments
from swarmdata.store.episode_order import merge_order
from swarmdata.store.split_rule import assign_splits
from swarmdata.types import END_REASONS, EVENTS, Int

HORIZON_CODE = END_REASONS.index("horizon")

TIMEOUT_SHARE = 0.9  # share of terminations at the same length from which they look like timeouts
MIN_TERMINATIONS = 10  # fewer terminations than this are not examined for timeouts
SUM_TOLERANCE = 1e-9  # relative difference of sums that the order of additions explains


def ends(subject: Subject) -> Remarks:
    """Each episode ends once, at its last step, by the termination or truncation of its reason.

    Flags of D4RL do not match its episodes (issues 43, 85, 162), or both are set (d3rlpy 463).
    """
    terminated, truncated = (_flagged(subject, name) for name in ("terminations", "truncations"))
    both = np.intersect1d(terminated, truncated)
    flagged, last = np.union1d(terminated, truncated), subject.last_steps
    for steps, words in (
        (both, "steps are terminated and truncated"),
        (np.setdiff1d(flagged, last), "flags of an end stand inside episodes"),
        (np.setdiff1d(last, flagged), "episodes have no end"),
    ):
        if len(steps):
            place = subject.place("terminations", int(steps[0]))
            yield problem(f"{len(steps):,} {words}, first {place}")
    cut = subject.table.end_reason == HORIZON_CODE
    # other environments may report success of an episode that they truncated
    successes = subject.table.success if subject.task is None else np.zeros_like(cut)
    is_truncated = np.isin(last, truncated)
    wrong = np.flatnonzero((is_truncated != cut) & ~(is_truncated & successes))
    if len(wrong):
        yield problem(
            f"flags and end reasons disagree in episodes {some(wrong)}: a truncation must have the "
            "reason `horizon`, a termination must not"
        )


def _flagged(subject: Subject, name: str) -> Int:
    found = [first + np.flatnonzero(block) for first, block in blocks(subject.arrays[name])]
    return np.concatenate(found)


def horizon(subject: Subject) -> Remarks:
    """The horizon truncates: no episode is longer, and no timeout is stored as a termination.

    Values learned from terminals at the time limit, as OMAR's data have, are zero there.
    """
    table, limit = subject.table, subject.origin.spec.horizon
    if limit is not None:
        late = np.flatnonzero(table.lengths > limit)
        if len(late):
            yield problem(f"episodes {some(late)} are longer than the horizon of {limit} steps")
    cut = table.end_reason == HORIZON_CODE
    if subject.origin.recipe is not None:
        short = np.flatnonzero(cut & (table.lengths != limit))
        if len(short):
            yield problem(
                f"episodes {some(short)} were truncated after {table.lengths[short[0]]} steps, "
                f"expected {limit}: only the horizon truncates"
            )
    yield from _disguised(table.lengths[~cut], limit)


def _disguised(ended: Int, limit: int | None) -> Remarks:
    """Terminations that look like timeouts: nearly all of them have the greatest length."""
    if len(ended) < MIN_TERMINATIONS or ended.max() == 1:
        return
    longest = int(ended.max()) if limit is None else limit
    share = float((ended == longest).mean())
    if share < TIMEOUT_SHARE:
        return
    words = (
        f"{share:.0%} of the {len(ended):,} terminations come after exactly {longest} steps: "
        "they look like timeouts, which are truncations"
    )
    if limit is None:
        yield note(
            f"{words}. If that is a time limit, convert the data again with truncations there"
        )
    else:
        yield problem(f"{words} (the horizon is {limit})")


def table(subject: Subject) -> Remarks:
    """Returns and collision counts of the episode table are those of the arrays."""
    stored = subject.table.team_return
    found, scale = np.empty_like(stored), np.empty_like(stored)
    for episodes in subject.episode_groups():
        means = subject.rows_of("rewards", episodes).mean(axis=1, dtype=np.float64)
        starts = subject.table.starts[episodes] - subject.table.starts[episodes.start]
        found[episodes] = np.add.reduceat(means, starts)
        scale[episodes] = np.add.reduceat(np.abs(means), starts)
    wrong = np.flatnonzero(~(np.abs(found - stored) <= SUM_TOLERANCE * (scale + 1.0)))
    if len(wrong):
        first = int(wrong[0])
        yield problem(
            f"team_return of episodes {some(wrong)} is not the sum of their mean rewards: episode "
            f"{first} has {stored[first]:g} in the table, {found[first]:g} in the arrays"
        )
    if subject.arrays["events"].shape[2]:
        yield from _collisions(subject)


def _collisions(subject: Subject) -> Remarks:
    counts = np.empty((len(subject.table), len(EVENTS)), dtype=np.int64)
    for episodes in subject.episode_groups():
        onsets = subject.rows_of("events", episodes).sum(axis=1, dtype=np.int64)
        starts = subject.table.starts[episodes] - subject.table.starts[episodes.start]
        counts[episodes] = np.add.reduceat(onsets, starts, axis=0)
    pairs = (("robot_onsets", "robot_collisions", 2), ("obstacle_onsets", "obstacle_collisions", 1))
    for event, column, each in pairs:
        found, stored = counts[:, EVENTS.index(event)], getattr(subject.table, column)
        wrong = np.flatnonzero(found != each * stored)
        if len(wrong):
            yield problem(
                f"{column} of episodes {some(wrong)} are not those of the events: episode "
                f"{wrong[0]} has {stored[wrong[0]]} in the table, {found[wrong[0]] / each:g} there"
            )


def seeds(subject: Subject) -> Remarks:
    """No reset seed occurs twice or is an evaluation seed; a recipe's are those it gives."""
    values, table = subject.table.seeds, subject.table
    reserved = np.flatnonzero(values >= EVALUATION_BASE)
    if len(reserved):
        yield problem(f"episodes {some(reserved)} have seeds that are reserved for evaluation")
    yield from repeated(subject, values, "seed")
    recipe = subject.origin.recipe
    if recipe is None:
        return
    for policy, source in enumerate(recipe.policies):
        mine = np.flatnonzero(table.policy == policy)
        wrong = mine[values[mine] != episode_seeds(recipe, policy, table.policy_episode[mine])]
        if len(wrong):
            yield problem(
                f"episodes {some(wrong)} of {source.label} have other seeds than the recipe gives "
                "them: they are not of this recipe"
            )


def repeated(subject: Subject, keys: np.ndarray, what: str) -> Remarks:
    """Reports episodes with equal keys, and whether they are in different splits."""
    order = np.argsort(keys, kind="stable")
    same = np.flatnonzero(keys[order][1:] == keys[order][:-1])
    if not len(same):
        return
    split = subject.table.split
    leaks = same[split[order[same]] != split[order[same + 1]]]
    first = int(leaks[0] if len(leaks) else same[0])
    one, other = int(order[first]), int(order[first + 1])
    where = f"episodes {one} ({SPLITS[split[one]]}) and {other} ({SPLITS[split[other]]})"
    leaking = f", {len(leaks):,} of them across splits" if len(leaks) else ""
    yield problem(f"{len(same):,} episodes repeat the {what} of another{leaking}: first {where}")


def order(subject: Subject) -> Remarks:
    """Episodes of each policy are in the order of their stream, and those of a recipe are complete.

    So the content of a mixture can be checked, unlike that of D4RL's (issue 19).
    """
    table, recipe = subject.table, subject.origin.recipe
    for policy, source in enumerate(subject.origin.policies):
        stream = table.policy_episode[table.policy == policy]
        if len(stream) and (stream[0] < 0 or (np.diff(stream) <= 0).any()):
            yield problem(f"episodes of {source.label} are not in the order of their stream")
            return
    if recipe is None:
        return
    lengths = [table.lengths[table.policy == p].tolist() for p in range(len(recipe.policies))]
    wanted = merge_order(recipe, lengths)
    got = list(zip(table.policy.tolist(), table.policy_episode.tolist(), strict=True))
    if wanted.lacking is not None:
        yield problem(
            f"the recipe asks for {recipe.n_steps:,} joint steps, the next of them from "
            f"{recipe.policies[wanted.lacking].label}, which has no more episodes here"
        )
    elif list(wanted.order) != got:
        first = next((k for k, pair in enumerate(zip(wanted.order, got, strict=False))
                      if pair[0] != pair[1]), len(wanted.order))  # fmt: skip
        yield problem(
            f"episode {first} is not the one at this place of the recipe's order: episodes are "
            "missing, added or exchanged"
        )


def splits(subject: Subject) -> Remarks:
    """Every episode is in the split that the rule assigns."""
    origin, table = subject.origin, subject.table
    if origin.split_rule is None:
        yield note("the episodes keep the splits of their source: there is no rule to compare with")
        return
    if (table.policy_episode < 0).any():
        return  # a problem of `order`
    pairs = list(zip(table.policy.tolist(), table.policy_episode.tolist(), strict=True))
    try:
        expected = assign_splits(origin, pairs)
    except SpecError as error:
        yield problem(str(error))
        return
    wrong = np.flatnonzero(table.split != expected)
    if len(wrong):
        first = int(wrong[0])
        yield problem(
            f"the rule assigns episodes {some(wrong)} to other splits: episode {first} is in "
            f"{SPLITS[table.split[first]]}, expected {SPLITS[expected[first]]}"
        )


def statistics(subject: Subject) -> Remarks:
    """The normalization statistics of the manifest are those of the train split alone."""
    entry = subject.manifest.statistics
    if not (subject.table.split == SPLITS.index("train")).any():
        yield problem("no episode is in the train split, so there are no statistics")
        return
    stored = {
        "observations": (entry.observation_mean, entry.observation_std),
        "rewards": ((entry.reward_mean,), (entry.reward_std,)),
    }
    for name, known in stored.items():
        mean, std = train_moments(subject.stored, name)
        scale = SUM_TOLERANCE * (1.0 + np.abs(mean) + std)
        for what, got, expected in zip(("mean", "deviation"), known, (mean, std), strict=True):
            if len(got) != len(expected):
                yield problem(f"{what} of {name} has {len(got)} columns, not {len(expected)}")
                continue
            wrong = np.flatnonzero(~(np.abs(np.array(got) - expected) <= scale))
            if len(wrong):
                yield problem(
                    f"{what} of {name}, column {wrong[0]}, is {got[wrong[0]]:g} in the manifest, "
                    f"{expected[wrong[0]]:g} in the train split"
                )
