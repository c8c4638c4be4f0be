"""The provenance of an evaluated policy, as result files store it."""

import hashlib
from typing import Annotated, Any

from pydantic import AfterValidator, Field

from swarmdata import __version__
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
    run: str | None = None  # run folder; in a file, relative to the file's folder
    content: Sha256 | None = None  # of the run's files, the checkpoint or the recipe
    code_version: str = __version__

    @property
    def dataset_key(self) -> str | None:
        """The dataset's id, for a view with the start of its hash: `coop_nav-medium-v1@1f`."""
        if self.dataset is None or self.view is None:
            return self.dataset
        return f"{self.dataset}@{hashlib.sha256(self.view.encode()).hexdigest()[:8]}"


def file_name(provenance: Provenance, spec_hash: str) -> str:
    """Returns the name of a result file, unique for each label, dataset, spec and policy.

    For example `bc--coop_nav-medium-v1--5d0f39ab-0.json`, or `idle--5d0f39ab-0.json` for a policy
    that was not trained on data.
    """
    key = provenance.dataset_key
    parts = (provenance.label, *([key] if key else []), f"{spec_hash[:8]}-{provenance.index}.json")
    return "--".join(parts)
