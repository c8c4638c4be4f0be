"""Kills commands that write folders of results, and looks after each kill.

    python -m tests.faults.killed_commands COMMAND FOLDER NUMBER

It kills before changes of the disk that are spread over all of them. After each kill, worker
processes have to end by themselves; then the same command has to end well, leave the bytes of one
that nobody disturbed, and no leftovers.
"""

import ctypes
import importlib
import json
import os
import shutil
import sys
import time
import warnings
from collections.abc import Callable
from pathlib import Path

from swarmdata.cli.main import app
from swarmdata.runtime.atomic import TEMPORARY_PREFIX
from tests.faults.kill_points import forked, is_change, killed_at
from tests.support.tiny import TINY, contents, make_tiny

PR_SET_CHILD_SUBREAPER = 36
"""Of prctl(2): orphans of killed children become children of this process."""

Words = Callable[[Path], tuple[str | Path, ...]]


def run_command(*words: str | Path) -> None:
    """Runs the command line in this process."""
    code = app([str(word) for word in words], standalone_mode=False)
    assert not code, code


def make_inputs(folder: Path) -> dict[str, Words]:
    """A dataset, a run and a study's plan; and the commands that read them and write to a place."""
    data, run, plan = folder / TINY.id, folder / "run", folder / "study.yaml"
    assert forked(lambda: _ignore(make_tiny(data))) == 0
    sizes = ("--set", "hidden=8", "--updates", "4", "--seeds", "2")
    assert forked(lambda: run_command("train", "bc", data, "--out", run, *sizes)) == 0
    cell = {"algorithm": "bc", "family": "cloning", "updates": 4}
    study = {
        "name": "tiny", "datasets": [str(data)], "seeds": [0], "hidden": [8], "episodes": 2,
        "algorithms": {"bc": cell, "other": {**cell, "settings": {"output": "clip"}}},
    }  # fmt: skip
    plan.write_text(json.dumps(study))
    return {
        "sweep": lambda place: (
            "sweep", run, "--out", place / "sweep", "--observation", "noise=0,0.2",
            "--episodes", "2",
        ),
        "catalogue": lambda place: ("catalogue", "build", data, "--out", place / "site"),
        "export-policy": lambda place: ("export-policy", run, place / "policy.onnx"),
        "study": lambda place: (
            "study", plan, "--out", place / "out", "--work", place / "work", "--workers", "2",
        ),
    }  # fmt: skip


def import_first() -> None:
    """What the commands import when they begin, so that the children need not."""
    for module in (
        "torch", "matplotlib.pyplot", "swarmdata.interop.exported_policies",
        "swarmdata.evaluation.robustness.sweep",
        "swarmdata.evaluation.robustness.sweep_plots", "swarmdata.evaluation.study.run_study",
        "swarmdata.evaluation.runs.train", "swarmdata.catalogue.build_catalogue",
    ):  # fmt: skip
        importlib.import_module(module)


def _ignore(result: object) -> None:
    """A child returns nothing."""


def same_bytes(command: Words, root: Path) -> dict[str, bytes | str]:
    """What two undisturbed runs agree in.

    Files with measured times and dates differ between any two runs, and are not compared.
    """
    found = []
    for name in ("one", "two"):
        place = root / name / "place"
        place.mkdir(parents=True)
        assert forked(lambda place=place: run_command(*command(place))) == 0  # type: ignore[misc]
        found.append(contents(place))
    assert found[0].keys() == found[1].keys()
    return {name: text for name, text in found[0].items() if found[1][name] == text}


def number_of_changes(command: Words, place: Path) -> int:
    """How often a command changes the disk in its own process."""
    read, write = os.pipe()

    def count() -> None:
        n = 0

        def hook(event: str, arguments: tuple[object, ...]) -> None:
            nonlocal n
            n += is_change(event, arguments)

        sys.addaudithook(hook)
        run_command(*command(place))
        os.write(write, str(n).encode())

    place.mkdir(parents=True)
    assert forked(count) == 0
    return int(os.read(read, 20))


def wait_for_orphans() -> None:
    """Waits until the worker processes of killed commands have ended by themselves."""
    deadline = time.monotonic() + 120
    while True:
        try:
            ended, _ = os.waitpid(-1, os.WNOHANG)
        except ChildProcessError:
            return
        assert ended or time.monotonic() < deadline, "a worker process outlives its command"
        time.sleep(0.0 if ended else 0.05)


def survived(command: Words, root: Path, number: int) -> dict[str, int]:
    """Kills a command so many times, each time in a new folder; raises if anything is lost."""
    expected = same_bytes(command, root)
    n_changes = number_of_changes(command, root / "counted" / "place")
    n_kills = 0
    for index in range(number):
        place = root / f"kill-{index}" / "place"
        place.mkdir(parents=True)

        def work(place: Path = place) -> None:
            run_command(*command(place))

        n_kills += killed_at(n_changes * (2 * index + 1) // (2 * number), work)
        wait_for_orphans()
        sys.stderr.write(f"kill {n_kills}: {len(contents(place))} files are there\n")
        assert forked(work) == 0, index
        wait_for_orphans()
        found = contents(place)
        differing = [name for name, text in expected.items() if found.get(name) != text]
        assert not differing, (index, differing)
        left = list(place.rglob(f"{TEMPORARY_PREFIX}*"))
        assert not left, (index, left)
        shutil.rmtree(place)
    return {"tries": number, "kills": n_kills}


def main() -> None:
    name, folder, number = sys.argv[1], Path(sys.argv[2]), int(sys.argv[3])
    ctypes.CDLL(None).prctl(PR_SET_CHILD_SUBREAPER, 1)
    warnings.simplefilter("error")
    import_first()
    found = survived(make_inputs(folder)[name], folder, number)
    print(json.dumps({"command": name, **found}))


if __name__ == "__main__":
    main()
