"""`references.json` beside a dataset's card: the performance of reference policies, for programs.

It has the numbers of the card at full precision. Like the card it is in no digest, because
references may be measured again while the data stay the same.
"""

import json

from swarmdata.registry.published import references_of
from swarmdata.rollouts.metrics import metrics_of
from swarmdata.specs.origins import Spec

SCORE_FORMULA = "100 * (R - no_skill) / (expert - no_skill)"
"""The score of a mean team return R."""


def reference_bytes(spec: Spec) -> bytes | None:
    """Returns the file's content: the anchors of the score, and every metric of each policy.

    None where no references were measured on exactly this spec.
    """
    known = references_of(spec.hash())
    if known is None:
        return None
    content = {
        "about": (
            f"The performance of reference policies in this task: means over {known.n_episodes} "
            "reserved evaluation episodes, policies without noise, with the low and high ends of "
            "their 95 % bootstrap intervals over episodes. null: no episode defines the metric."
        ),
        "spec_hash": known.spec_hash,
        "n_episodes": known.n_episodes,
        "made_with": known.made_with,
        "score": {
            "formula": SCORE_FORMULA,
            "R": "mean over episodes of the team return (episodes/team_return), the undiscounted "
            "sum over steps of the mean reward over agents",
            "no_skill": known.no_skill,
            "expert": known.expert,
        },
        "metrics": {
            name: {"unit": metric.unit, "better": metric.better, "meaning": metric.meaning}
            for name, metric in metrics_of(spec.task).items()
        },
        "policies": known.model_dump(mode="json")["policies"],
    }
    return json.dumps(content, indent=1, allow_nan=False).encode() + b"\n"
