"""Rendering: pictures of a state, animations of an episode, and both in notebooks."""

from swarmdata.envs.render.canvas import Image
from swarmdata.envs.render.colors import ROBOT_COLORS
from swarmdata.envs.render.drawn_scene import Messages
from swarmdata.envs.render.picture import draw, save_png
from swarmdata.envs.render.video import Picture, animate, play, show

__all__ = [
    "ROBOT_COLORS",
    "Image",
    "Messages",
    "Picture",
    "animate",
    "draw",
    "play",
    "save_png",
    "show",
]
