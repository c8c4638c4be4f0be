"""A run folder says who its policies are; its name is a label without the dataset."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

pytest.importorskip("torch", reason="runs need the torch extra")

from swarmdata.errors import CheckpointError
from swarmdata.evaluation.runs.trained_policies import label_of, read_trained

DATASET = "coop_nav-medium-v1"


@given(st.from_regex(r"[a-z_]{1,12}(-[a-z_]{1,6})?", fullmatch=True))
def test_the_dataset_is_no_part_of_the_label(name: str) -> None:
    assert label_of(f"{name}-coop_nav-medium-v1", DATASET) == name
    assert label_of(f"{name}-coop_nav-medium", DATASET) == name
    assert label_of(f"{name}-coop_nav-expert", DATASET) == f"{name}-coop_nav-expert"


def test_a_name_that_is_all_dataset_stays() -> None:
    assert label_of("coop_nav-medium", DATASET) == "coop_nav-medium"
    assert label_of("-coop_nav-medium", DATASET) == "-coop_nav-medium"


def test_a_folder_without_a_run_is_refused(tmp_path: Path) -> None:
    with pytest.raises(CheckpointError, match="is not a run folder"):
        read_trained(tmp_path)
