"""Setup: what every offline algorithm is made from beside its settings."""

from collections.abc import Sequence
from dataclasses import dataclass

import torch

from swarmdata.errors import SpecError
from swarmdata.learn.networks.dataset_statistics import Statistics
from swarmdata.learn.networks.network_inputs import generators
from swarmdata.learn.networks.sizes import Sizes


def check_device(device: str) -> None:
    """Refuses a device that torch does not have here, before anything is loaded.

    Raises:
        SpecError: it does not.
    """
    try:
        torch.empty(1, device=device)
    except (RuntimeError, AssertionError) as error:  # whichever torch raises, by its build
        raise SpecError(
            f"torch has no device {device!r} here, expected cpu, or cuda with a GPU and a torch "
            "that was built for it"
        ) from error


@dataclass(frozen=True, slots=True, eq=False)
class Setup:
    """Networks' sizes, seeds, the dataset's statistics, and where to train."""

    sizes: Sizes
    seeds: Sequence[int]  # of initial parameters and noise, [K]
    statistics: Statistics  # for normalization, the scale of rewards, and R*
    device: torch.device | str = "cpu"
    n_episodes: int = 0  # of the data, for what is learned of each; 0 where that is not known

    @property
    def n_seeds(self) -> int:
        """Number of seeds, K."""
        return len(self.seeds)

    def generators(self) -> list[torch.Generator]:
        """Makes one generator of noise for each seed, [K]."""
        return generators(self.seeds, self.device)
