"""The numbers with which the catalogue replays an episode of our worlds, as integers.

Columns that change with time have a row for each state; a step is in that of the state after it.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from swarmdata.catalogue.drawings.svg_shapes import hex_color
from swarmdata.datasets.reobservation import attempted_links
from swarmdata.envs.render.colors import robot_color
from swarmdata.registry.appearance import MOST_MOMENTS
from swarmdata.registry.components import appearance_of, make_task, reward_terms
from swarmdata.specs.sensing_models import BearingModel, Broadcast, LidarModel, OccupancyModel
from swarmdata.specs.state_layout import BODY, N_COLUMNS, TX, TY, UX, UY, X, Y, robots_of
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import EVENTS, Bool, Double, Episode, Float, Int

MILLIMETRE = 0.001  # m
WIDEST_FINE_ARENA = 30.0  # m; wider ones are rounded to a 30,000th of their width
TURN = 1024  # units of a full turn
REWARD_UNIT = 0.001
SENDERS_IN_A_WORD = 15
"""Links of a receiver are bits of words of 16 bits, whose sign bit stays free."""

_CONTACT_BITS = {"robot_contact": 0, "obstacle_contact": 1}
_ONSET_BITS = {"robot_onsets": 2, "obstacle_onsets": 5}  # three bits each
_FIRST_MOMENT_BIT = 8
_MOST_ONSETS = 7

Columns = NDArray[np.integer]


class Group(NamedTuple):
    """Neighbouring columns of one meaning, as the browser gets them."""

    name: str
    n_columns: int
    unit: float  # what one means, in the unit of the browser's drawing: m, rad or a code


class WorldColumns:
    """Turns episodes of a task into integers, and describes them to the browser.

    The spec's models say what robots sense and hear.
    """

    def __init__(self, spec: TaskSpec) -> None:
        self.spec = spec
        self._quantum = max(
            MILLIMETRE, max(spec.arena.width, spec.arena.height) * MILLIMETRE / WIDEST_FINE_ARENA
        )
        task = make_task(spec)
        self._look = appearance_of(spec)
        self._terms = [term.name for term in reward_terms(task)]
        self._moments = [
            each for each in self._look.moments[:MOST_MOMENTS] if each.term in self._terms
        ]
        self._has_headings = any(robot.dynamics == "unicycle" for robot in spec.robots)

    def moving(self, episode: Episode) -> list[tuple[Group, Columns]]:
        """The columns that change with time, [T+1, count] each."""
        robots = robots_of(episode.states, self.spec.n_agents)
        found = [
            self._lengths("x", robots[..., X]),
            self._lengths("y", robots[..., Y]),
            self._lengths("tx", robots[..., TX]),
            self._lengths("ty", robots[..., TY]),
        ]
        if self._has_headings:
            found.append(_angles("angle", robots[..., UX], robots[..., UY]))
        found += self._bodies(episode.states)
        found += self._own(episode.states)
        found.append(self._events(episode))
        rewards = episode.rewards.mean(axis=1, dtype=np.float64)
        codes = np.clip(np.rint(rewards / REWARD_UNIT), -32768, 32767).astype(np.int64)
        found.append((Group("reward", 1, REWARD_UNIT), _after(codes[:, None])))
        return [*found, *self._links(episode)]

    def fixed(self, episode: Episode) -> list[tuple[Group, Columns]]:
        """The columns that are the same throughout an episode, [1, count] each."""
        layout = episode.layout
        lengths = layout[:, [1, 2, 5, 6, 7]]
        found = [
            _group("obstacle_kind", layout[None, :, 0]),
            self._lengths("obstacle_size", lengths.reshape(1, -1)),
            _angles("obstacle_angle", layout[None, :, 3], layout[None, :, 4]),
        ]
        look, extras = self._look, self._extras(episode.states[:1])
        if look.shared is not None:
            found.append(self._lengths("goal", extras[:, : 2 * look.shared.n]))
        if look.direction is not None:
            ux, uy = extras[:, look.direction, None], extras[:, look.direction + 1, None]
            found.append(_angles("goal_angle", ux, uy))
        return found

    def _extras(self, states: Float) -> Float:
        """The task's own columns, [T, K]."""
        return states[:, N_COLUMNS * self.spec.n_agents + len(BODY) * len(self._look.bodies) :]

    def _bodies(self, states: Float) -> list[tuple[Group, Columns]]:
        if not self._look.bodies:
            return []
        first, n = N_COLUMNS * self.spec.n_agents, len(self._look.bodies)
        bodies = states[:, first : first + len(BODY) * n].reshape(len(states), n, len(BODY))
        places = bodies[..., :2].reshape(len(states), -1)
        return [
            self._lengths("body", places),
            _angles("body_angle", bodies[..., 4], bodies[..., 5]),
        ]

    def _own(self, states: Float) -> list[tuple[Group, Columns]]:
        """What robots carry, and which shared targets are reached, and known, as flags."""
        look, extras = self._look, self._extras(states)
        found: list[tuple[Group, Columns]] = []
        if look.carrying:
            found.append(_group("carrying", extras[:, list(look.carrying)] > 0))
        if look.shared is None:
            return found
        n, reached, known = look.shared
        if reached is not None:
            found.append(_group("reached", extras[:, reached:][:, :n] > 0))
        if known is not None:
            by_robot = extras[:, known:][:, : n * self.spec.n_agents] > 0
            anyone = np.asarray(by_robot.reshape(len(states), -1, n).any(axis=1))
            found.append(_group("known", anyone))
        return found

    def _events(self, episode: Episode) -> tuple[Group, Columns]:
        """One code for each robot and step: contacts, how many began, and the task's moments."""
        events = episode.events.astype(np.int64)
        codes = np.zeros(events.shape[:2], np.int64)
        for name, bit in {**_CONTACT_BITS, **_ONSET_BITS}.items():
            codes |= np.minimum(events[..., EVENTS.index(name)], _MOST_ONSETS) << bit
        if episode.reward_terms is not None:
            for k, moment in enumerate(self._moments):
                happened = episode.reward_terms[..., self._terms.index(moment.term)] > 0
                codes |= happened.astype(np.int64) << (_FIRST_MOMENT_BIT + k)
        return _group("event", _after(codes))

    def _links(self, episode: Episode) -> list[tuple[Group, Columns]]:
        """Messages that arrived, that arrived late, and that were lost, as bits of senders."""
        attempted = attempted_links(episode, self.spec)
        if attempted is None:  # there is no channel
            return []
        others = ~np.eye(self.spec.n_agents, dtype=np.bool_)
        arrived = episode.delivered & others
        lost = attempted & ~episode.delivered & others
        return [self._bits("heard", arrived), self._bits("lost", lost)]

    def _bits(self, name: str, links: Bool) -> tuple[Group, Columns]:
        """Packs links [T+1, receivers, senders] into words, [T+1, receivers * words]."""
        n, words = links.shape[1], []
        for first in range(0, n, SENDERS_IN_A_WORD):
            some = links[..., first : first + SENDERS_IN_A_WORD]
            words.append((some << np.arange(some.shape[-1])).sum(axis=-1))
        return _group(name, np.stack(words, axis=-1).reshape(len(links), -1))

    def _lengths(self, name: str, values: Float | Double) -> tuple[Group, Columns]:
        return _group(name, values, self._quantum)

    def describe(self) -> dict[str, Any]:
        """What the browser needs to know of the world, JSON."""
        spec, look, radio = self.spec, self._look, self.spec.communication
        robots = [
            {"radius": role.robot.radius, "role": k, "turns": role.robot.dynamics == "unicycle"}
            for k, role in enumerate(spec.team)
            for _ in range(role.count)
        ]
        return {
            "task": spec.task,
            "width": spec.arena.width,
            "height": spec.arena.height,
            "dt": spec.control_dt,
            "robots": robots,
            "names": list(spec.agent_names),
            "colors": [hex_color(robot_color(i)) for i in range(spec.n_agents)],
            "mark": look.mark,
            "target_radius": look.radius,
            "is_shared": look.shared is not None,
            "is_linked": look.is_linked,
            "nowhere": look.nowhere,
            "moments": [list(moment) for moment in self._moments],
            "payloads": [
                {"shape": each.shape, "a": each.half_length, "b": each.half_width}
                for each in look.bodies
            ],
            "sensor": _sensor(spec),
            "radio": {"delay": radio.delay, "range": radio.range, "payload": radio.payload}
            if isinstance(radio, Broadcast)
            else None,
        }


def _angles(name: str, ux: Float, uy: Float) -> tuple[Group, Columns]:
    """Directions as unwrapped angles: full turns are multiples of `TURN`, so wrapping is exact."""
    angles = np.unwrap(np.arctan2(uy, ux).astype(np.float64), axis=0)
    return _group(name, angles, 2 * np.pi / TURN)


def _group(name: str, values: NDArray[Any], unit: float = 1.0) -> tuple[Group, Columns]:
    """Columns of values, [T, C], as whole numbers of a unit."""
    codes = np.rint(values.astype(np.float64) / unit).astype(np.int64)
    return Group(name, values.shape[1], unit), codes


def _after(steps: Int) -> Int:
    """Rows of steps, [T, C], as rows of the states that they led to, [T+1, C]."""
    return np.concatenate([np.zeros_like(steps[:1]), steps])


def _sensor(spec: TaskSpec) -> dict[str, Any]:
    """Kind of the sensor and how far each robot sees, m; None: without a limit."""
    model = spec.observation
    ranges: list[float | None] = []
    if isinstance(model, LidarModel | BearingModel):
        ranges += [min(model.range, robot.sensor_range or model.range) for robot in spec.robots]
        rays = {"rays": model.n_rays} if isinstance(model, LidarModel) else {}
        return {"kind": model.kind, "ranges": ranges, **rays}
    if isinstance(model, OccupancyModel):
        return {"kind": "occupancy", "half": model.cells * model.cell_size / 2, "ranges": []}
    for robot in spec.robots:  # the limits are gaps from the robot's surface
        limits = [limit for limit in (model.limit, robot.sensor_range) if limit is not None]
        ranges.append(robot.radius + min(limits) if limits else None)
    return {"kind": "state", "ranges": ranges}
