"""Where a measured policy comes from: what a result file says besides its numbers."""

import hashlib
from typing import Annotated, Any

from pydantic import AfterValidator, Field

from swarmdata import __version__
from swarmdata.specs.frozen import Frozen
from swarmdata.specs.plain_names import Sha256, checked_label

FilePart = Annotated[
    str, Field(pattern=r"^[^/\\\s.][^/\\\n]*$", max_length=96), AfterValidator(checked_label)
]
"""A label that is a part of a file's name."""

Natural = Annotated[int, Field(ge=0, lt=1 << 63)]


class Provenance(Frozen):
    """One policy: who it is, what it was trained on and how far, and which code measured it.

    What does not apply is None: a scripted policy has no dataset and no run.
    """

    label: FilePart  # row of tables: the algorithm
    index: Natural = 0  # among the policies of its label
    algorithm: str | None = None  # that trained it
    dataset: FilePart | None = None  # id, with version, of what it was trained on
    digest: Sha256 | None = None  # of that dataset
    view: str | None = None  # of a reobservation: its models as canonical JSON
    config: dict[str, Any] = Field(default_factory=dict)  # of the algorithm, complete
    seed: Natural | None = None  # of the training
    updates: Natural | None = None  # gradient updates at the measured checkpoint, offline
    frames: Natural | None = None  # joint steps at the measured checkpoint, online
    run: str | None = None  # the run's folder, in a file relative to the file's folder
    content: Sha256 | None = None  # of the run's measured files, the checkpoint or the recipe
    code_version: str = __version__

    @property
    def dataset_key(self) -> str | None:
        """The dataset's id; of a view with the beginning of its hash: `coop_nav-medium-v0@1f`."""
        if self.dataset is None or self.view is None:
            return self.dataset
        return f"{self.dataset}@{hashlib.sha256(self.view.encode()).hexdigest()[:8]}"


def file_name(provenance: Provenance, spec_hash: str) -> str:
    """Name of a result's file: one for each label, dataset, spec and policy.

    For example `bc--coop_nav-medium-v0--5d0f39ab-0.json`, or `idle--5d0f39ab-0.json` of a policy
    that was not trained on data.
    """
    key = provenance.dataset_key
    parts = (provenance.label, *([key] if key else []), f"{spec_hash[:8]}-{provenance.index}.json")
    return "--".join(parts)
