"""The check of rewards against their terms, and of the terms of contacts against the events."""

import numpy as np

from swarmdata.audit.findings import Remarks, note, problem
from swarmdata.audit.subject import Subject, blocks
from swarmdata.numerics.weighted_terms import weighted_rewards
from swarmdata.registry.components import make_task, reward_terms
from swarmdata.runtime.mapped_pages import release_pages
from swarmdata.types import EVENTS


def rewards(subject: Subject) -> Remarks:
    """Rewards are the stored terms times the weights of the spec, bit for bit.

    D4RL's antmaze was published with one reward convention and evaluated with another (issue 199).
    Terms that are stored apart show which weights the rewards have.
    """
    task, arrays = subject.task, subject.arrays
    if task is None:
        return
    if "reward_terms" not in arrays:
        yield note("the terms of the rewards were not recorded, so rewards have no other weights")
        return
    terms = reward_terms(make_task(task))
    weights = np.array([term.signed_weight for term in terms])
    for first, block in blocks(arrays["reward_terms"]):
        expected = weighted_rewards(block, weights, task.rules.rewards.team_share)
        stored = arrays["rewards"][first : first + len(block)].copy()
        release_pages(arrays["rewards"])
        wrong = np.argwhere(stored != expected)
        if len(wrong):
            row, agent = wrong[0].tolist()
            yield problem(
                f"the reward of agent {agent} in {subject.place('rewards', first + row)} is "
                f"{stored[row, agent]}, its terms times the weights of the spec are "
                f"{expected[row, agent]}"
            )
            break
    if arrays["events"].shape[2]:
        yield from _contacts(subject, [term.name for term in terms])


def _contacts(subject: Subject, names: list[str]) -> Remarks:
    """The terms of contacts are the events."""
    arrays, column = subject.arrays, names.index("robot_contact")
    for first, block in blocks(arrays["events"]):
        counted = arrays["reward_terms"][first : first + len(block), :, column:].copy()
        counted = counted[..., : len(EVENTS)]
        release_pages(arrays["reward_terms"])
        differs = np.argwhere(counted != block)
        if len(differs):
            row, agent, event = differs[0].tolist()
            yield problem(
                f"the term {names[column + event]} of agent {agent} in "
                f"{subject.place('rewards', first + row)} is {counted[row, agent, event]:g}, "
                f"events has {EVENTS[event]} {block[row, agent, event]}"
            )
            return
