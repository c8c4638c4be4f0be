"""Domain randomization as data: what each episode draws anew, and from which ranges.

(Tobin et al., "Domain randomization for transferring deep neural networks from simulation to the
real world", IROS 2017; of dynamics: Peng et al., ICRA 2018.)
"""

from swarmdata.specs.frozen import Frozen, NonNegative, Probability
from swarmdata.specs.quantities import (
    Acceleration,
    Delay,
    Force,
    Friction,
    Lag,
    Mass,
    Range,
    Speed,
    TurnRate,
)


class Randomization(Frozen):
    """Ranges, both ends included, from which each episode draws uniformly.

    Each robot draws its own values, from its episode's seed. They replace those of the spec, which
    are all that controllers and layouts know of robots and payload. What is None stays as in the
    spec.
    """

    max_speed: Range[Speed] | None = None  # m/s
    max_acceleration: Range[Acceleration] | None = None  # m/s^2
    max_turn_rate: Range[TurnRate] | None = None  # rad/s, unicycles
    mass: Range[Mass] | None = None  # kg
    friction: Range[Friction] | None = None  # of the hull
    wheel_grip: Range[Acceleration] | None = None
    """m/s^2 up to which wheels do not slip, unicycles."""
    command_delay: Range[Delay] | None = None  # control steps
    actuator_lag: Range[Lag] | None = None  # s
    noise: Range[NonNegative] | None = None
    """Deviation of all noise of a robot's sensors (m, m/s, rad), as in the name `noise-0.05`."""
    drop_probability: Range[Probability] | None = None
    """Chance that a message is lost, one value for the team."""
    payload_mass: Range[Mass] | None = None  # kg
    payload_friction: Range[Force] | None = None  # N, of the floor

    @property
    def ranges(self) -> dict[str, tuple[float, float]]:
        """The ranges that are given, by name."""
        return {name: getattr(self, name) for name in RANDOM_FIELDS if getattr(self, name)}


RANDOM_FIELDS = tuple(Randomization.model_fields)
"""All of them; an episode's draw of a field depends on its index here, so new ones come last."""

PAYLOAD_RANGES = {"payload_mass": "mass", "payload_friction": "friction"}
"""Those of `rules.Payload`, and its fields."""

SENSED_RANGES = {"noise": "observation", "drop_probability": "communication"}
"""Those of a field of a model of the spec, and that model; they change no state."""

TEAM_RANGES = ("drop_probability", *PAYLOAD_RANGES)
"""Those of which an episode draws one value instead of one for each robot."""
