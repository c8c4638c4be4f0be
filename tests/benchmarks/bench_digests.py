"""One digest from any BLAS kernel and any number of workers, and how long a rebuild takes.

    python tests/benchmarks/bench_rebuild.py [ID]

Rebuilds a dataset in fresh folders: with 1 and 2 workers, under several of OpenBLAS's kernels (one
that needs instructions this processor lacks fails), and after three kills at random moments.
"""

import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

KERNELS = ("Prescott", "Nehalem", "Sandybridge", "Haswell", "Zen", "SkylakeX")


def command(dataset: str, folder: Path, workers: int) -> list[str]:
    generate = ["generate", dataset, "--workers", str(workers), "--out", str(folder)]
    return [sys.executable, "-c", "from swarmdata.cli import main; main()", *generate]


def digest(dataset: str, folder: Path, workers: int, kernel: str | None = None) -> str:
    environment = dict(os.environ) | ({"OPENBLAS_CORETYPE": kernel} if kernel else {})
    done = subprocess.run(
        command(dataset, folder, workers),
        env=environment, capture_output=True, text=True, check=False,
    )  # fmt: skip
    if done.returncode:
        return f"failed: {(done.stderr.strip().splitlines() or ['killed'])[-1][:80]}"
    return done.stdout.split()[-1]


def kill_three_times(dataset: str, folder: Path, seconds: float) -> None:
    for _ in range(3):
        process = subprocess.Popen(
            command(dataset, folder, 2), stderr=subprocess.DEVNULL, start_new_session=True
        )
        time.sleep(random.uniform(0.3, 0.8) * seconds)
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()


def main() -> None:
    dataset = sys.argv[1] if len(sys.argv) > 1 else "coop_nav-medium-mini"
    with tempfile.TemporaryDirectory() as root:
        for workers in (1, 2):
            begin = time.perf_counter()
            found = digest(dataset, Path(root) / f"w{workers}", workers)
            seconds = time.perf_counter() - begin
            print(f"{workers} workers     {seconds:6.1f} s  {found}", flush=True)
        for kernel in KERNELS:
            print(f"{kernel:18s}  {digest(dataset, Path(root) / kernel, 2, kernel)}", flush=True)
        kill_three_times(dataset, Path(root) / "killed", seconds)
        print(f"after 3 kills      {digest(dataset, Path(root) / 'killed', 2)}")


if __name__ == "__main__":
    main()
