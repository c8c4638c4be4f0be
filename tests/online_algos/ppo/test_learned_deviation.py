"""Learned deviations: their start, their entropy, and what an actor's gradient does to them."""

import math

import pytest

torch = pytest.importorskip("torch", reason="online algorithms need the torch extra")

from torch.distributions import Normal  # noqa: E402

from swarmdata.learn.networks.optimizer import StackedAdam  # noqa: E402
from swarmdata.online_algos.ppo.networks import LearnedDeviation  # noqa: E402


@pytest.mark.parametrize("n_components", [1, 2])
def test_deviations_and_entropy_are_those_of_a_normal(n_components: int) -> None:
    deviation = LearnedDeviation(3, n_components, 0.3)
    torch.testing.assert_close(deviation.std, torch.full((3, 1, n_components), 0.3))
    one = Normal(0.0, 0.3).entropy()  # type: ignore[no-untyped-call]
    torch.testing.assert_close(deviation.entropy, (n_components * one).expand(3))


def test_each_actor_has_its_own() -> None:
    deviation = LearnedDeviation(2, 2, 0.5)
    adam = StackedAdam(deviation.network, 2, 0.1)
    adam.step(-deviation.entropy * torch.tensor([1.0, 0.0]))
    first, second = deviation.std.detach()
    torch.testing.assert_close(first, torch.full((1, 2), 0.5 * math.exp(0.1)))
    torch.testing.assert_close(second, torch.full((1, 2), 0.5))
