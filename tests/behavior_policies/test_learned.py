"""Exact inference: the same bits everywhere, close to float32, and only for checked files."""

import itertools
import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from safetensors.numpy import load_file, save_file

from swarmdata.behavior_policies.checkpoint_files import digest_of
from swarmdata.behavior_policies.exact_actor import forward, load_actor, save_actor
from swarmdata.behavior_policies.learned import Learned
from swarmdata.errors import CheckpointError, SchemaError
from swarmdata.perception.frames import Frame
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Step, blank_step

SPEC = TaskSpec()
SIZE = 53

DIGEST_SCRIPT = """
import hashlib, sys
import numpy as np
from pathlib import Path
from swarmdata.behavior_policies.learned import forward, load_actor
actor = load_actor(Path(sys.argv[1]).read_bytes(), 4, "test")
observations = np.load(sys.argv[2])
print(hashlib.sha256(forward(actor, observations).tobytes()).hexdigest())
"""


def network(seed: int = 0, inputs: int = SIZE, width: int = 64) -> list[tuple[Any, Any]]:
    rng = np.random.default_rng(seed)
    sizes = (inputs, width, width, 2)
    shapes = list(itertools.pairwise(sizes))
    return [(rng.normal(size=s) / np.sqrt(s[0]), rng.normal(size=s[1]) * 0.1) for s in shapes]


def write(path: Path, n_agents: int = 0, **options: Any) -> str:
    """Writes a network; returns its digest."""
    save_actor(path, network(**options), np.full(SIZE, 0.1), np.full(SIZE, 0.7), n_agents)
    return digest_of(path)


def step_of(n_copies: int, seed: int = 1) -> Step:
    rng = np.random.default_rng(seed)
    observations = rng.normal(size=(n_copies, 4, SIZE)).astype(np.float32)
    states = np.zeros((n_copies, 24), dtype=np.float32)
    return blank_step(observations, states, seeds=np.arange(n_copies, dtype=np.uint64))


KERNELS = (("Prescott", "1"), ("Haswell", "2"), ("SkylakeX", "1"))


@pytest.mark.slow
def test_every_blas_kernel_and_thread_count_gives_the_same_bits(tmp_path: Path) -> None:
    write(tmp_path / "actor.safetensors", width=256)
    np.save(tmp_path / "observations.npy", step_of(256).observations)
    files = (str(tmp_path / "actor.safetensors"), str(tmp_path / "observations.npy"))
    digests = []
    for kernel, threads in KERNELS:
        names = {"OPENBLAS_CORETYPE": kernel, "OPENBLAS_NUM_THREADS": threads}
        run = subprocess.run(
            [sys.executable, "-c", DIGEST_SCRIPT, *files],
            env={**os.environ, **names, "OMP_NUM_THREADS": threads},
            check=False,
            capture_output=True,
            text=True,
        )
        if run.returncode == -signal.SIGILL:  # this processor lacks the kernel's instructions
            continue
        assert run.returncode == 0, run.stderr
        digests.append(run.stdout)
    assert len(digests) >= 2
    assert len(set(digests)) == 1


def test_summation_order_cannot_change_a_bit(tmp_path: Path) -> None:
    write(tmp_path / "actor.safetensors")
    actor = load_actor((tmp_path / "actor.safetensors").read_bytes(), 4, "test")
    order = np.random.default_rng(2).permutation(SIZE)
    (weight, bias), *rest = actor.layers
    shuffled = actor._replace(
        mean=actor.mean[order], scale=actor.scale[order], layers=((weight[order], bias), *rest)
    )
    observations = step_of(64).observations
    expected = forward(actor, observations)
    assert forward(shuffled, observations[..., order]).tobytes() == expected.tobytes()
    rows = np.random.default_rng(3).permutation(64)
    assert forward(actor, observations[rows]).tobytes() == expected[rows].tobytes()


@pytest.mark.parametrize("n_agents", [0, 4])
def test_agrees_with_a_plain_float32_network(tmp_path: Path, n_agents: int) -> None:
    write(tmp_path / "actor.safetensors", inputs=SIZE + n_agents, n_agents=n_agents)
    actor = load_actor((tmp_path / "actor.safetensors").read_bytes(), 4, "test")
    observations = step_of(32).observations
    x = (observations - np.float32(0.1)) * np.float32(0.7)
    if n_agents:
        x = np.concatenate([x, np.broadcast_to(np.eye(4, dtype=np.float32), (32, 4, 4))], axis=-1)
    layers = network(inputs=SIZE + n_agents)
    for i, (weight, bias) in enumerate(layers):
        x = x @ weight.astype(np.float32) + bias.astype(np.float32)
        x = np.maximum(x, 0) if i < 2 else np.clip(x, -1, 1)
    actions = forward(actor, observations)
    np.testing.assert_allclose(actions, x, atol=5e-3)
    assert actions.std() > 0.1
    np.testing.assert_array_equal(actions * 4096, np.round(actions * 4096))


def test_noise_is_gaussian_and_a_function_of_seed_and_time(tmp_path: Path) -> None:
    path = tmp_path / "actor.safetensors"
    zeros = [(weight * 0, bias * 0) for weight, bias in network()]
    save_actor(path, zeros, np.zeros(SIZE), np.ones(SIZE))
    policy = Learned(SPEC, checkpoint=path, sha256=digest_of(path), noise=0.2)
    step = step_of(5000)
    actions = policy.act(step)
    assert abs(float(actions.mean())) < 0.005
    assert abs(float(actions.std()) - 0.2) < 0.005
    again = policy.act(step._replace(observations=step.observations * 2))
    assert again.tobytes() == actions.tobytes()
    assert policy.act(step._replace(times=step.times + 1)).tobytes() != actions.tobytes()


def test_saving_rounds_by_half_a_step_and_always_gives_the_same_file(tmp_path: Path) -> None:
    digest = write(tmp_path / "actor.safetensors")
    actor = load_actor((tmp_path / "actor.safetensors").read_bytes(), 4, "test")
    changes = [
        np.abs(new - old).max()
        for layers in zip(actor.layers, network(), strict=True)
        for new, old in zip(*layers, strict=True)
    ]
    assert 0.0 < max(changes) <= 2.0**-13
    assert write(tmp_path / "again.safetensors") == digest


def test_a_corrupted_file_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "actor.safetensors"
    digest = write(path)
    data = bytearray(path.read_bytes())
    data[-1] ^= 1
    path.write_bytes(data)
    with pytest.raises(CheckpointError, match="has SHA-256"):
        Learned(SPEC, checkpoint=path, sha256=digest)
    with pytest.raises(CheckpointError, match="not a safetensors file"):
        load_actor(bytes(data[: len(data) // 2]), 4, "half")


def test_a_missing_file_is_named() -> None:
    with pytest.raises(CheckpointError, match="no_such_actor"):
        Learned(SPEC, checkpoint="no_such_actor.safetensors", sha256="0" * 64)
    with pytest.raises(CheckpointError, match="not the name of a file"):
        Learned(SPEC, checkpoint="../actor.safetensors", sha256="0" * 64)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"layers.1.weight": np.full((64, 64), 9.0)}, "weight or bias of 9"),
        ({"layers.1.weight": np.full((64, 64), np.nan)}, "weight or bias of nan"),
        ({"layers.1.weight": np.full((64, 64), 0.1)}, "not on the grid"),
        ({"layers.1.weight": np.zeros((63, 64))}, "do not fit together"),
        ({"layers.2.bias": np.zeros(3)}, "do not fit together"),
        ({"layers.0.weight": np.zeros((SIZE + 3, 64))}, "first layer takes 56"),
        ({"input.scale": np.full(SIZE, np.inf)}, "not finite"),
        ({"input.scale": np.zeros(SIZE - 1)}, "malformed"),
        ({"extra": np.zeros(1)}, "holds tensors"),
    ],
)
def test_what_cannot_be_run_exactly_is_refused(
    tmp_path: Path, change: dict[str, Any], message: str
) -> None:
    tensors = {"input.mean": np.zeros(SIZE), "input.scale": np.ones(SIZE)}
    for i, (weight, bias) in enumerate(network()):
        tensors[f"layers.{i}.weight"], tensors[f"layers.{i}.bias"] = weight * 0, bias * 0
    path = tmp_path / "actor.safetensors"
    save_file(tensors, path)
    load_actor(path.read_bytes(), 4, "good")
    save_file({**tensors, **change}, path)
    with pytest.raises(CheckpointError, match=message):
        load_actor(path.read_bytes(), 4, "bad")


@pytest.mark.parametrize("unicycles", [(), (4,), (10, (0, 2))])
@pytest.mark.parametrize("heard", [(), ((20, 2, 24), (30, 2, -1))])
def test_an_actor_keeps_its_frame(
    tmp_path: Path, heard: tuple[tuple[int, int, int], ...], unicycles: tuple[Any, ...]
) -> None:
    frame = Frame(4, (0, 2, 4, 8), ((8, 2),), heard, *unicycles)
    size = SIZE + frame.n_added
    path = tmp_path / "actor.safetensors"
    save_actor(path, network(inputs=size), np.zeros(size), np.ones(size), frame=frame)
    assert load_actor(path.read_bytes(), 4, "good").frame == frame


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"frame.heard": np.zeros((1, 2))}, r"frame.heard \[H, 3\]"),
        ({"frame.closing": np.zeros(2)}, "has frame tensors"),
        ({"frame.heard": np.full((1, 3), SIZE)}, "features that its observations lack"),
        ({"frame.mixed": np.array([SIZE, 0])}, "features that its observations lack"),
        ({"frame.mixed": np.array([8, 4])}, "frame.mixed .* then robots below 4"),
        ({"frame.mixed": np.zeros(0)}, "expected the column of the heading"),
    ],
)
def test_a_frame_that_does_not_fit_is_refused(
    tmp_path: Path, change: dict[str, Any], message: str
) -> None:
    path = tmp_path / "actor.safetensors"
    frame = Frame(4, (4,), ((8, 2),))
    size = SIZE + frame.n_added
    save_actor(path, network(inputs=size), np.zeros(size), np.ones(size), frame=frame)
    save_file({**load_file(path), **change}, path)
    with pytest.raises(CheckpointError, match=message):
        load_actor(path.read_bytes(), 4, "bad")


def test_saving_refuses_large_weights(tmp_path: Path) -> None:
    layers = [(weight * 100, bias) for weight, bias in network()]
    with pytest.raises(CheckpointError, match="weight or bias"):
        save_actor(tmp_path / "actor.safetensors", layers, np.zeros(SIZE), np.ones(SIZE))
    assert not (tmp_path / "actor.safetensors").exists()


def test_other_observations_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "actor.safetensors"
    policy = Learned(SPEC, checkpoint=path, sha256=write(path))
    step = step_of(2)
    with pytest.raises(SchemaError, match="have 40 features"):
        policy.act(step._replace(observations=step.observations[..., :40]))


def test_squashed_outputs_are_the_tanh_of_the_same_network(tmp_path: Path) -> None:
    mean, scale = np.full(SIZE, 0.1), np.full(SIZE, 0.7)
    layers = network()
    save_actor(tmp_path / "clipped", layers, mean, scale)
    save_actor(tmp_path / "squashed", layers, mean, scale, squash=True)
    clipped, squashed = (
        load_actor((tmp_path / name).read_bytes(), 4, name) for name in ("clipped", "squashed")
    )
    assert (clipped.squash, squashed.squash) == (False, True)
    observations = step_of(50).observations
    outputs, answers = forward(clipped, observations), forward(squashed, observations)
    inside = np.abs(outputs) < 1.0  # beyond, the clipped network says less
    np.testing.assert_allclose(answers[inside], np.tanh(outputs[inside]), atol=2.0**-12)
    assert (np.abs(answers) <= 1.0).all()
    np.testing.assert_array_equal(answers * 2.0**12, np.rint(answers * 2.0**12))
