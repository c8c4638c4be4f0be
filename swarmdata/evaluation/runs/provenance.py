"""The provenance of an evaluated policy, as result files store it."""

import hashlib
import json
from typing import Annotated, Any

from pydantic import AfterValidator, Field

from swarmdata import __version__
from swarmdata.runtime.documents import parse_json
from swarmdata.runtime.own_components import own_codes
from swarmdata.specs.frozen import Frozen
from swarmdata.specs.plain_names import Sha256, checked_label

FilePart = Annotated[
    str, Field(pattern=r"^[^/\\\s.][^/\\\n]*$", max_length=96), AfterValidator(checked_label)
]
"""A label that can be part of a file name."""

Natural = Annotated[int, Field(ge=0, lt=1 << 63)]


class Provenance(Frozen):
    """A policy, its training, and the version of the code that evaluated it.

    Fields that do not apply are None: a scripted policy has no dataset and no run.
    """

    label: FilePart  # of its row in tables, such as the algorithm
    index: Natural = 0  # among the policies with its label
    algorithm: str | None = None  # of its training
    dataset: FilePart | None = None  # id with version, of its training
    digest: Sha256 | None = None  # of that dataset
    view: str | None = None  # changed models and reward weights of the dataset as canonical JSON
    config: dict[str, Any] = Field(default_factory=dict)  # of the algorithm, with all defaults
    seed: Natural | None = None  # of the training
    updates: Natural | None = None  # offline: gradient updates at the evaluated checkpoint
    frames: Natural | None = None  # online: joint steps at the evaluated checkpoint
    run: str | None = None  # run folder, or file of ONNX; in a file, relative to the file's folder
    content: Sha256 | None = None  # of the run's files, the checkpoint or the recipe
    code_version: str = __version__

    @property
    def changes(self) -> dict[str, Any]:
        """What `view` changed: models, and `rewards` by name; empty: as recorded."""
        found: dict[str, Any] = {} if self.view is None else parse_json(self.view, "the view")
        return found

    @property
    def dataset_key(self) -> str | None:
        """The dataset's id, with a side or the start of a view's hash: `coop_nav-medium-v1@1f`.

        Weights of rewards are not part of it: whoever learned from other rewards is evaluated on
        those of the task, on the same scale as all others, and is a row beside them.
        """
        return dataset_key(self.dataset, self.view)


def dataset_key(dataset: str | None, view: str | None) -> str | None:
    """Returns `Provenance.dataset_key` of a dataset's id and its view."""
    changes = {} if view is None else parse_json(view, "the view")
    models = {name: value for name, value in changes.items() if name != "rewards"}
    if dataset is None or not models:
        return dataset
    if models.keys() == {"side"}:
        return f"{dataset}@{models['side']}"
    return _with_hash(dataset, json.dumps(models, sort_keys=True, separators=(",", ":")))


def code_version(**used: str) -> str:
    """This package's version, and after + a hash of the code of users' components, of those used.

    `used` is as `own_codes` takes it.
    """
    if not (codes := own_codes(**used)):
        return __version__
    return f"{__version__}+{hashlib.sha256(json.dumps(codes).encode()).hexdigest()[:12]}"


def file_name(provenance: Provenance, spec_hash: str) -> str:
    """Returns the name of a result file, unique for each label, dataset, spec and policy.

    For example `bc--coop_nav-medium-v1--5d0f39ab-0.json`, or `idle--5d0f39ab-0.json` for a policy
    that was not trained on data.
    """
    key, view = provenance.dataset, provenance.view
    key = key if key is None or view is None else _with_hash(key, view)
    parts = (provenance.label, *([key] if key else []), f"{spec_hash[:8]}-{provenance.index}.json")
    return "--".join(parts)


def _with_hash(dataset: str, view: str) -> str:
    return f"{dataset}@{hashlib.sha256(view.encode()).hexdigest()[:8]}"
