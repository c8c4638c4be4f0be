"""Speed of the same worlds in Pymunk and in MuJoCo, in turns, into docs/benchmarks.md.

    python -m tests.benchmarks.bench_simulators

Control steps of `coop_nav` a second of processor time, on one core, resets included. Scripted
actions were recorded with their resets in each simulator, and are replayed without their policy.
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")

from importlib.metadata import version

from swarmdata.registry.presets import preset
from tests.benchmarks.bench_worlds import record_teams
from tests.benchmarks.engines import Run, swarm
from tests.benchmarks.measuring import interleave, table, write_section
from tests.benchmarks.replays import Replay

TEAMS = {4: "coop_nav", 8: "coop_nav-n8"}
BACKENDS = ("pymunk", "mujoco")
ACTIONS = ("random", "scripted")
N_COPIES = 16


def runs_of(name: str) -> dict[str, Run]:
    """What is timed for a preset: random and scripted actions in both simulators."""
    found: dict[str, Run] = {}
    for backend in BACKENDS:
        spec = preset(name).with_updates(backend=backend)
        found[f"{backend}, random"] = swarm(spec, N_COPIES)
        recording = record_teams(name, spec, ["scripted"], N_COPIES)["scripted"]
        found[f"{backend}, scripted"] = Replay(spec, recording)
    return found


def main() -> None:
    """Measures all teams and writes the section."""
    rows = []
    for n_agents, name in TEAMS.items():
        rates = interleave(runs_of(name))
        rows.append(
            (str(n_agents), *(str(rates[f"{b}, {kind}"]) for kind in ACTIONS for b in BACKENDS))
        )
        print(rows[-1], flush=True)
    head = ("robots", *(f"{backend}, {kind} actions" for kind in ACTIONS for backend in BACKENDS))
    write_section(
        "Simulators",
        f"`coop_nav`, control steps a second of processor time on one core, {N_COPIES} copies, "
        f"resets included; MuJoCo {version('mujoco')}. `python -m "
        "tests.benchmarks.bench_simulators` measures it; see [simulators](simulators.md).\n\n"
        f"{table(head, rows)}",
    )


if __name__ == "__main__":
    main()
