"""Reads a `coop_nav` dataset with zarr and NumPy only, and computes its rewards again."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import zarr


def distance(points: Any, obstacle: Any) -> Any:  # points [..., 2], obstacle: a row of layouts
    kind, x, y, ux, uy, a, b, t = obstacle.astype(float)
    p = (points - (x, y)) @ [[ux, -uy], [uy, ux]]  # in the frame of the obstacle
    bars = [((0, t - b), (a, t)), ((t - a, 0), (t, b)), ((a - t, 0), (t, b))][: int(kind)]
    parts = {0: [((0, 0), (0, 0))], 1: [((0, 0), (a, b))]}.get(int(kind), bars)
    outside = [np.maximum(abs(p - centre) - half, 0) for centre, half in parts]
    return np.linalg.norm(outside, axis=-1).min(0) - (a if kind == 0 else 0)


def differences(folder: Path) -> Any:  # of stored and computed rewards, by episode
    spec = json.loads((folder / "recipe.json").read_text())["spec"]
    data: Any = zarr.open_group(folder / "data.zarr", mode="r")
    attributes, share = data["states"].attrs, data["rewards"].attrs["team_share"]
    w = {term["name"]: term["weight"] for term in data["rewards"].attrs["terms"]}
    costs = [w[f"{who}_{how}"] for how in ("contact", "collision") for who in ("robot", "obstacle")]
    radius, arena = (np.array(attributes[name]["value"]) for name in ("radius", "arena"))
    for e, start in enumerate(data["episodes/starts"][:]):
        rows = slice(start, start + data["episodes/lengths"][e])
        states = data["states"][rows.start + e : rows.stop + e + 1].astype(float)
        robots = states.reshape(len(states), -1, 8)  # x, y, vx, vy, ux, uy, tx, ty
        d, p = np.linalg.norm(robots[..., 6:] - robots[..., :2], axis=-1), robots[1:, :, :2]
        others = np.linalg.norm(p[:, :, None] - p[:, None], axis=-1) - radius
        others += np.diag(np.full(len(radius), np.inf))
        obstacles = [distance(p, obstacle) for obstacle in data["episodes/layouts"][e]]
        gap = np.min([*obstacles, others.min(-1), (arena / 2 - abs(p)).min(-1)], axis=0) - radius
        away = d[1:] > spec["rules"]["goal_radius"]
        own = w["progress"] * (d[:-1] - d[1:]) - w["time"] * away
        own += w["success"] * ~away.any(1, keepdims=True)
        own -= w["proximity"] * np.clip(1 - gap / 0.1, 0, 1) + data["events"][rows] @ costs
        yield abs((1 - share) * own + share * own.mean(1, keepdims=True) - data["rewards"][rows])
