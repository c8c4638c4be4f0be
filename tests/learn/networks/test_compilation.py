"""Compilable functions: plain outside `compiling`, compiled inside, with one clear error."""

from collections.abc import Iterator
from pathlib import Path

import pytest
import torch
from torch import Tensor

from swarmdata.datasets.dataset import Dataset
from swarmdata.errors import CheckpointError, ProgramError, SchemaError
from swarmdata.learn.networks import compilation
from swarmdata.learn.networks.compilation import compilable, compiling, uncompiled
from swarmdata.learn.networks.perceptrons import MLPShape, StackedMLP, initialize
from swarmdata.learn.training.run_folder import read_run
from swarmdata.learn.training.trainer import train_seeds
from swarmdata.offline_algos.bc import BC, BCConfig
from swarmdata.testing.synthetic import make_dataset

CONFIG = BCConfig(n_updates=12, batch_size=8, hidden=(8,))


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Graphs are traced, but run as they are: no compiler, no waiting."""
    monkeypatch.setattr(compilation, "BACKEND", "eager")
    torch._dynamo.reset()
    yield
    torch._dynamo.reset()


def small(folder: Path) -> Dataset:
    make_dataset(folder / "ds", [[9, 8, 9, 8, 7, 9, 9, 9, 9, 9]])
    return Dataset.open(folder / "ds").split("train")


@compilable
def distances(values: Tensor, factor: float) -> Tensor:
    return factor * (values - values.mean()).square()


def test_outside_a_function_runs_as_it_is_written() -> None:
    assert distances.__name__ == "distances"
    torch.testing.assert_close(distances(torch.tensor([1.0, 3.0]), 2.0), torch.tensor([2.0, 2.0]))


@pytest.mark.slow
@pytest.mark.usefixtures("quick")
def test_inside_each_combination_of_shapes_and_constants_is_compiled() -> None:
    values = torch.arange(4.0)
    with compiling() as compilation:
        first = compilation.n_graphs
        for _ in range(3):
            torch.testing.assert_close(distances(values, 2.0), 2.0 * (values - 1.5).square())
        assert compilation.n_graphs == first + 1
        distances(values, 3.0)
        distances(values[:3], 3.0)
        assert compilation.n_graphs == first + 3
        with uncompiled():
            distances(values[:2], 3.0)
        assert compilation.n_graphs == first + 3
        assert compilation.seconds > 0
        assert str(compilation).startswith(f"compiled {first + 3} graphs in ")


@pytest.mark.slow
@pytest.mark.usefixtures("quick")
def test_a_gradient_is_part_of_the_graph() -> None:
    network = StackedMLP(MLPShape(3, (8,), 2, layer_norm=True), 2, "cpu")
    initialize(network, [0, 1], stream=0)

    @compilable
    def descend(inputs: Tensor) -> Tensor:
        loss = network(inputs).square().mean((1, 2))
        network.backward(loss.sum())
        return loss.detach()

    inputs = torch.randn(2, 5, 3)
    loss, gradient = descend(inputs), network.gradient.clone()
    network.gradient.zero_()
    with compiling():
        torch.testing.assert_close(descend(inputs), loss)
    torch.testing.assert_close(network.gradient, gradient)


def test_what_does_not_compile_is_one_clear_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(compilation, "BACKEND", "no such backend")
    torch._dynamo.reset()
    with pytest.raises(ProgramError, match=r"install g\+\+ or clang.*train without"), compiling():
        raise AssertionError("not reached")
    assert distances(torch.ones(2), 1.0).sum() == 0  # and it is switched off again


@pytest.mark.slow
@pytest.mark.usefixtures("quick")
def test_a_compiled_run_is_recorded_told_and_goes_on_as_it_began(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    data = small(tmp_path)
    folder, plain = tmp_path / "run", tmp_path / "plain"
    policies = train_seeds("bc", data, folder, config=CONFIG, compile=True, progress=False)
    assert "bc: compiled" in capsys.readouterr().err
    assert "inductor" in read_run(folder).versions
    expected = train_seeds("bc", data, plain, config=CONFIG, progress=False)
    assert "inductor" not in read_run(plain).versions
    for ours, theirs in zip(policies, expected, strict=True):
        torch.testing.assert_close(ours.layers, theirs.layers)  # type: ignore[attr-defined]
    with pytest.raises(CheckpointError, match="versions"):
        train_seeds("bc", data, folder, config=CONFIG, progress=False)


def test_an_algorithm_without_compilable_methods_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(BC, "_gradient", None)
    data = small(tmp_path)
    with pytest.raises(SchemaError, match=r"bc has nothing to compile.*without"):
        train_seeds("bc", data, tmp_path / "run", config=CONFIG, compile=True, progress=False)
