"""Values of a batch's actions by critics of several kinds, for `extraction.second_stage`."""

from dataclasses import dataclass

from torch import Tensor

from swarmdata.learn.networks.critics import Critics, JointGradient
from swarmdata.learn.networks.factored_critics import FactoredCritics
from swarmdata.learn.networks.robot_critics import RobotCritics
from swarmdata.learn.networks.robot_views import RobotView


@dataclass(frozen=True, slots=True, eq=False)
class RobotValuer:
    """By critics of each robot: the smallest of the J values.

    Attributes:
        critics: their parameters are constants.
        view: what they see of the batch.
        actions: of the data, [K, B, N, A].
        joint_gradient: whose actions are the policies' in a robot's value: "all", or its "own".
    """

    critics: RobotCritics
    view: RobotView
    actions: Tensor
    joint_gradient: JointGradient

    def of_policy(self, pi: Tensor) -> Tensor:
        """As `second_stage.Valuer` says."""
        others = pi if self.joint_gradient == "all" else self.actions
        return self.critics.smallest_q(self.view, pi, others)

    def of_candidates(self, candidates: Tensor) -> Tensor:
        """As `second_stage.Valuer` says."""
        return self.critics.candidate_q(self.view, candidates, self.actions)


@dataclass(frozen=True, slots=True, eq=False)
class RowValuer:
    """By critics with a row for each robot, which see its own action: the smallest of the J values.

    Attributes:
        critics: their parameters are constants.
        x: what they see besides actions, [K, B N, F].
    """

    critics: Critics
    x: Tensor

    def of_policy(self, pi: Tensor) -> Tensor:
        """As `second_stage.Valuer` says."""
        values = self.critics.smallest_q(self.x, pi.flatten(1, 2)[:, :, None])
        return values.view(pi.shape[:3])

    def of_candidates(self, candidates: Tensor) -> Tensor:
        """As `second_stage.Valuer` says."""
        return self.critics.smallest_q(self.x, candidates.flatten(1, 2)).view(candidates.shape[:4])


@dataclass(frozen=True, slots=True, eq=False)
class FactoredValuer:
    """By critics that mix the robots' values into the team's: the smallest of the J team values.

    Robot i's value of a candidate is the team's if robot i alone leaves the data. Of the policies'
    actions, each robot gets an equal share of the team's value, so that the gradient of the sum is
    that of the team's value.

    Attributes:
        critics: their parameters are constants.
        states: normalized, [K, B, S].
        observations: normalized, [K, B, N, O].
        actions: of the data, [K, B, N, A].
    """

    critics: FactoredCritics
    states: Tensor
    observations: Tensor
    actions: Tensor

    def of_policy(self, pi: Tensor) -> Tensor:
        """As `second_stage.Valuer` says."""
        n_agents = pi.shape[2]
        values = self.critics.smallest_q(self.states, self.observations, pi)  # [K, B]
        return (values / n_agents)[..., None].expand(-1, -1, n_agents)

    def of_candidates(self, candidates: Tensor) -> Tensor:
        """As `second_stage.Valuer` says."""
        return self.critics.candidate_q(self.states, self.observations, candidates, self.actions)
