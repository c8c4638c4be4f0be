"""Times `import swarmdata` against `import numpy`: medians of fresh interpreters, in ms."""

import statistics
import subprocess
import sys
import time

RUNS = 5


def median_ms(code: str) -> float:
    """Median wall time of a fresh interpreter that runs `code`, ms."""
    times = []
    for _ in range(RUNS):
        start = time.perf_counter()
        subprocess.run([sys.executable, "-c", code], check=True)
        times.append(time.perf_counter() - start)
    return 1e3 * statistics.median(times)


def main() -> None:
    """Prints one line per import."""
    bare = median_ms("pass")
    print(f"{'a bare interpreter':40} {bare:8.1f} ms")
    for code in ("import swarmdata", "import numpy", "import swarmdata; swarmdata.make_env"):
        print(
            f"{code:40} {median_ms(code) - bare:8.1f} ms above a bare interpreter ({bare:.1f} ms)"
        )


if __name__ == "__main__":
    main()
