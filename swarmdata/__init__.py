"""Offline multi-agent RL datasets for multi-robot tasks.

    >>> import swarmdata
    >>> dataset = swarmdata.load("coop_nav-medium-mini")
    >>> batch = next(dataset.sampler(256, seed=0))

The names below are loaded when they are first used, so that `import swarmdata` costs nothing: it
loads neither NumPy, pydantic, zarr, numba, Pymunk nor torch. Error types are in
`swarmdata.errors`; `swarmdata.rollouts.evaluate` and `swarmdata.rollouts.rollout` are modules.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from swarmdata.datasets.dataset import Dataset
    from swarmdata.errors import SwarmdataError
    from swarmdata.hub.catalog.catalog import DatasetInfo, list_datasets, load
    from swarmdata.record.recorder import Recorder
    from swarmdata.registry.components import make_env
    from swarmdata.rollouts.function_policy import FunctionPolicy
    from swarmdata.specs.recipe import Recipe
    from swarmdata.specs.task_spec import TaskSpec
    from swarmdata.types import Batch, Episode, EvalResult, Step

__version__ = "0.1.0"

__all__ = [
    "Batch",
    "Dataset",
    "DatasetInfo",
    "Episode",
    "EvalResult",
    "FunctionPolicy",
    "Recipe",
    "Recorder",
    "Step",
    "SwarmdataError",
    "TaskSpec",
    "list_datasets",
    "load",
    "make_env",
]

_HOMES = {
    "Batch": "swarmdata.types",
    "Dataset": "swarmdata.datasets.dataset",
    "DatasetInfo": "swarmdata.hub.catalog.catalog",
    "Episode": "swarmdata.types",
    "EvalResult": "swarmdata.types",
    "FunctionPolicy": "swarmdata.rollouts.function_policy",
    "Recipe": "swarmdata.specs.recipe",
    "Recorder": "swarmdata.record.recorder",
    "Step": "swarmdata.types",
    "SwarmdataError": "swarmdata.errors",
    "TaskSpec": "swarmdata.specs.task_spec",
    "list_datasets": "swarmdata.hub.catalog.catalog",
    "load": "swarmdata.hub.catalog.catalog",
    "make_env": "swarmdata.registry.components",
}


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
