"""The range of every numeric setting of the algorithms, by its name, which means one thing in all.

Settings of algorithms of others have ranges of their own, but for those that every training reads.
"""

import inspect
import math
from dataclasses import dataclass
from typing import Any

from swarmdata.errors import SpecError


@dataclass(frozen=True, slots=True)
class Range:
    """Numbers from `low` to `high`; an end that is open is itself outside."""

    low: float
    high: float = math.inf
    is_open_below: bool = False
    is_open_above: bool = False

    def __contains__(self, value: float) -> bool:
        """Whether a number is in the range; NaN is in none."""
        above = value > self.low if self.is_open_below else value >= self.low
        return above and (value < self.high if self.is_open_above else value <= self.high)

    def __str__(self) -> str:
        """The range in words, such as "above 0 and at most 1"."""
        ends = [f"{'above' if self.is_open_below else 'at least'} {self.low:g}"]
        if self.high < math.inf:
            ends.append(f"{'below' if self.is_open_above else 'at most'} {self.high:g}")
        return " and ".join(ends)


_GROUPS: dict[Range, str] = {
    Range(1): (
        "actor_hidden batch_size capacity clone_rounds clone_steps critic_hidden flow_hidden "
        "hidden latent_size max_samples memory_size min_episodes minibatch mixer_embedding "
        "mixer_hidden n_candidates n_components n_copies n_critics n_epochs n_flow_steps "
        "n_gradient_steps n_heads n_iterations n_passes n_samples n_steps n_updates policy_delay "
        "rollout_steps value_hidden width window"
    ),
    Range(2): "extraction_candidates n_bins",
    Range(0): (
        "bc_weight behind_payload_weight burn_in clone_noise contact_cost cost_weight cql_weight "
        "critic_warmup_updates entropy_weight final_learning_rate final_noise first_rl_weight "
        "gap_limit inverse_temperature keep_left keep_right latent_weight logit_penalty margin "
        "mean_penalty noise noise_scale payload_path_weight rl_weight smoothing smoothing_clip "
        "surface_margin teacher_margin value_weight warmup_transitions"
    ),
    Range(0, is_open_below=True): (
        "actor_learning_rate clip critic_learning_rate density_floor deviation final_std "
        "flow_learning_rate latent_learning_rate learning_rate max_grad_norm max_weight "
        "reward_scale sample_noise search_deviation slope_limit std temperature value_clip "
        "value_learning_rate"
    ),
    Range(0, 1): (
        "bc_warmup_share critic_warmup_fraction discount epsilon final_epsilon "
        "final_learning_rate_factor gae_lambda rectification team_share threshold trace_decay"
    ),
    Range(0, 1, is_open_below=True): "effective_share exploration fraction tau",
    Range(0, 1, is_open_above=True): "critic_share noise_correlation",
    Range(0, 1, is_open_below=True, is_open_above=True): "expectile extraction_share",
    Range(-math.inf): "contact_ramp",  # parts of training; before its start is possible
}

RANGES = {name: each for each, names in _GROUPS.items() for name in names.split()}
"""By the name of the setting, without its section; of a tuple, every number is in it."""

OF_EVERY_TRAINING = ("n_updates", "batch_size", "n_steps", "n_copies")
"""Settings that have these ranges in the configs of others, too."""


def check_range(kind: type, name: str, value: Any) -> None:
    """Refuses a number of a config's class outside its range, or an empty tuple of numbers."""
    if name not in RANGES or not (name in OF_EVERY_TRAINING or _is_ours(kind, name)):
        return
    if value is None or isinstance(value, str):
        return
    several = "numbers, each " if isinstance(value, tuple) else ""
    numbers = value if several else (value,)
    if not numbers or any(each not in RANGES[name] for each in numbers):
        raise SpecError(
            f"setting {name!r} of {kind.__qualname__} is {value!r:.100}, expected "
            f"{several}{RANGES[name]}"
        )


def _is_ours(kind: type, name: str) -> bool:
    """Whether a class of this package declares the field."""
    declaring = next(each for each in kind.__mro__ if name in inspect.get_annotations(each))
    return declaring.__module__.startswith("swarmdata.")
