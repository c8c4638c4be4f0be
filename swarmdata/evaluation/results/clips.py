"""Clips: one episode as GIF, MP4 or PNG, with what the robots sense and send."""

from pathlib import Path

from swarmdata.datasets.reobservation import attempted_links, reobserved_episode
from swarmdata.envs.render import animate, draw, save_png
from swarmdata.envs.render.video import VIDEO_SUFFIXES
from swarmdata.errors import SchemaError, SpecError
from swarmdata.evaluation.results.policy_names import check_no_task, find_dataset, find_target
from swarmdata.hub.catalog.catalog import load
from swarmdata.numerics.random import evaluation_seeds
from swarmdata.perception.observer import features_of
from swarmdata.perception.sensing.scans import scan_of
from swarmdata.registry.components import make_env, make_task
from swarmdata.rollouts.rollout import rollout
from swarmdata.runtime.atomic import staged
from swarmdata.specs.model_choice import Source, chosen_models
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import END_REASONS, Episode

CLIP_SUFFIXES = (*VIDEO_SUFFIXES, ".png")  # of the files that can be written


def check_clip(out: Path) -> None:
    """Refuses a file that `write_clip` cannot write, before an episode is simulated."""
    if out.suffix.lower() not in CLIP_SUFFIXES:
        raise SchemaError(
            f"cannot draw to {str(out)!r}, expected a file that ends in {CLIP_SUFFIXES}."
        )


def write_clip(
    episode: Episode, spec: TaskSpec, out: Path, *, size: int = 384, stride: int = 1
) -> None:
    """Draws an episode into a `.gif` or `.mp4`, or as `.png` its last state with all paths.

    Its observations must be those of the spec's models. Lidar rays are drawn if the robots have
    lidar, messages if they communicate. `size` is in pixels of the arena's longer side, `stride` in
    control steps per frame. An absent folder is made.
    """
    check_clip(out)
    out.parent.mkdir(parents=True, exist_ok=True)
    scans = scan_of(features_of(make_task(spec)), episode.observations)
    attempted = attempted_links(episode, spec)
    if out.suffix.lower() != ".png":
        with staged(out) as target:
            animate(
                episode, spec, target, scans=scans, attempted=attempted, size=size, stride=stride
            )
        return
    last = len(episode)
    image = draw(
        spec,
        episode.layout,
        episode.states[last],
        trails=episode.states,
        events=episode.events[last - 1],
        scan=None if scans is None else scans[last],
        messages=None if attempted is None else (episode.delivered[last], attempted[last]),
        size=size,
        caption=f"{last * spec.control_dt:.1f} s    {END_REASONS[episode.end_reason]}",
    )
    with staged(out) as target:
        save_png(image, target)


def draw_target(
    name: str,
    out: Path,
    index: int,
    task: str | None,
    observation: Source | None = None,
    communication: Source | None = None,
    backend: str | None = None,
    *,
    size: int = 384,
    stride: int = 1,
) -> Episode:
    """Draws a recorded episode, or simulates one and draws it; returns the episode.

    Arguments are those of `find_target` and `write_clip`. `name` may be a dataset, whose episode
    `index` is re-observed with the models; of others, `index` is of the reserved evaluation seed.
    """
    check_clip(out)
    if (data := find_dataset(name)) is not None:
        check_no_task(name, task)
        if backend is not None:
            raise SpecError(
                f"{name} is a dataset, whose episodes are drawn as recorded, not simulated in "
                f"{backend}; leave the simulator (--backend) out, or name a policy"
            )
        dataset = load(data)
        if index >= len(dataset):
            raise SchemaError(f"{dataset.id} has {len(dataset)} episodes, none numbered {index}")
        spec = chosen_models(dataset.task, observation, communication)
        episode = reobserved_episode(dataset[index], dataset.task, spec)
    else:
        target = find_target(name, task, observation, communication, backend)
        spec, seeds = target.spec, evaluation_seeds(index + 1)[index:]
        (episode,) = rollout(make_env(spec), target.policies[0], seeds)
    write_clip(episode, spec, out, size=size, stride=stride)
    return episode
