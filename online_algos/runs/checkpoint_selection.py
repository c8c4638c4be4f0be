"""Selects the policies of online runs that make datasets, and copies them into the package.

- medium: a seed's first checkpoint whose team success lies in `MEDIUM_SUCCESS`, by a margin;
- medium-replay: checkpoints before it, each for an equal part of the training until then, with the
  noise that training had at that time;
- expert: a seed's last policy;
- mixed-conventions: the last policies of runs that were trained to keep to one side.

All are measured on validation seeds, by exact inference, as the datasets run them. Runs may have
another team size than the datasets; their policies are used without further training. Runs for one
side of a task are measured against the scripted others, and the success is that of the side.
"""

import hashlib
import json
import os
import shutil
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np

from swarmdata.behavior_policies.checkpoint_files import digest_of
from swarmdata.behavior_policies.learned import own_actor
from swarmdata.behavior_policies.tier_bands import MEDIUM_SUCCESS
from swarmdata.errors import BuildError, OutputError
from swarmdata.learn.policies.policy_file import load_policy
from swarmdata.learn.training.run_files import (
    CURVE,
    Seed,
    last_policy_path,
    policy_path,
    read_table,
    saved_frames,
)
from swarmdata.online_algos.runs.export_policy import action_error, export
from swarmdata.online_algos.runs.online_training import measure, read_online_run
from swarmdata.registry.published import REFERENCE_OPPONENTS
from swarmdata.runtime.atomic import write_file
from swarmdata.runtime.locking import locked
from swarmdata.runtime.output_folder import check_marked
from swarmdata.specs.origins import SideSpec
from swarmdata.specs.task_spec import TaskSpec

INDEX = "index.json"
"""File that lists the checkpoints of a folder."""

N_REPLAY_POLICIES = 5
"""Policies of one seed in medium-replay."""

SELECTION_MARGIN = 0.03
"""A medium keeps this distance from the ends of the band, two standard errors of its success: the
first checkpoint that seems to lie in the band seems better than it is."""

CANDIDATE_MARGIN = 0.05
"""A candidate for medium may miss these ends by this much on few episodes."""

N_EPISODES, N_REPLAY_EPISODES, N_ROUGH_EPISODES = 1024, 256, 128
"""Selection episodes that measure mediums and experts, replay policies, and medium candidates."""

N_COMPARED_EPISODES = 64
"""Episodes in which exact inference is compared with the trained network."""


class Chosen(NamedTuple):
    """A checkpoint that goes into the package."""

    tier: str
    side: str | None  # that it plays, in a task of several
    policy: int  # number of the independent run, of those of this side
    frames: int
    share: float  # part of the training until medium that it represents; 1 for other tiers
    noise: float | None  # standard deviation in its training; None for the tier's own
    figures: dict[str, float]
    file: Path


def read_curve(seed: Seed) -> list[dict[str, float]]:
    """Returns the rows of one seed in its run's `curve.csv`."""
    return [row for row in read_table(seed.folder / CURVE) if row["seed"] == seed.seed]


def played_by(seed: Seed, spec: TaskSpec) -> TaskSpec | SideSpec:
    """What the policies of a seed are measured in: the task, or the side they were trained for."""
    trained = read_online_run(seed.folder).spec
    if isinstance(trained, SideSpec):
        return SideSpec(whole=spec, side=trained.side, opponents=REFERENCE_OPPONENTS)
    return spec


def find_medium(seed: Seed, task: TaskSpec, work: Path) -> Chosen | None:
    """Returns the first checkpoint in `MEDIUM_SUCCESS` by the margin, None if the seed has none."""
    low, high = MEDIUM_SUCCESS[0] + SELECTION_MARGIN, MEDIUM_SUCCESS[1] - SELECTION_MARGIN
    spec = played_by(seed, task)
    is_other_spec = read_online_run(seed.folder).spec != spec
    for row in read_curve(seed):
        frames = int(row["frames"])
        rough = row["success"]
        if rough >= low - CANDIDATE_MARGIN and is_other_spec:  # the curve is of another team
            candidate = _measured("medium", seed, frames, spec, work, N_ROUGH_EPISODES)
            rough = candidate.figures["success"]
        if low - CANDIDATE_MARGIN <= rough <= high + CANDIDATE_MARGIN:
            chosen = _measured("medium", seed, frames, spec, work)
            if low <= chosen.figures["success"] <= high:
                return chosen
    return None


def replay_of(seed: Seed, medium: Chosen, task: TaskSpec, work: Path) -> Iterator[Chosen]:
    """Yields the policies in the middle of `N_REPLAY_POLICIES` equal parts of the way to medium."""
    rows, spec = read_curve(seed), played_by(seed, task)
    saved = np.array(saved_frames(*seed))
    for part in range(N_REPLAY_POLICIES):
        wanted = medium.frames * (part + 0.5) / N_REPLAY_POLICIES
        frames = int(saved[np.abs(saved - wanted).argmin()])
        # the schedule of the noise is linear, so it can be interpolated between rows of the curve
        noise = np.interp(frames, [row["frames"] for row in rows], [row["std"] for row in rows])
        chosen = _measured("medium-replay", seed, frames, spec, work, N_REPLAY_EPISODES)
        yield chosen._replace(policy=medium.policy, share=1 / N_REPLAY_POLICIES, noise=float(noise))


def last_of(seed: Seed, task: TaskSpec, work: Path) -> Chosen:
    """Returns the last policy of a finished run, with the error of exact inference.

    Raises:
        BuildError: the run is not finished.
    """
    path, spec = last_policy_path(*seed), played_by(seed, task)
    wanted = read_online_run(seed.folder).n_steps
    if int(path.stem) < wanted:
        raise BuildError(
            f"seed {seed.seed} of {seed.folder} has {int(path.stem)} of {wanted} joint steps; run "
            "its command again to continue"
        )
    chosen = _measured("expert", seed, int(path.stem), spec, work)
    if read_online_run(seed.folder).spec.n_agents != spec.n_agents:
        return chosen  # the trained network does not fit this team
    exact = own_actor(chosen.file, spec)
    error = action_error(load_policy(path), exact, spec, N_COMPARED_EPISODES)
    return chosen._replace(figures=chosen.figures | {"exact_error": error})


def _measured(
    tier: str,
    seed: Seed,
    frames: int,
    spec: TaskSpec | SideSpec,
    work: Path,
    n_episodes: int = N_EPISODES,
) -> Chosen:
    run = hashlib.sha256(str(seed.folder.resolve()).encode()).hexdigest()[:12]
    file = work / f"{run}-{seed.seed}-{frames}.safetensors"
    if not file.exists():
        export(policy_path(seed.folder, seed.seed, frames), file, spec.n_agents)
    side = spec.side if isinstance(spec, SideSpec) else None
    opponents = None if side is None else REFERENCE_OPPONENTS
    figures = measure(own_actor(file, spec), spec, n_episodes, opponents=opponents)
    return Chosen(tier, side, 0, frames, 1.0, None, figures, file)


def _numbered(found: Iterable[Chosen]) -> Iterator[Chosen]:
    """Numbers the runs of each side."""
    numbers = Counter[str | None]()
    for each in found:
        yield each._replace(policy=numbers[each.side])
        numbers[each.side] += 1


def ship(
    mediums: Sequence[Seed],
    experts: Sequence[Seed],
    conventions: Sequence[Seed],
    name: str,
    spec: TaskSpec,
    folder: Path,
) -> dict[str, list[dict[str, Any]]]:
    """Copies the mediums of some seeds with their replays, and the last policies of others.

    Args:
        mediums: seeds whose first checkpoint in the band is taken, if there is one.
        experts: seeds of finished runs.
        conventions: seeds of finished runs that keep to the right, or to the left.
        name: of the datasets' preset.
        spec: of that preset.
        folder: the package's `behavior_policies/checkpoints`; its `index.json` is updated.

    Returns:
        The preset's entry of the index.

    Raises:
        OutputError: the folder has files that the index does not list, in the place of new ones.
        BuildError: no seed has a medium, an expert's run is not finished, a policy cannot be run
            exactly, or a tier has no policies for one of several sides.
    """
    check_marked(folder, INDEX, "folder of checkpoints")
    with TemporaryDirectory(prefix="swarmdata-ship-") as scratch:
        work = Path(scratch)
        chosen = []
        found = [(seed, find_medium(seed, spec, work)) for seed in mediums]
        reached = {seed: medium for seed, medium in found if medium is not None}
        if mediums and not reached:
            raise BuildError(
                f"none of {len(mediums)} seeds has a checkpoint with a team success in "
                f"{MEDIUM_SUCCESS}; train them longer, or with more checkpoints"
            )
        for seed, medium in zip(reached, _numbered(reached.values()), strict=True):
            chosen += [medium, *replay_of(seed, medium, spec, work)]
        chosen += _numbered(last_of(seed, spec, work) for seed in experts)
        kept = _numbered(last_of(seed, spec, work) for seed in conventions)
        chosen += [each._replace(tier="mixed-conventions") for each in kept]
        _check_sides(chosen, spec)
        index = folder / INDEX
        with locked(index, shown=False):
            table = json.loads(index.read_text(encoding="utf-8")) if index.exists() else {}
            known = {
                file["file"] for each in table.values() for tier in each.values() for file in tier
            }
            entry = _install(chosen, name, folder, known)
            tiers = table.get(name, {}) | entry
            text = json.dumps(table | {name: tiers}, indent=1, sort_keys=True)
            write_file(index, f"{text}\n".encode())
    return entry


def _check_sides(chosen: Sequence[Chosen], spec: TaskSpec) -> None:
    """Refuses tiers that lack policies of a side: BuildError."""
    wanted = {side.name for side in spec.sides} if len(spec.sides) > 1 else {None}
    for tier in dict.fromkeys(each.tier for each in chosen):
        if missing := wanted - {each.side for each in chosen if each.tier == tier}:
            raise BuildError(
                f"the tier {tier} has no policies for {', '.join(map(str, missing))} of "
                f"{spec.task}. Name runs of every side in the same command"
            )


def _install(
    chosen: Sequence[Chosen], name: str, folder: Path, known: Collection[str]
) -> dict[str, list[dict[str, Any]]]:
    """Copies files under their names in the package, over `known` ones; returns their entries."""
    numbers, targets = Counter[str](), list[Path]()
    for each in chosen:
        stem = "-".join(part for part in (name, each.side, each.tier) if part is not None)
        targets.append(folder / f"{stem}-{numbers[stem]}.safetensors")
        numbers[stem] += 1
    for target in targets:
        if os.path.lexists(target) and target.name not in known:
            raise OutputError(
                f"{target} is in the way: {INDEX} does not list it, so it was left. Move it away."
            )
    entry: dict[str, list[dict[str, Any]]] = {}
    for each, target in zip(chosen, targets, strict=True):
        tier = entry.setdefault(each.tier, [])
        shutil.copyfile(each.file, target)
        about = {
            "file": target.name,
            "sha256": digest_of(target),
            "frames": each.frames,
            "policy": each.policy,
            "share": each.share,
            "figures": each.figures,
        }
        optional = {"side": each.side, "noise": each.noise}
        tier.append(about | {key: value for key, value in optional.items() if value is not None})
    return entry
