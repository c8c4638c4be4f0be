"""Environment steps a second on a core, beside peers and physics alone: docs/measurements.md.

    python -m tests.benchmarks.bench_worlds [SECTION ...]

Sections: state lidar one tasks simulators. VMAS is measured where it is installed.
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("MKL_NUM_THREADS", "1")

import math
import sys
from collections.abc import Callable, Mapping, Sequence
from importlib.metadata import version
from importlib.util import find_spec

from swarmdata.registry.presets import preset, preset_names
from swarmdata.specs.sensing_models import Broadcast, LidarModel
from swarmdata.specs.task_spec import TaskSpec
from tests.benchmarks.engines import Run, mpe2, physics, swarm, swarm_parallel, vmas
from tests.benchmarks.measuring import Rate, interleave, short, table, use_last_core, write_section
from tests.benchmarks.replays import Recording, Replay, members, record

SIZES = (4, 8, 16, 32)
TEAMS = ("random", "scripted", "medium", "expert")
COPIES = (1, 16, 64, 256)
BACKENDS = ("pymunk", "mujoco")
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


def preset_of(n_agents: int) -> str:
    """The preset whose checkpoints drive a `team`; none of the larger ones has any."""
    return "coop_nav" if n_agents == 4 else f"coop_nav-n{n_agents}"


def record_teams(
    preset: str, spec: TaskSpec, teams: Sequence[str], n_copies: int = 64
) -> dict[str, Recording]:
    """Actions of those teams that the preset has, by team."""
    policies = {name: members(name, preset, spec) for name in teams}
    return {name: record(spec, group, n_copies) for name, group in policies.items() if group}


def scanning(spec: TaskSpec) -> TaskSpec:
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
    """Rows of a table: our rates at all batches and of real teams, the physics, and the peers."""
    rows = []
    for n in SIZES:
        spec = scanning(team(n)) if n_rays else team(n)
        runs: dict[str, Run] = {str(copies): swarm(spec, copies) for copies in COPIES}
        recordings = record_teams(preset_of(n), team(n), ACTED)
        runs |= {name: Replay(spec, recording) for name, recording in recordings.items()}
        runs["physics"] = physics(spec, 64)
        peer = best_vmas(n, n_rays)
        if peer:
            runs["vmas"] = peer[1]
        if n <= 8 and not n_rays:
            runs["mpe2"] = mpe2(n)
        rates = interleave(runs)
        row = (str(n), *(str(rates.get(name, "—")) for name in (*map(str, COPIES), *ACTED)))
        row += (f"{rates['vmas']} at {peer[0].split()[-1]}" if peer else "—",)
        row += tuple(ratio(rates, name, "vmas") for name in ("64", *ACTED))
        row += () if n_rays else (str(rates.get("mpe2", "—")),)
        rows.append((*row, ratio(rates, "64", "physics")))
        print(" | ".join(rows[-1]), flush=True)
    return rows


def ratio(rates: Mapping[str, Rate], ours: str, other: str) -> str:
    """Of two medians, a dash if one of them was not measured."""
    if ours not in rates or other not in rates:
        return "—"
    return f"{rates[ours].median / rates[other].median:.2f}"


ACTED = ("scripted", "expert")
"""Teams whose recorded actions are replayed beside random ones."""

HEAD = (
    "robots",
    *(f"{n} {'copy' if n == 1 else 'copies'}" for n in COPIES),
    *(f"64 copies, {name} actions" for name in ACTED),
    "VMAS at its best batch",
    "64 copies / VMAS",
    *(f"64 copies, {name} actions / VMAS" for name in ACTED),
)
LIMIT = "64 copies / physics alone"

ACTIONS_NOTE = (
    "Actions are random, or replayed from recordings of scripted and expert teams, so that the "
    "policies' time does not count."
)


def state_section() -> None:
    body = table((*HEAD, "MPE2", LIMIT), compare(0))
    write_section(
        "Low-dimensional observations",
        "Environment steps a second of `coop_nav`, of VMAS 'navigation' with collisions and "
        "without its lidar, and of MPE2 `simple_spread_v3`. `coop_nav` has 6, 12, 24 and 48 "
        "obstacles; the others have none. VMAS resets all copies at once after 160 steps, which "
        "is cheapest but rarely what training needs; ours resets each copy when its episode ends. "
        '"Physics alone" is Munk2D stepping the same worlds in a compiled loop. '
        f"{ACTIONS_NOTE}\n\n" + body,
    )


def lidar_section() -> None:
    write_section(
        "Lidar of 16 rays",
        "Environment steps a second of `coop_nav` and of VMAS 'navigation' with collisions. Our "
        "lidar reaches 2 m and detects robots, obstacles and walls; that of VMAS has its default "
        f"range of 0.35 m and detects robots. {ACTIONS_NOTE}\n\n"
        + table((*HEAD, LIMIT), compare(16)),
    )


def one_section() -> None:
    rows = []
    for n in (4, 8):
        spec = team(n)
        acted = record_teams(preset_of(n), spec, ("expert",), 1)["expert"]
        runs: dict[str, Run] = {
            "ours, `VecEnv`": swarm(spec, 1),
            "ours, `VecEnv`, expert actions": Replay(spec, acted),
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
        "Steps a second of a single copy of a task. VMAS runs without its lidar. Actions are "
        "random unless the row says otherwise."
    )
    write_section("One copy", f"{intro}\n\n{table(head, rows)}")


def simulators_section() -> None:
    """The same worlds in Pymunk and in MuJoCo, which is measured if it is installed."""
    if not find_spec("mujoco"):
        print("mujoco is not installed: no figures of it")
        return
    rows, kinds = [], [f"{b}, {kind}" for kind in ("random", "scripted") for b in BACKENDS]
    for n in (4, 8):
        runs: dict[str, Run] = {}
        for backend in BACKENDS:
            spec = preset(preset_of(n)).with_updates(backend=backend)
            recording = record_teams(preset_of(n), spec, ["scripted"], 16)["scripted"]
            runs[f"{backend}, random"] = swarm(spec, 16)
            runs[f"{backend}, scripted"] = Replay(spec, recording)
        rates = interleave(runs)
        rows.append((str(n), *(str(rates[kind]) for kind in kinds)))
        print(" | ".join(rows[-1]), flush=True)
    write_section(
        "Simulators",
        "Control steps of `coop_nav` per second of processor time, 16 copies, resets included; "
        f"MuJoCo {version('mujoco')} (`python -m tests.benchmarks.bench_worlds simulators`); see "
        "[simulators](simulators.md).\n\n"
        + table(("robots", *(f"{kind} actions" for kind in kinds)), rows),
    )


def tasks_section() -> None:
    presets: list[tuple[str, ...]] = []
    models: list[tuple[str, ...]] = []
    for name in preset_names():
        presets.append(preset_row(name))
        print(" | ".join(presets[-1]), flush=True)
    recording = record_teams("coop_nav", preset("coop_nav"), ("expert",))["expert"]
    for name, spec in model_specs().items():
        runs: dict[str, Run] = {"1": swarm(spec, 1), "64": swarm(spec, 64)}
        runs["expert"] = Replay(spec, recording)
        rates = interleave(runs, 3, 0.1)
        models.append((name, *map(str, rates.values())))
        print(" | ".join(models[-1]), flush=True)
    write_section(
        "Tasks and models",
        "Environment steps a second; rows were measured one after another. All actions but those "
        "of the first column are replayed from recordings. The last column is the share of time "
        "that resets take with each team. Teams without checkpoints for a preset are left out.\n\n"
        + table(PRESET_HEAD, presets)
        + "\n`coop_nav` with other sensors and radios:\n\n"
        + table(("models", "1 copy", "64 copies", "64 copies, expert actions"), models),
    )


PRESET_HEAD = (
    "preset", "robots", "1 copy, random",
    *(f"64 copies, {name}" for name in TEAMS), "time in resets, %",
)  # fmt: skip


def preset_row(name: str) -> tuple[str, ...]:
    spec = preset(name)
    recordings = record_teams(name, spec, TEAMS)
    acted = {team: Replay(spec, recording) for team, recording in recordings.items()}
    rates = interleave({"1": swarm(spec, 1), **acted}, 3, 0.1)
    shares = " / ".join(f"{100 * replay.reset_share:.0f}" for replay in acted.values())
    cells = (str(rates.get(column, "—")) for column in ("1", *TEAMS))
    return (name, str(spec.n_agents), *cells, shares)


def model_specs() -> dict[str, TaskSpec]:
    base = preset("coop_nav")
    specs = {
        kind: base.with_updates(observation={"kind": kind})
        for kind in ("lidar", "bearing", "occupancy")
    }
    radio = Broadcast(range=2.0, drop_probability=0.3, delay=1)
    specs["broadcast"] = base.with_updates(communication=Broadcast().model_dump())
    specs["lossy radio"] = base.with_updates(communication=radio.model_dump())
    specs["lidar and lossy radio"] = scanning(specs["lossy radio"])
    return specs


SECTIONS: dict[str, Callable[[], None]] = {
    "state": state_section,
    "lidar": lidar_section,
    "one": one_section,
    "tasks": tasks_section,
    "simulators": simulators_section,
}


def main() -> None:
    use_last_core()
    for name in sys.argv[1:] or SECTIONS:
        print(f"== {name}", flush=True)
        SECTIONS[name]()


if __name__ == "__main__":
    main()
