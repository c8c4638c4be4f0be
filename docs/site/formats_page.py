"""docs/formats.md: what each format keeps and loses, from the converters' own tables."""

from swarmdata.drawing.markdown import table
from swarmdata.interop.conversion.dataset_facts import DATASET_FACTS
from swarmdata.interop.formats import Format, all_formats

FACT_TITLES = {
    "observations": "observations, with the last one",
    "states": "global states, with the last one",
    "sent": "messages sent",
    "delivered": "messages delivered",
    "ages": "age of the newest message",
    "alive": "which agents still act",
    "action_masks": "action masks",
    "actions": "actions",
    "log_probs": "log-probabilities of actions",
    "rewards": "rewards of each agent",
    "terminations": "terminations",
    "truncations": "truncations",
    "events": "contacts and collisions",
    "reward_terms": "unweighted terms of the rewards",
    "agent_terminations": "terminations of each agent",
    "agent_truncations": "truncations of each agent",
    "layout": "obstacles",
    "seed": "seed",
    "policy": "behavior policy",
    "end_reason": "end reason",
    "split": "split",
    "spec": "task, or spaces of a recording",
}

HEAD = """# Formats

This page shows how to convert datasets to and from other formats, and what each format keeps.

    swarmdata convert coop_nav-medium-mini medium.hdf5 --to d4rl
    swarmdata convert medium.hdf5 again --from d4rl --id coop_nav-again-v0

`--to` and `--from` take these names; `swarmdata.export_dataset` and `swarmdata.import_dataset` do
the same in Python. If a foreign file leaves a question open, such as whether an episode was cut by
a time limit, the conversion stops and names the option that answers it; nothing is guessed.

Agents may end at different steps: one has ended from its first flag in an episode on, and the
episode ends when all have. Whole-number actions are choices, counted from 0, one for each column.
Numbers that are not finite, or above 2^24 and not exact in float32, are refused. So are files that
declare more than they store, or that name other files as their content. Arrays that have no place
in a dataset are named on its card. What is written opens, verifies and has a card.

"""

FRAME = """
## Frames

Observations and actions of our tasks are recorded in the world's frame. The algorithms of this
library turn them to each robot's own direction to its target. `--frame target` exports what they
see:

    swarmdata convert coop_nav-medium-mini target.hdf5 --to d4rl --frame target

Every vector of an observation is turned, and after its own numbers come the frame's x axis in the
world, closing speeds, and the nearness of senders of messages (`swarmdata/perception/frames.py`).
Commands longer than 1 are clipped, as worlds do, and turned. States and messages stay as they are.
Another observed vector is an anchor, too, such as `payload_goal`. Unicycles have the frame
`own.heading`, which leaves their commands as they are, or the world's; recordings of other
environments have the world's only. Each export names its frame: in its note
(`metadata/swarmdata`, `swarmdata.json` or `metadata.json`), `d4rl-agents` as `metadata/frame`,
Parquet in its README, too. A turned export cannot be imported, since the recorded numbers are not
in it. A Minari export in a frame recovers a world that observes and acts in it.
"""

MINARI = """
## Minari

Minari finds a dataset by its id in a folder of that name, inside `MINARI_DATASETS_PATH`; another
name is written with a warning. The worlds of this library are recovered with the data:

    swarmdata convert coop_nav-medium-mini data/coop_nav-medium-mini-v1 --to minari
    MINARI_DATASETS_PATH=data python
    >>> dataset = minari.load_dataset("coop_nav-medium-mini-v1")
    >>> env = dataset.recover_environment()

`env` is a Gymnasium environment with one agent, the team: observations and actions are dictionaries
with an array for each robot, the reward is the mean of theirs. `env.reset(seed=...)` with the seed
of an episode, from `dataset.storage.get_episode_metadata`, and the recorded actions give the
recorded observations and rewards bit for bit. `recover_environment(eval_env=True)` has the task's
own rewards, and its resets play the reserved evaluation episodes in order. `swarmdata` has to be
installed there.
"""

BAGS = """
## Bags of ROS 2

`mcap` writes one file, `rosbag2` a folder as `ros2 bag record` makes it; both need the extra `logs`
and no ROS. Robots of our tasks log `/<robot>/pose`, `/velocity`, `/goal` and `/command` in metres
and seconds, and `/scan` where they observe a lidar, as standard messages for viewers and for nodes
of one's own. Every array of the dataset is a topic too, such as `/team/observations`. Episodes
follow one another, 10 s apart; `/team/episode` says what each is.

    swarmdata convert coop_nav-medium-mini team.mcap --to mcap --split test

Such a bag can be imported as if robots had logged it
([bring your own data](bring-your-own-data.md)):

    swarmdata import team.mcap --map team.yaml --id coop_nav-logged-v0

```yaml
dt: 0.1
world: world
each:
  pose: {topic: "/{robot}/pose"}
  goal: {topic: "/{robot}/goal"}
  command:
    topic: "/{robot}/command"
    frame: world
    components:
      - {column: v, low: -0.6, high: 0.6}
      - {column: vy, low: -0.6, high: 0.6}
robots: [robot_0, robot_1, robot_2, robot_3]
max_gap: 1
gaps: cut
```
"""


def page() -> str:
    """The page as Markdown."""
    written = list(all_formats())
    names = [
        [f"`{each.name}`", each.title, "write" if each.read is None else "both ways"]
        for each in written
    ]
    kept = [
        [title, *(f"`{each.kept[fact]}`" if fact in each.kept else "lost" for each in written)]
        for fact, title in ((fact, FACT_TITLES[fact]) for fact in DATASET_FACTS)
    ]
    return (
        HEAD
        + table(["name", "format", "direction"], names)
        + "\n## What each format keeps\n\nA cell has the name that a format uses.\n\n"
        + table(["", *(each.title for each in written)], kept)
        + "\n## Why something is lost\n\n"
        + "".join(map(_losses, written))
        + FRAME
        + MINARI
        + BAGS
        + "\n`pytest tests/interop/test_round_trips.py --update-golden` writes this page.\n"
    )


def _losses(format: Format) -> str:
    """Why a format loses what it loses: one line."""
    reasons: dict[str, list[str]] = {}
    for fact, reason in format.lost.items():
        reasons.setdefault(reason, []).append(FACT_TITLES[fact])
    lost = "; ".join(f"{', '.join(facts)} ({reason})" for reason, facts in reasons.items())
    return f"- {format.title}: {lost or 'nothing is lost'}.\n"
