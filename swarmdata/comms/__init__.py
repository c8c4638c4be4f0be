"""Who hears what, and when: a radio channel between the robots of a team."""

from swarmdata.comms.channel import Channel

__all__ = ["Channel"]
