"""Environment steps a second on one core, beside peers and physics alone, into docs/benchmarks.md.

    python -m tests.benchmarks.bench_worlds [SECTION ...]

Sections: state lidar one tasks growth. VMAS is measured if it is installed (`pip install vmas`).
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("MKL_NUM_THREADS", "1")

import math
import sys
from collections.abc import Callable
from importlib.util import find_spec

from swarmdata.registry.presets import preset, preset_names
from swarmdata.specs.sensing_models import Broadcast, LidarModel
from swarmdata.specs.task_spec import TaskSpec
from tests.benchmarks.engines import Run, mpe2, physics, swarm, swarm_parallel, vmas
from tests.benchmarks.measuring import Rate, interleave, short, table, write_section
from tests.benchmarks.processes import measure_processes

ALL_CORES = os.sched_getaffinity(0) if hasattr(os, "sched_getaffinity") else {0}

TEAMS = (4, 8, 16, 32)
COPIES = (1, 16, 64, 256)
PEER_BATCHES = (256, 1024, 4096)
SLOWEST = 1.5
"""Seconds that one step of a peer's batch may take; larger batches are not tried then."""


def team(n_agents: int) -> TaskSpec:
    """`coop_nav` in an arena and with obstacles that grow with the team, as in the presets."""
    base = preset("coop_nav")
    scale = n_agents / 4
    side = round(math.sqrt(scale) * base.arena.width, 1)
    o = base.obstacles
    counts = {
        name: round(scale * getattr(o, name)) for name in ("circles", "boxes", "corners", "pockets")
    }
    return base.with_updates(
        team=[{"count": n_agents}],
        arena={"width": side, "height": side},
        obstacles={**o.model_dump(), **counts},
        horizon=round(base.horizon * math.sqrt(scale)),
    )


def scanning(spec: TaskSpec) -> TaskSpec:
    """The same task seen through 16 rays."""
    return spec.with_updates(observation=LidarModel(n_rays=16).model_dump())


def best_vmas(n_agents: int, n_rays: int) -> tuple[str, Run] | None:
    """VMAS at the batch that is best here, or None if it is not installed."""
    if not find_spec("vmas"):
        print("vmas is not installed: no figures of it")
        return None
    best: tuple[float, str, Run] | None = None
    for n_copies in PEER_BATCHES:
        run = vmas(n_agents, n_copies, n_rays)
        rate = run(0.3)
        print(f"  VMAS {n_agents} robots, batch {n_copies}: {short(rate)}", flush=True)
        if best is None or rate > best[0]:
            best = rate, f"VMAS, batch {n_copies}", run
        if 4 * n_copies / rate > SLOWEST:
            break
    return best and best[1:]


def compare(n_rays: int) -> list[tuple[str, ...]]:
    """Rows of a table: our rates at all batches, the physics alone, and the peers'."""
    rows = []
    for n in TEAMS:
        spec = scanning(team(n)) if n_rays else team(n)
        runs = {str(copies): swarm(spec, copies) for copies in COPIES}
        runs["physics"] = physics(spec, 64)
        peer = best_vmas(n, n_rays)
        if peer:
            runs["vmas"] = peer[1]
        if n <= 8 and not n_rays:
            runs["mpe2"] = mpe2(n)
        rates = interleave(runs)
        ours = rates["64"].median
        vmas_cells = ("—", "—")
        if peer:
            best = peer[0].split()[-1]
            vmas_cells = (f"{rates['vmas']} at {best}", f"{ours / rates['vmas'].median:.2f}")
        row = (str(n), *(str(rates[str(c)]) for c in COPIES), *vmas_cells)
        if not n_rays:
            row += (str(rates.get("mpe2", "—")),)
        row += (f"{ours / rates['physics'].median:.2f}",)
        rows.append(row)
        print(" | ".join(row), flush=True)
    return rows


HEAD = (
    "robots",
    *(f"{n} {'copy' if n == 1 else 'copies'}" for n in COPIES),
    "VMAS at its best batch",
    "64 copies / VMAS",
)
LIMIT = "64 copies / physics alone"


def state_section() -> None:
    """Low-dimensional observations."""
    body = table((*HEAD, "MPE2", LIMIT), compare(0))
    write_section(
        "Low-dimensional observations",
        "`coop_nav`, environment steps a second, against VMAS 'navigation' with collisions and "
        "without its lidar, and MPE2 `simple_spread_v3`. Arenas and obstacles of `coop_nav` grow "
        "with the team (6, 12, 24 and 48 obstacles); the peers' worlds have none. VMAS resets all "
        "copies at once after 160 steps, which is cheapest but rarely what training needs; ours "
        "resets each copy when its episode ends. Physics alone: Munk2D steps the same worlds in a "
        "compiled loop.\n\n" + body,
    )


def lidar_section() -> None:
    """Sixteen rays."""
    write_section(
        "Lidar of 16 rays",
        "`coop_nav`, environment steps a second, against VMAS 'navigation' with collisions and 16 "
        "rays at its default range of 0.35 m. Our lidar reaches 2 m and detects robots, obstacles "
        "and walls; that of VMAS detects robots.\n\n" + table((*HEAD, LIMIT), compare(16)),
    )


def one_section() -> None:
    """One copy, which is what most users run first."""
    rows = []
    for n in (4, 8):
        spec = team(n)
        runs = {
            "ours, `VecEnv`": swarm(spec, 1),
            "ours, PettingZoo": swarm_parallel(spec),
            "MPE2, PettingZoo": mpe2(n),
            "physics alone": physics(spec, 1),
        }
        if find_spec("vmas"):
            runs["VMAS, `num_envs=1`"] = vmas(n, 1, 0)
        rates = interleave(runs)
        for name, rate in rates.items():
            ratios = (
                f"{rates[key].median / rate.median:.3g}"
                for key in ("ours, `VecEnv`", "ours, PettingZoo")
            )
            rows.append((f"{n}", name, str(rate), *ratios))
            print(" | ".join(rows[-1]), flush=True)
    head = ("robots", "engine", "steps a second", "ours / it", "ours through PettingZoo / it")
    intro = (
        "A single copy, as most users run first. VMAS runs without its lidar; MPE2's "
        "`simple_spread_v3` has no other interface."
    )
    write_section("One copy", f"{intro}\n\n{table(head, rows)}")


def growth_section() -> None:
    """Cost per robot-step, and two processes."""
    rows = []
    for name, change in (("state", team), ("lidar", lambda n: scanning(team(n)))):
        rates = interleave({str(n): swarm(change(n), 64) for n in TEAMS})
        cost = [1e9 / (n * rates[str(n)].median) for n in TEAMS]
        rows.append((name, *(f"{c:.0f}" for c in cost), f"{cost[-1] / cost[0]:.2f}"))
        print(" | ".join(rows[-1]), flush=True)
    head = ("observations", *(f"{n} robots" for n in TEAMS), "32 robots / 4")
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, ALL_CORES)
    ours, loops = (Rate.of(ratios) for ratios in measure_processes(team(4)))
    write_section(
        "Growth",
        f"Nanoseconds per robot and step, 64 copies:\n\n{table(head, rows)}\n"
        f"Two processes, 64 copies each, make {ours} times the steps of one. Two processes that "
        f"only count reach {loops} times the rate of one: the machine allows no more, and less "
        "than 2 if others use it.",
    )


def tasks_section() -> None:
    """Our own rates: every task, observation and communication model."""
    base = preset("coop_nav")
    specs = {name: preset(name) for name in preset_names()}
    for kind in ("lidar", "bearing", "occupancy"):
        specs[f"coop_nav, {kind}"] = base.with_updates(observation={"kind": kind})
    radio = Broadcast(range=2.0, drop_probability=0.3, delay=1)
    specs["coop_nav, broadcast"] = base.with_updates(communication=Broadcast().model_dump())
    specs["coop_nav, lossy radio"] = base.with_updates(communication=radio.model_dump())
    specs["coop_nav, lidar and lossy radio"] = scanning(specs["coop_nav, lossy radio"])
    rows: list[tuple[str, ...]] = []
    for name, spec in specs.items():
        rates = interleave({"1": swarm(spec, 1), "64": swarm(spec, 64)}, 3, 0.1)
        rows.append((name, str(spec.n_agents), str(rates["1"]), str(rates["64"])))
        print(" | ".join(rows[-1]), flush=True)
    head = ("preset and models", "robots", "1 copy", "64 copies")
    write_section(
        "Tasks and models",
        "Environment steps a second; rows are measured one after another, not in turns.\n\n"
        + table(head, rows),
    )


SECTIONS: dict[str, Callable[[], None]] = {
    "state": state_section,
    "lidar": lidar_section,
    "one": one_section,
    "tasks": tasks_section,
    "growth": growth_section,
}


def main() -> None:
    """Measures the sections named on the command line, all by default, on the last core."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {max(ALL_CORES)})
    for name in sys.argv[1:] or SECTIONS:
        print(f"== {name}", flush=True)
        SECTIONS[name]()


if __name__ == "__main__":
    main()
