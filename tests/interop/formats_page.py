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

"""

WAYS = {(True, True): "both ways", (True, False): "read", (False, True): "write"}


def page() -> str:
    """The page as Markdown."""
    written = [each for each in all_formats() if each.write is not None]
    names = [
        [f"`{each.name}`", each.title, WAYS[each.read is not None, each.write is not None]]
        for each in all_formats()
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
        + "\n`pytest tests/interop/test_round_trips.py --update-golden` writes this page.\n"
    )


def _losses(format: Format) -> str:
    """Why a format loses what it loses: one line."""
    reasons: dict[str, list[str]] = {}
    for fact, reason in format.lost.items():
        reasons.setdefault(reason, []).append(FACT_TITLES[fact])
    lost = "; ".join(f"{', '.join(facts)} ({reason})" for reason, facts in reasons.items())
    return f"- {format.title}: {lost or 'nothing is lost'}.\n"
