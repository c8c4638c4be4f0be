"""Results of a sweep in files: measured once, then read, and never taken for another team's."""

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from swarmdata import __version__
from swarmdata.errors import SchemaError
from swarmdata.evaluate import evaluate, load, load_metadata, save
from swarmdata.models import models_of
from swarmdata.registry import ONLINE_ALGORITHMS
from swarmdata.seeding import evaluation_seeds
from swarmdata.spec import TaskSpec
from swarmdata.targets import Target, run_folders
from swarmdata.types import EvalResult

CHECKPOINT = "checkpoint.safetensors"
"""Where an offline run keeps its policies."""


def origin_of(target: Target, name: str) -> dict[str, Any]:
    """Where a team comes from, as JSON values; parameters of an offline run by their digest."""
    run = target.metadata.get("run")
    if run is None or run["algorithm"] in ONLINE_ALGORITHMS:  # online, frames and seeds tell all
        return dict(target.metadata)
    files = [folder / CHECKPOINT for folder in run_folders(Path(name))]
    digests = [hashlib.sha256(file.read_bytes()).hexdigest() for file in files]
    return {**target.metadata, "checkpoints": digests}


def measured(
    target: Target, index: int, spec: TaskSpec, path: Path, n_episodes: int, said: Mapping[str, Any]
) -> EvalResult:
    """Returns the result in a file; measures it now, and writes the file, if there is none.

    Args:
        target: the team.
        index: of its policy.
        spec: to act in.
        path: of the file; its folder must exist.
        n_episodes: first so many reserved seeds.
        said: what the file says of the result beside its models and index, JSON values.

    Raises:
        SchemaError: the file holds the result of something else.
    """
    metadata = {**said, "models": models_of(spec), "index": index}
    if path.exists():
        return _read(path, spec, metadata, n_episodes)
    policy = target.policies[index]
    result = evaluate(policy, spec, name=target.label, n_episodes=n_episodes, progress=False)
    save(result, path, metadata=metadata)
    return result


def _read(path: Path, spec: TaskSpec, metadata: dict[str, Any], n_episodes: int) -> EvalResult:
    """A result of an earlier start of the same sweep.

    Raises:
        SchemaError: it is another one's.
    """
    result, theirs = load(path), load_metadata(path)
    ours = {**json.loads(json.dumps(metadata)), "code_version": __version__}
    differs = [name for name in sorted(ours | theirs) if ours.get(name) != theirs.get(name)]
    differs += ["spec"] * (result.spec_hash != spec.hash())
    differs += ["episodes"] * (not np.array_equal(result.seeds, evaluation_seeds(n_episodes)))
    if differs:
        raise SchemaError(
            f"{path} holds the result of another sweep, which differs in {', '.join(differs)} "
            f"({len(result.seeds)} episodes there, {n_episodes} asked for). Choose another --out, "
            "or delete that file to measure it again."
        )
    return result
