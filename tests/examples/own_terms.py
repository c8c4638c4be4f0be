"""Reads a `search` or `intersection` dataset with zarr and NumPy only; computes its rewards again.

The task's own terms are computed from the states, as the attributes of `rewards` define them.
"""

import re
from pathlib import Path
from typing import Any

import numpy as np
import zarr


def search(of: Any, x: Any, y: Any, tx: Any, ty: Any) -> dict[str, Any]:
    known, searched = of(r"known_\d+"), of(r"searched_\d+")
    rescued = of("rescued", [r"victim_\d+"])[:, 0]
    closer = np.hypot(tx - x, ty - y)[:-1] - np.hypot(tx[:-1] - x[1:], ty[:-1] - y[1:])
    return {
        "progress": (known[:-1] == 1).any(-1) * closer,
        "sighting": ((known[:-1] == 0) & (known[1:] != 0)).sum(-1),
        "searched": (searched[1:] - searched[:-1]).sum(-1),
        "rescue": (rescued[1:] - rescued[:-1]).sum(-1, keepdims=True) + 0 * closer,
        "time": np.ones_like(closer),
    }


def intersection(of: Any, x: Any, y: Any, tx: Any, ty: Any) -> dict[str, Any]:
    crossing, crossings = of("crossing")[..., 0], of("crossings")[..., 0]
    before = (abs(tx - x) + abs(ty - y))[:-1]
    return {
        "progress": before - abs(tx[:-1] - x[1:]) - abs(ty[:-1] - y[1:]),
        "entry": crossing[1:] > crossing[:-1],
        "crossing": crossings[1:] - crossings[:-1],
        "time": np.ones_like(before),
    }


def differences(folder: Path) -> Any:  # of stored and computed rewards, by episode
    data: Any = zarr.open_group(folder / "data.zarr", mode="r")
    names = [column["name"] for column in data["states"].attrs["columns"]]
    agents, share = data["states"].attrs["agents"], data["rewards"].attrs["team_share"]
    for e, start in enumerate(data["episodes/starts"][:]):
        rows = slice(start, start + data["episodes/lengths"][e])
        states = data["states"][rows.start + e : rows.stop + e + 1].astype(float)

        def of(name: str, owners: Any = agents, states: Any = states) -> Any:  # [T+1, N, columns]
            found = (re.compile(rf"{owner}\.{name}").fullmatch for owner in owners)
            return np.stack([states[:, [bool(each(c)) for c in names]] for each in found], 1)

        compute = search if "victim_0.x" in names else intersection
        terms = compute(of, *(of(name)[..., 0] for name in ("x", "y", "tx", "ty")))
        own: Any = 0.0  # the terms that all tasks share are taken as they are stored
        for k, term in enumerate(data["rewards"].attrs["terms"]):
            stored = data["reward_terms"][rows][..., k].astype(float)
            own = own + term["sign"] * term["weight"] * terms.get(term["name"], stored)
        yield abs((1 - share) * own + share * own.mean(1, keepdims=True) - data["rewards"][rows])
