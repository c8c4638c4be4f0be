"""Who hears what, and when: a radio channel between the robots of a team."""

from swarmdata.comms.channel import Channel
from swarmdata.comms.names import communication_model

__all__ = ["Channel", "communication_model"]
