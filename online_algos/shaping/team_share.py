"""TeamShare, rewards that are partly the team's mean."""

from swarmdata.types import Float, Step


class TeamShare:
    """Mixes every robot's reward with the team's: (1 - share) r_i + share mean_j r_j.

    Args:
        share: of the mean, in [0, 1].
    """

    def __init__(self, share: float) -> None:
        self.share = share

    def apply(self, rewards: Float, before: Step, after: Step, progress: float) -> Float:
        """Returns the mixed rewards, [E, N]."""
        mean = rewards.mean(1, keepdims=True)
        mixed: Float = (1 - self.share) * rewards + self.share * mean
        return mixed
