"""Checks of episodes: their ends, seeds, order, splits, and the table that lists them."""

import numpy as np

from swarmdata.audit.findings import Remarks, note, problem
from swarmdata.audit.subject import Subject, blocks, some
from swarmdata.errors import SpecError
from swarmdata.numerics.random import EVALUATION_BASE
from swarmdata.rollouts.recipe_episodes import stream_seeds
from swarmdata.store import SPLITS, assign_splits, merge_order
from swarmdata.store.arrays.running_moments import Moments
from swarmdata.types import END_REASONS, EVENTS, Double, Int

HORIZON_CODE = END_REASONS.index("horizon")

TIMEOUT_SHARE = 0.9
"""Share of terminations at one length from which they look like timeouts."""

MIN_TERMINATIONS = 10
"""Fewer episodes than this prove no habit."""

SUM_TOLERANCE = 1e-9
"""Relative difference of sums that another order of adding explains."""


def ends(subject: Subject) -> Remarks:
    """Each episode ends once, at its last step, by termination or truncation, as its reason says.

    In D4RL's maze2d "timeouts" mean goals and terminals are never set; antmaze's flags are out of
    step with its episodes (issues 43, 85, 162, PR 128). d3rlpy lets terminals win where both are
    set (d3rlpy issue 463).
    """
    terminations = np.asarray(subject.arrays["terminations"])
    truncations = np.asarray(subject.arrays["truncations"])
    both = np.flatnonzero(terminations & truncations)
    if len(both):
        place = subject.place("terminations", int(both[0]))
        yield problem(f"{len(both):,} steps are terminated and truncated, first {place}")
    flagged, last = np.flatnonzero(terminations | truncations), subject.last_steps
    early, missing = np.setdiff1d(flagged, last), np.setdiff1d(last, flagged)
    if len(early):
        place = subject.place("terminations", int(early[0]))
        yield problem(f"{len(early):,} flags of an end stand inside episodes, first {place}")
    if len(missing):
        place = subject.place("terminations", int(missing[0]))
        yield problem(f"{len(missing):,} episodes have no end, first {place}")
    cut = subject.table.end_reason == HORIZON_CODE
    # other environments may report success of an episode that they truncated
    successes = subject.table.success if subject.task is None else np.zeros_like(cut)
    wrong = np.flatnonzero((truncations[last] != cut) & ~(truncations[last] & successes))
    if len(wrong):
        yield problem(
            f"flags and end reasons disagree in episodes {some(wrong)}: a truncation must have the "
            "reason `horizon`, a termination must not"
        )


def horizon(subject: Subject) -> Remarks:
    """The horizon truncates: no episode is longer, and being cut is no termination.

    OMAR's MPE and MuJoCo data have terminals where the time was up, so that values are bootstrapped
    to zero there; D4RL v0 had no timeouts at all (D4RL issues 77, 182).
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
    """Terminations that look like timeouts: nearly all of them at the greatest length."""
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
    yield (
        problem(f"{words} (the horizon is {limit})")
        if limit is not None
        else note(
            f"{words}. If nothing ends the task then, convert it again with truncations there"
        )
    )


def table(subject: Subject) -> Remarks:
    """Returns and collision counts of the episode table are those of the arrays.

    OG-MARL's card statistics read one row of five of OMAR's data; nobody could see that returns
    and data had come apart.
    """
    starts = subject.table.starts
    means = np.concatenate([block.mean(axis=1, dtype=np.float64)
                            for _, block in blocks(subject.arrays["rewards"])])  # fmt: skip
    scale = np.add.reduceat(np.abs(means), starts)
    stored = subject.table.team_return
    wrong = np.flatnonzero(
        ~(np.abs(np.add.reduceat(means, starts) - stored) <= SUM_TOLERANCE * (scale + 1.0))
    )
    if len(wrong):
        first = int(wrong[0])
        got = np.add.reduceat(means, starts)[first]
        yield problem(
            f"team_return of episodes {some(wrong)} is not the sum of their mean rewards: episode "
            f"{first} has {stored[first]:g} in the table, {got:g} in the arrays"
        )
    if subject.arrays["events"].shape[2]:
        yield from _collisions(subject)


def _collisions(subject: Subject) -> Remarks:
    events, starts = subject.arrays["events"], subject.table.starts
    onsets = np.concatenate([block.sum(axis=1, dtype=np.int64) for _, block in blocks(events)])
    counts = np.add.reduceat(onsets, starts, axis=0)
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
    """No reset seed occurs twice, none is of the evaluation, and a recipe's are its own.

    Minari drops the seeds when it combines datasets; D4RL's and OG-MARL's have none, so nobody can
    tell whether test episodes were trained on.
    """
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
        wrong = mine[values[mine] != stream_seeds(recipe, policy, table.policy_episode[mine])]
        if len(wrong):
            yield problem(
                f"episodes {some(wrong)} of {source.label} have other seeds than the recipe gives "
                "them: they are not of this recipe"
            )


def repeated(subject: Subject, keys: np.ndarray, what: str) -> Remarks:
    """Says which episodes have the same key, and whether that is across splits."""
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
    """Episodes of each policy are in the order of their stream, and a recipe's all there.

    D4RL's hopper-medium-expert-v0 was expert and replay, with other numbers of rows than said
    (issue 19): what a mixture holds must be checkable.
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
            f"episode {first} is not the one that the recipe's order has there: episodes are "
            "missing, added or exchanged"
        )


def splits(subject: Subject) -> Remarks:
    """Every episode is in the split that the rule gives it.

    Minari's splits are drawn when they are asked for and stored nowhere; D4RL has none.
    """
    origin, table = subject.origin, subject.table
    if origin.split_rule is None:
        yield note("the episodes keep the splits of their source: there is no rule to compare with")
        return
    if (table.policy_episode < 0).any():
        return  # `order` says so
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
            f"episodes {some(wrong)} are in other splits than the rule says: episode {first} is in "
            f"{SPLITS[table.split[first]]}, expected {SPLITS[expected[first]]}"
        )


def statistics(subject: Subject) -> Remarks:
    """The normalization statistics of the manifest are those of the train split.

    Statistics of a whole dataset leak the test split into training; those of OG-MARL's cards are of
    other rows than those that are trained on.
    """
    entry = subject.manifest.statistics
    found = {name: _moments(subject, name) for name in ("observations", "rewards")}
    stored = {
        "observations": (entry.observation_mean, entry.observation_std),
        "rewards": ((entry.reward_mean,), (entry.reward_std,)),
    }
    for name, moments in found.items():
        if moments is None:
            yield problem("no episode is in the train split, so there are no statistics")
            return
        mean, std = moments
        scale = SUM_TOLERANCE * (1.0 + np.abs(mean) + std)
        for what, got, expected in (
            ("mean", stored[name][0], mean), ("deviation", stored[name][1], std)
        ):  # fmt: skip
            if len(got) != len(expected):
                yield problem(f"{what} of {name} has {len(got)} columns, not {len(expected)}")
                continue
            wrong = np.flatnonzero(~(np.abs(np.array(got) - expected) <= scale))
            if len(wrong):
                yield problem(
                    f"{what} of {name}, column {wrong[0]}, is {got[wrong[0]]:g} in the manifest, "
                    f"{expected[wrong[0]]:g} in the train split"
                )


def _moments(subject: Subject, name: str) -> tuple[Double, Double] | None:
    """Mean and deviation over the train split, as the store computes them."""
    moments, array = Moments(), subject.arrays[name]
    columns = array.shape[2] if array.ndim == 3 else 1
    extra = int(name == "observations")
    starts, lengths = subject.starts_of(name), subject.table.lengths + extra
    train = np.flatnonzero(subject.table.split == SPLITS.index("train"))
    for episode in train.tolist():
        rows = array[starts[episode] : starts[episode] + lengths[episode]]
        moments.add(rows.reshape(-1, columns))
    if not len(train):
        return None
    mean, std = moments.result()
    return np.array(mean), np.array(std)
