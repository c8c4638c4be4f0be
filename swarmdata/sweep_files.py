"""Results of a sweep in files: measured once, then read, and never taken for another team's."""

from pathlib import Path

import numpy as np

from swarmdata.errors import SchemaError
from swarmdata.evaluate import evaluate
from swarmdata.frozen import differences
from swarmdata.provenance import Provenance, file_name
from swarmdata.result_files import Result, load, located, save
from swarmdata.seeding import evaluation_seeds
from swarmdata.spec import TaskSpec
from swarmdata.targets import Target


def measured(target: Target, index: int, spec: TaskSpec, out: Path, n_episodes: int) -> Result:
    """Returns the result in a folder; measures it now, and writes the file, if there is none.

    Args:
        target: the team.
        index: of its policy.
        spec: to act in.
        out: folder of the place on the axis; made if absent.
        n_episodes: first so many reserved seeds.

    Raises:
        SchemaError: the file in the result's place is of something else.
    """
    provenance = target.provenances[index]
    path = out / file_name(provenance, spec.hash())
    if path.exists():
        return _read(path, located(provenance, out), n_episodes)
    policy = target.policies[index]
    found = evaluate(policy, spec, name=target.label, n_episodes=n_episodes, progress=False)
    result = Result(found, provenance, spec)
    save(result, out)
    return result


def _read(path: Path, provenance: Provenance, n_episodes: int) -> Result:
    """A result of an earlier start of the same sweep; the name of its file tells its spec.

    Raises:
        SchemaError: it is another one's.
    """
    result = load(path)
    seeds = result.evaluation.seeds
    differs = [name for name, *_ in differences(result.provenance, provenance)]
    differs += ["episodes"] * (not np.array_equal(seeds, evaluation_seeds(n_episodes)))
    if differs:
        raise SchemaError(
            f"{path} holds the result of another sweep, which differs in {', '.join(differs)} "
            f"({len(seeds)} episodes there, {n_episodes} asked for). Choose another --out, "
            "or delete that file to measure it again."
        )
    return result
