"""Recording: any PettingZoo `ParallelEnv` or VMAS environment becomes a dataset.

`Recorder` records, `recover` finishes what a killed process began, `record_vmas` plays a policy in
all copies of a VMAS environment, `evaluate_parallel` plays a trained policy where it was recorded.
"""

from swarmdata.record.foreign_rollout import evaluate_parallel, policy_actions, step_of
from swarmdata.record.recorder import Recorder, UnfinishedEpisodeWarning
from swarmdata.record.reset_seeds import foreign_evaluation_seeds
from swarmdata.record.session import Limits, recover
from swarmdata.record.vmas import record_vmas

__all__ = [
    "Limits",
    "Recorder",
    "UnfinishedEpisodeWarning",
    "evaluate_parallel",
    "foreign_evaluation_seeds",
    "policy_actions",
    "record_vmas",
    "recover",
    "step_of",
]
