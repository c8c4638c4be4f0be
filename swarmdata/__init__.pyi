"""The public names of swarmdata and where each is defined: `__init__.py` reads this file."""

from swarmdata.building.build import build as build
from swarmdata.building.edit import (
    combine_datasets as combine_datasets,
    filter_dataset as filter_dataset,
    subsample_dataset as subsample_dataset,
)
from swarmdata.datasets.dataset import Dataset as Dataset
from swarmdata.errors import SwarmdataError as SwarmdataError
from swarmdata.evaluation.results.result_files import Result as Result, save_result as save_result
from swarmdata.evaluation.results.result_set import read_results as read_results
from swarmdata.evaluation.runs.generated_dataset import generate as generate
from swarmdata.evaluation.runs.named_policies import make_policy as make_policy
from swarmdata.evaluation.runs.provenance import Provenance as Provenance
from swarmdata.evaluation.runs.train import train as train, train_online as train_online
from swarmdata.evaluation.tuning.tune import tune as tune
from swarmdata.hub.catalog.listing import DatasetInfo as DatasetInfo, list_datasets as list_datasets
from swarmdata.hub.catalog.catalog import load as load
from swarmdata.hub.remotes.addresses import register_remote as register_remote
from swarmdata.hub.streaming.streamed_dataset import (
    Stream as Stream,
    StreamedDataset as StreamedDataset,
)
from swarmdata.interfaces import Policy as Policy
from swarmdata.interop.convert import import_dataset as import_dataset
from swarmdata.interop.export import export_dataset as export_dataset
from swarmdata.interop.exported_policies import export_policy as export_policy
from swarmdata.interop.logs.fitted_twin import fit_twin as fit_twin
from swarmdata.interop.logs.import_logs import import_logs as import_logs
from swarmdata.interop.logs.public_logs import fetch_logs as fetch_logs
from swarmdata.interop.torchrl.torchrl import (
    make_torchrl_env as make_torchrl_env,
    register_torchrl as register_torchrl,
)
from swarmdata.learn.training.settings import Choice as Choice, LogUniform as LogUniform
from swarmdata.numerics.episode_draws import drawn_values as drawn_values
from swarmdata.record.foreign_rollout import evaluate_parallel as evaluate_parallel
from swarmdata.record.jax_environments import record_jax as record_jax
from swarmdata.record.recorder import Recorder as Recorder
from swarmdata.record.recording_folder import recover as recover
from swarmdata.record.reset_seeds import foreign_evaluation_seeds as foreign_evaluation_seeds
from swarmdata.record.vmas import record_vmas as record_vmas
from swarmdata.registry.components import (
    make_env as make_env,
    make_task as make_task,
    register_algorithm as register_algorithm,
    register_policy as register_policy,
    register_task as register_task,
)
from swarmdata.registry.presets import preset as preset, preset_names as preset_names
from swarmdata.registry.published import Reference as Reference
from swarmdata.rollouts.estimate import estimate as estimate
from swarmdata.rollouts.evaluate import evaluate as evaluate
from swarmdata.rollouts.function_policy import FunctionPolicy as FunctionPolicy
from swarmdata.rollouts.rollout import rollout as rollout
from swarmdata.rollouts.function_policy import frame_of as frame_of
from swarmdata.specs.origins import RecordedSpec as RecordedSpec
from swarmdata.specs.recipe import Recipe as Recipe
from swarmdata.specs.rules import TaskRules as TaskRules
from swarmdata.specs.task_spec import TaskSpec as TaskSpec
from swarmdata.testing.algorithm_contract import check_algorithm as check_algorithm
from swarmdata.testing.dataset_contract import check_dataset as check_dataset
from swarmdata.testing.online_contract import check_online_algorithm as check_online_algorithm
from swarmdata.testing.policy_contract import check_policy as check_policy
from swarmdata.testing.remote_contract import check_remote as check_remote
from swarmdata.testing.task_contract import check_task as check_task
from swarmdata.types import (
    Batch as Batch,
    Episode as Episode,
    EvalResult as EvalResult,
    Step as Step,
)

__all__: list[str]
__version__: str
