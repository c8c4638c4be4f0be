"""The references for programs: those of the card, in full."""

import json

import numpy as np
import pytest

from swarmdata.cards.reference_file import reference_bytes
from swarmdata.registry.published import references
from swarmdata.registry.recipes import FAMILIES, FAMILY_SPECS
from swarmdata.rollouts.metrics import metrics_of
from swarmdata.specs.origins import RecordedAgent, RecordedSpec
from swarmdata.specs.spaces import DiscreteSpace
from swarmdata.specs.task_spec import TaskSpec


@pytest.mark.parametrize("family", FAMILIES)
def test_an_outsider_computes_the_score(family: str) -> None:
    """Row 46: the references were in three decimals of Markdown only."""
    content = reference_bytes(FAMILY_SPECS[family])
    assert content is not None
    found, known = json.loads(content), references()[family]
    score = found["score"]
    if known.expert is None:  # nobody has trained one yet, so the task has no score
        assert score["expert"] is None
    else:
        names = {"R": -1.25, "no_skill": score["no_skill"], "expert": score["expert"]}
        assert eval(score["formula"], {"__builtins__": {}}, names) == known.score(-1.25)
        assert np.isfinite(score["expert"])
    returns = {name: policy["return"]["value"] for name, policy in found["policies"].items()}
    assert returns == {name: known.mean_return(name) for name in known.policies}
    assert score["no_skill"] == max(returns["idle"], returns["random"])
    assert set(found["metrics"]) == set(metrics_of(FAMILY_SPECS[family].task))
    assert all(set(policy) == set(found["metrics"]) for policy in found["policies"].values())
    assert found["n_episodes"] == 1000


def test_what_was_not_measured_has_no_file() -> None:
    assert reference_bytes(TaskSpec(horizon=41)) is None
    agent = RecordedAgent(name="a", observation=DiscreteSpace(n=2), action=DiscreteSpace(n=2))
    spec = RecordedSpec(task="x", agents=(agent,), state_size=0, state_from="environment")
    assert reference_bytes(spec) is None
