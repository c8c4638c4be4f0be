"""Offline multi-agent RL datasets for multi-robot tasks.

    >>> import swarmdata
    >>> dataset = swarmdata.load("coop_nav-medium-mini")
    >>> batch = next(dataset.sampler(256, seed=0))

Every name that the documentation uses is here. A name is loaded when it is first used, so that
`import swarmdata` costs nothing: it loads neither NumPy, pydantic, zarr, numba, Pymunk nor torch.
The types of all errors are in `swarmdata.errors`.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from swarmdata.building.build import build
    from swarmdata.building.edit import combine_datasets, filter_dataset, subsample_dataset
    from swarmdata.datasets.dataset import Dataset
    from swarmdata.errors import SwarmdataError
    from swarmdata.evaluation.results.result_files import Result, save_result
    from swarmdata.evaluation.results.result_set import read_results
    from swarmdata.evaluation.runs.generated_dataset import generate
    from swarmdata.evaluation.runs.named_policies import make_policy
    from swarmdata.evaluation.runs.provenance import Provenance
    from swarmdata.evaluation.runs.train import train, train_online
    from swarmdata.hub.catalog.catalog import DatasetInfo, list_datasets, load
    from swarmdata.hub.remotes.addresses import register_remote
    from swarmdata.hub.streaming.streamed_dataset import Stream, StreamedDataset
    from swarmdata.interfaces import Policy
    from swarmdata.interop.convert import import_dataset
    from swarmdata.interop.export import export_dataset
    from swarmdata.interop.exported_policies import export_policy
    from swarmdata.interop.logs.import_logs import import_logs
    from swarmdata.interop.torchrl.torchrl_source import make_torchrl_env, register_torchrl
    from swarmdata.numerics.episode_draws import drawn_values
    from swarmdata.record.foreign_rollout import evaluate_parallel
    from swarmdata.record.jax_environments import record_jax
    from swarmdata.record.recorder import Recorder
    from swarmdata.record.recording_folder import recover
    from swarmdata.record.reset_seeds import foreign_evaluation_seeds
    from swarmdata.record.vmas import record_vmas
    from swarmdata.registry.components import (
        make_env,
        make_task,
        register_algorithm,
        register_policy,
        register_task,
    )
    from swarmdata.registry.presets import preset, preset_names
    from swarmdata.registry.published import Reference
    from swarmdata.rollouts.evaluate import evaluate
    from swarmdata.rollouts.function_policy import FunctionPolicy
    from swarmdata.rollouts.rollout import rollout
    from swarmdata.rollouts.task_frame import frame_of
    from swarmdata.specs.origins import RecordedSpec
    from swarmdata.specs.recipe import Recipe
    from swarmdata.specs.task_spec import TaskSpec
    from swarmdata.testing.algorithm_contract import check_algorithm
    from swarmdata.testing.dataset_contract import check_dataset
    from swarmdata.testing.online_contract import check_online_algorithm
    from swarmdata.testing.policy_contract import check_policy
    from swarmdata.testing.remote_contract import check_remote
    from swarmdata.testing.task_contract import check_task
    from swarmdata.types import Batch, Episode, EvalResult, Step

__version__ = "0.2.0"

__all__ = [
    "Batch",
    "Dataset",
    "DatasetInfo",
    "Episode",
    "EvalResult",
    "FunctionPolicy",
    "Policy",
    "Provenance",
    "Recipe",
    "RecordedSpec",
    "Recorder",
    "Reference",
    "Result",
    "Step",
    "Stream",
    "StreamedDataset",
    "SwarmdataError",
    "TaskSpec",
    "build",
    "check_algorithm",
    "check_dataset",
    "check_online_algorithm",
    "check_policy",
    "check_remote",
    "check_task",
    "combine_datasets",
    "drawn_values",
    "evaluate",
    "evaluate_parallel",
    "export_dataset",
    "export_policy",
    "filter_dataset",
    "foreign_evaluation_seeds",
    "frame_of",
    "generate",
    "import_dataset",
    "import_logs",
    "list_datasets",
    "load",
    "make_env",
    "make_policy",
    "make_task",
    "make_torchrl_env",
    "preset",
    "preset_names",
    "read_results",
    "record_jax",
    "record_vmas",
    "recover",
    "register_algorithm",
    "register_policy",
    "register_remote",
    "register_task",
    "register_torchrl",
    "rollout",
    "save_result",
    "subsample_dataset",
    "train",
    "train_online",
]

_HOMES = {
    "Batch": "swarmdata.types",
    "Dataset": "swarmdata.datasets.dataset",
    "DatasetInfo": "swarmdata.hub.catalog.catalog",
    "Episode": "swarmdata.types",
    "EvalResult": "swarmdata.types",
    "FunctionPolicy": "swarmdata.rollouts.function_policy",
    "Policy": "swarmdata.interfaces",
    "Provenance": "swarmdata.evaluation.runs.provenance",
    "Recipe": "swarmdata.specs.recipe",
    "RecordedSpec": "swarmdata.specs.origins",
    "Recorder": "swarmdata.record.recorder",
    "Reference": "swarmdata.registry.published",
    "Result": "swarmdata.evaluation.results.result_files",
    "Step": "swarmdata.types",
    "Stream": "swarmdata.hub.streaming.streamed_dataset",
    "StreamedDataset": "swarmdata.hub.streaming.streamed_dataset",
    "SwarmdataError": "swarmdata.errors",
    "TaskSpec": "swarmdata.specs.task_spec",
    "build": "swarmdata.building.build",
    "check_algorithm": "swarmdata.testing.algorithm_contract",
    "check_dataset": "swarmdata.testing.dataset_contract",
    "check_online_algorithm": "swarmdata.testing.online_contract",
    "check_policy": "swarmdata.testing.policy_contract",
    "check_remote": "swarmdata.testing.remote_contract",
    "check_task": "swarmdata.testing.task_contract",
    "combine_datasets": "swarmdata.building.edit",
    "drawn_values": "swarmdata.numerics.episode_draws",
    "evaluate": "swarmdata.rollouts.evaluate",
    "evaluate_parallel": "swarmdata.record.foreign_rollout",
    "export_dataset": "swarmdata.interop.export",
    "filter_dataset": "swarmdata.building.edit",
    "foreign_evaluation_seeds": "swarmdata.record.reset_seeds",
    "frame_of": "swarmdata.rollouts.task_frame",
    "generate": "swarmdata.evaluation.runs.generated_dataset",
    "import_dataset": "swarmdata.interop.convert",
    "export_policy": "swarmdata.interop.exported_policies",
    "import_logs": "swarmdata.interop.logs.import_logs",
    "list_datasets": "swarmdata.hub.catalog.catalog",
    "load": "swarmdata.hub.catalog.catalog",
    "make_env": "swarmdata.registry.components",
    "make_policy": "swarmdata.evaluation.runs.named_policies",
    "make_task": "swarmdata.registry.components",
    "make_torchrl_env": "swarmdata.interop.torchrl.torchrl_source",
    "preset": "swarmdata.registry.presets",
    "preset_names": "swarmdata.registry.presets",
    "read_results": "swarmdata.evaluation.results.result_set",
    "record_jax": "swarmdata.record.jax_environments",
    "record_vmas": "swarmdata.record.vmas",
    "recover": "swarmdata.record.recording_folder",
    "register_algorithm": "swarmdata.registry.components",
    "register_policy": "swarmdata.registry.components",
    "register_remote": "swarmdata.hub.remotes.addresses",
    "register_task": "swarmdata.registry.components",
    "register_torchrl": "swarmdata.interop.torchrl.torchrl_source",
    "rollout": "swarmdata.rollouts.rollout",
    "save_result": "swarmdata.evaluation.results.result_files",
    "subsample_dataset": "swarmdata.building.edit",
    "train": "swarmdata.evaluation.runs.train",
    "train_online": "swarmdata.evaluation.runs.train",
}
"""Where each public name is defined."""


def __getattr__(name: str) -> Any:
    """Imports a public name on first use (PEP 562)."""
    if name not in _HOMES:
        raise AttributeError(f"module 'swarmdata' has no attribute {name!r}")
    value = getattr(import_module(_HOMES[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """The public names."""
    return [*__all__, "__version__"]
