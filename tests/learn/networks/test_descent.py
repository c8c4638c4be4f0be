"""Networks that descend together, their targets, and their states."""

import pytest

torch = pytest.importorskip("torch", reason="the toolbox needs torch")

from swarmdata.learn.networks.descent import Descent  # noqa: E402
from swarmdata.learn.networks.perceptrons import MLPShape, StackedMLP, initialize  # noqa: E402


def made(first_seed: int = 0) -> Descent:
    networks = {name: StackedMLP(MLPShape(3, (4,), 1), 2, "cpu") for name in ("one", "other")}
    for stream, network in enumerate(networks.values()):
        initialize(network, (first_seed, first_seed + 1), stream)
    return Descent(networks, 2, 0.01, 1.0, followed=("one",))


def step(descent: Descent) -> None:
    x = torch.ones(2, 5, 3)
    outputs = [network(x) for network in descent.networks.values()]
    descent.step(sum(out.square().mean((1, 2)) for out in outputs))
    descent.follow(0.25)


def test_all_networks_move_and_targets_follow_theirs() -> None:
    descent = made()
    old = {name: network.flat.clone() for name, network in descent.networks.items()}
    step(descent)
    for name, network in descent.networks.items():
        assert not torch.equal(network.flat, old[name]), name
    assert list(descent.targets) == ["one"]
    moved = old["one"] + 0.25 * (descent.networks["one"].flat - old["one"])
    torch.testing.assert_close(descent.targets["one"].flat, moved)


def test_a_state_restores_everything() -> None:
    ours, other = made(), made(7)
    for _ in range(3):
        step(ours)
    saved = ours.state_dict()
    assert {"one", "other", "target_one", "one_adam.exp_avg"} <= saved.keys()
    assert "target_other" not in saved
    other.load_state_dict(saved)
    for descent in (ours, other):
        step(descent)
    theirs = other.state_dict()
    for name, value in ours.state_dict().items():
        assert torch.equal(value, theirs[name]), name
