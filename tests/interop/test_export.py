"""Exports in a frame hold the numbers that the algorithms of this library learn from and act on."""

import json
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest

from swarmdata.datasets.dataset import Dataset
from swarmdata.errors import ConversionError, SpecError
from swarmdata.interop.convert import import_dataset
from swarmdata.interop.export import export_dataset, in_frame
from swarmdata.interop.formats import FORMATS, find_format
from swarmdata.learn.training.training_data import framed
from swarmdata.perception.frames import in_world
from swarmdata.registry.presets import preset
from swarmdata.rollouts.function_policy import frame_of
from swarmdata.specs.model_choice import with_models
from tests.interop.foreign import NEEDS
from tests.support.pairs import slow
from tests.support.tiny import make_tiny


@pytest.fixture(scope="module")
def tiny_dataset(tiny: Path) -> Dataset:
    return Dataset.open(tiny)


def test_exports_hold_what_algorithms_learn_from(tiny_dataset: Dataset, tmp_path: Path) -> None:
    """Row by row the batches of the trainer's sampler, which turns them when they are drawn."""
    path = export_dataset(tiny_dataset, tmp_path / "x.hdf5", format="d4rl", frame="target")
    names = ("observations", "next_observations", "actions")
    with h5py.File(path) as file:
        found = {name: file[name][:] for name in names}
    n, n_agents = tiny_dataset.n_steps, tiny_dataset.spec.n_agents
    sampler = framed(tiny_dataset, frame_of(tiny_dataset.spec, "target")).sampler(n, seed=0)
    batch = sampler.gather(np.arange(n))
    for name in names:
        np.testing.assert_array_equal(found[name], getattr(batch, name).reshape(n, -1))
    recorded = tiny_dataset.transitions()["actions"].reshape(n, -1)
    assert np.abs(found["actions"] - recorded).max() > 0.1
    assert found["observations"].shape[1] > n_agents * tiny_dataset[0].observations.shape[-1]


def test_a_policy_sees_and_acts_in_the_exported_frame(
    tiny_dataset: Dataset, tmp_path: Path
) -> None:
    """The inputs of a learned network are the exported observations, and in their frame it acts."""
    pytest.importorskip("torch", reason="learned policies need torch")
    from swarmdata.learn.policies.torch_policy import TorchPolicy, outputs_of
    from swarmdata.learn.training.run_folder import load_run
    from swarmdata.learn.training.trainer import train_seeds
    from tests.learn.training.test_trainer import config_of

    dataset = tiny_dataset
    frame = frame_of(dataset.spec, "target")
    assert frame is not None
    train_seeds(
        "bc", dataset, tmp_path / "run", seeds=(0,), config=config_of("bc", n_updates=3),
        frame=frame, progress=False,
    )  # fmt: skip
    (policy,) = load_run(tmp_path / "run")
    assert isinstance(policy, TorchPolicy)
    exported, recorded = in_frame(dataset, "target")[0].observations, dataset[0].observations
    outputs = outputs_of(replace(policy, frame=None), exported)
    actions = (outputs.tanh() if policy.squash else outputs.clamp(-1, 1)).numpy()
    acted = policy.actions(recorded)
    expected = in_world(frame, recorded, actions).astype(np.float32)
    np.testing.assert_array_equal(acted, expected)
    norm = np.maximum(np.linalg.norm(actions, axis=-1, keepdims=True), 1)
    np.testing.assert_allclose(frame.recorded(recorded, acted), actions / norm, atol=1e-6)


TURNABLE = [name for name in FORMATS if name not in ("mcap", "rosbag2")]
"""Bags hold commands of robots, in the world's frame alone."""


@pytest.mark.parametrize(
    "name",
    [name if name not in ("torchrl", "vault") else slow(name)[0] for name in TURNABLE],
)
def test_a_turned_export_says_so_and_is_not_read_as_a_recording(
    name: str, tiny_dataset: Dataset, tmp_path: Path
) -> None:
    pytest.importorskip(NEEDS.get(name, "h5py"), reason=f"the extra of {name}")
    path = export_dataset(tiny_dataset, tmp_path / tiny_dataset.id, format=name, frame="target")
    if find_format(name).read is not None:
        with pytest.raises(ConversionError, match="exported in the frame 'target', which cannot"):
            import_dataset(path, tmp_path / "back", format=name, id="coop_nav-back-v0")
    elif name == "d4rl-agents":
        for each in path.iterdir():
            with h5py.File(each) as file:
                assert file["metadata/frame"][()] == b"target"
    else:
        assert json.loads((path / "meta/swarmdata.json").read_text())["frame"] == "target"


def test_frames_that_a_dataset_cannot_have(
    tiny_dataset: Dataset, recorded: Dataset, tmp_path: Path
) -> None:
    unicycles = make_tiny(
        tmp_path / "unicycles", spec=preset("coop_nav-unicycle").with_updates(horizon=40)
    )
    for dataset, frame, problem in (
        (Dataset.open(unicycles), "target", "all robots are unicycles"),
        (tiny_dataset, "payload_goal", "needs the observed vector payload_goal_x"),
        (recorded, "target", "the meaning of a recorded environment's features is unknown"),
    ):
        with pytest.raises(SpecError, match=problem):
            export_dataset(dataset, tmp_path / "x", format="d4rl", frame=frame)
        assert not (tmp_path / "x").exists()
    assert in_frame(recorded, "world") is recorded


def test_a_view_by_other_sensors_turns_too(tiny_dataset: Dataset) -> None:
    spec = with_models(tiny_dataset.task, "state", "perfect")
    view = tiny_dataset.reobserve("state", "perfect")
    frame = frame_of(spec, "target")
    assert frame is not None
    turned = in_frame(view, "target")
    np.testing.assert_array_equal(turned[1].observations, frame.inputs(view[1].observations))
    np.testing.assert_array_equal(turned[1].states, view[1].states)
