"""What each offline algorithm is named after, and how to train it without."""

from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True, slots=True)
class Ablation:
    """An algorithm without its ingredient: what it must differ from to earn its name."""

    ingredient: str
    settings: dict[str, Any] = field(default_factory=dict)  # that take it away
    algorithm: str | None = None  # another one that lacks it; None: the same


ABLATIONS: dict[str, Ablation | None] = {
    "bc": None,
    "filtered_bc": Ablation("the choice of the best episodes", algorithm="bc"),
    "bc_latent": Ablation("the latents of episodes", algorithm="bc"),
    "bc_flow": Ablation("the noise", {"noise_scale": 0.0}),
    "mac_flow": Ablation("the critics", {"inverse_temperature": 0.0}),
    "facmac_bc": Ablation("the mixing network", {"mixer": "mean"}),
    "iql": Ablation("weights of good actions", {"inverse_temperature": 0.0}),
    "iql_cost": Ablation("the weight of costs", {"cost_weight": 0.0}),
    "omiga": Ablation("weights of good actions", {"temperature": 1e3}),
    "oryx": Ablation("telling the others", {"joint": False}),
    "maddpg_bc": Ablation("the critic", {"rl_weight": 0.0, "extraction": "joint"}),
    "matd3": Ablation("the critic", {"rl_weight": 0.0}),
    "maddpg_cql": Ablation("the conservative penalty", {"cql_weight": 0.0}),
    "cfcql": Ablation("the counterfactual penalty", {"cql_weight": 0.0}),
    "icql_qs": Ablation("the counterfactual penalty", {"cql_weight": 0.0}),
    "omar": Ablation("the search for the best action", {"rectification": 0.0}),
    "vdn": Ablation("the values of choices", {"temperature": 1e3}),
    "qmix": Ablation("the mixing network", algorithm="vdn"),
}
"""By registered name; None is a plain clone, which has nothing to take away."""
