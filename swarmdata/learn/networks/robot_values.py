"""RobotValues, the values of each robot that K seeds learn without any action of a policy."""

from collections.abc import Sequence

from torch import Tensor

from swarmdata.learn.networks.critics import RobotViews
from swarmdata.learn.networks.factored_critics import VALUE_STREAM
from swarmdata.learn.networks.network_inputs import Normalizer
from swarmdata.learn.networks.perceptrons import MLPShape, StackedMLP, initialize, mlp
from swarmdata.learn.networks.setup import Setup


class RobotValues:
    """Maps what a central critic sees of a robot, without actions, to the robot's value.

    Attributes:
        network: with LayerNorm, one for all robots of a seed.

    Args:
        setup: sizes, seeds and the dataset's statistics.
        hidden: sizes of the hidden layers.
    """

    def __init__(self, setup: Setup, hidden: Sequence[int]) -> None:
        normalizer = Normalizer(setup.statistics, setup.device)
        self._views = RobotViews(setup.sizes, normalizer, "centralized", setup.device)
        shape = MLPShape(self._views.n_features, tuple(hidden), 1, layer_norm=True)
        self.network = StackedMLP(shape, setup.n_seeds, setup.device)
        initialize(self.network, setup.seeds, VALUE_STREAM)

    def __call__(
        self, states: Tensor, observations: Tensor, network: StackedMLP | None = None
    ) -> Tensor:
        """Returns V(x_i), [K, R, N].

        Args:
            states: as recorded, [K, R, S].
            observations: in the robots' frames, not normalized, [K, R, N, O].
            network: other parameters to use, such as those of the target.
        """
        x = self._views.view(states, observations)
        return mlp((network or self.network).layers, x.rows).view(x.features.shape[:3])
