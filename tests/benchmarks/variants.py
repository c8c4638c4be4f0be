"""The circumstances under which a dataset must be the same bits, and whether they are given here.

A setting that a library ignores proves nothing, so a new interpreter is asked what it does.
"""

import json
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from threadpoolctl import threadpool_info

from swarmdata.runtime.engines.jobs import THREAD_VARIABLES
from tests.support.interpreter import python
from tests.support.package_sources import ROOT

CLEARED = (
    "OPENBLAS_CORETYPE", "NPY_DISABLE_CPU_FEATURES", "NPY_ENABLE_CPU_FEATURES",
    "NUMBA_CPU_NAME", "NUMBA_CPU_FEATURES",
)  # fmt: skip
"""Settings of the caller that no variant takes over."""

KERNELS = {
    "Prescott": ("Prescott", "Katmai"),  # SSE3; the first of the names that share its kernels
    "Nehalem": ("Nehalem",),  # SSE4.2
    "Sandybridge": ("Sandybridge",),  # AVX
    "Haswell": ("Haswell",),  # AVX2 and fused multiply-add
    "SkylakeX": ("SkylakeX",),  # AVX-512
}
"""OpenBLAS's kernels by the name one asks for, and the names that it then gives itself."""

AVX512 = {"X86_V4", "AVX512_SKX"}  # by the names of NumPy 2.4 and of earlier ones


class Probe(NamedTuple):
    """What the libraries of an interpreter do."""

    kernel: str | None  # of NumPy's OpenBLAS; None: NumPy has another BLAS
    n_threads: int  # of OpenBLAS; 1 without it
    features: tuple[str, ...]  # beyond its baseline that NumPy may use, and the processor has


@dataclass(frozen=True)
class Variant:
    name: str
    environment: Mapping[str, str] = field(default_factory=dict)
    n_workers: int = 1
    n_threads: int = 1
    n_kills: int = 0  # of the whole build, at random moments, before it may finish
    obstacle: Callable[[Probe], str] = field(default=lambda probe: "", repr=False)

    def variables(self) -> dict[str, str]:
        kept = {name: value for name, value in os.environ.items() if name not in CLEARED}
        threads = dict.fromkeys(THREAD_VARIABLES, str(self.n_threads))
        return {**kept, **threads, **self.environment}

    def unavailable(self) -> str:
        """Why it cannot be had on this machine; empty if it can."""
        run = python("-m", "tests.benchmarks.variants", cwd=ROOT, env=self.variables())
        kernel, n_threads, features = json.loads(run.stdout)
        return self.obstacle(Probe(kernel, n_threads, tuple(features)))


def probe() -> Probe:
    blas = next((each for each in threadpool_info() if each["internal_api"] == "openblas"), None)
    if blas is None:
        return Probe(None, 1, found_features())
    return Probe(blas["architecture"], blas["num_threads"], found_features())


def found_features() -> tuple[str, ...]:
    """NumPy's optional CPU features that are in use."""
    settings: Any = np.show_config(mode="dicts")
    return tuple(settings["SIMD Extensions"].get("found", ()))


def variants() -> tuple[Variant, ...]:
    """Every variant; the first is the default, which differs from each other one in one thing."""
    features = " ".join(found_features())
    return (
        Variant("default"),
        *map(_kernel, KERNELS),
        Variant(
            "plain NumPy",
            {"NPY_DISABLE_CPU_FEATURES": features} if features else {},
            obstacle=lambda probe: _plain(features, probe),
        ),
        Variant("generic numba", {"NUMBA_CPU_NAME": "generic"}),
        Variant("2 workers", n_workers=2),
        Variant("2 threads", n_threads=2, obstacle=_two_threads),
        Variant("3 kills", n_workers=2, n_kills=3),
    )


def _kernel(name: str) -> Variant:
    def obstacle(probe: Probe) -> str:
        if probe.kernel is None:
            return "NumPy's BLAS is not OpenBLAS"
        if probe.kernel not in KERNELS[name]:
            return f"OpenBLAS runs {probe.kernel} instead: the processor lacks its instructions"
        if name == "SkylakeX" and AVX512.isdisjoint(probe.features):  # OpenBLAS does not ask
            return "the processor has no AVX-512"
        return ""

    return Variant(name, {"OPENBLAS_CORETYPE": name}, obstacle=obstacle)


def _plain(features: str, probe: Probe) -> str:
    if not features:
        return "NumPy has no optional features for this processor"
    return f"NumPy still uses {' '.join(probe.features)}" if probe.features else ""


def _two_threads(probe: Probe) -> str:
    return "" if probe.n_threads == 2 else f"OpenBLAS runs {probe.n_threads} threads"


if __name__ == "__main__":
    print(json.dumps(probe()))
