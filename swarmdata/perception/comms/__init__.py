"""The radio channel between the robots of a team."""

from swarmdata.perception.comms.channel import Channel

__all__ = ["Channel"]
