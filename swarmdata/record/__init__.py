"""Recording of PettingZoo `ParallelEnv`s, VMAS and JAX environments as datasets."""

from swarmdata.record.foreign_rollout import evaluate_parallel, policy_actions, step_of
from swarmdata.record.jax_environments import record_jax
from swarmdata.record.recorder import Recorder, UnfinishedEpisodeWarning
from swarmdata.record.recording_folder import Limits, recover
from swarmdata.record.reset_seeds import foreign_evaluation_seeds
from swarmdata.record.vmas import record_vmas

__all__ = [
    "Limits",
    "Recorder",
    "UnfinishedEpisodeWarning",
    "evaluate_parallel",
    "foreign_evaluation_seeds",
    "policy_actions",
    "record_jax",
    "record_vmas",
    "recover",
    "step_of",
]
