"""Minari: a folder with one HDF5 group per episode, T + 1 observations and T of everything else.

Minari has one agent, so observations and actions are Dict spaces with an entry for each agent, the
reward is the team's, and everything else is in `infos`. Images are stored without JPEG, which would
change them. Datasets are written as HDF5 only, because Minari 0.5.4's Arrow storage cuts episodes
of more than 32,767 rows (its issue 351). Every storage is read, episode by episode; an episode
whose length differs from its metadata is refused.

`minari` loads the folder by the dataset's id if the folder has the id as its name and
`MINARI_DATASETS_PATH` is its parent, or with `minari.MinariDataset(FOLDER / "data")`. Datasets of
our worlds recover their environment: `recover_environment()` gives `envs.world.team_env.TeamEnv`,
which replays the episodes of the export, and `recover_environment(eval_env=True)` the same task
with its own rewards, whose resets play the reserved evaluation episodes.
"""

import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmdata.datasets.dataset import Dataset
from swarmdata.errors import ConversionError
from swarmdata.interop.conversion.dataset_facts import (
    NOTED_FACTS,
    STATE_ARRAYS,
    TIME_ARRAYS,
    array_names,
    recorded_agents,
)
from swarmdata.interop.conversion.export_note import (
    ExportNote,
    check_team_rewards,
    note_of,
    note_text,
    parse_note,
)
from swarmdata.interop.conversion.foreign_data import unread_note
from swarmdata.interop.conversion.foreign_file import reading
from swarmdata.interop.conversion.foreign_rows import admit_rows, flags_of
from swarmdata.interop.conversion.hdf5_reader import open_hdf5
from swarmdata.interop.conversion.imported_data import (
    UNKNOWN_POLICIES,
    ImportedData,
    build_episode,
)
from swarmdata.interop.conversion.user_choices import Choices
from swarmdata.interop.formats import Format
from swarmdata.numerics.event_costs import costs_of
from swarmdata.runtime.atomic import require_space
from swarmdata.runtime.extras import require_extra
from swarmdata.runtime.mapped_pages import MappedReads
from swarmdata.specs.origins import RecordedAgent, RecordedSpec
from swarmdata.specs.spaces import (
    DictSpace,
    as_bytes,
    flatten,
    holds_bytes,
    space_of,
    stack_agents,
    to_gymnasium,
    unflatten,
    width,
)
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Episode

NOTE_KEY = "swarmdata"

KEPT_NAMES = {
    "observations": "observations",
    "states": "infos/states",
    "sent": "infos/sent",
    "delivered": "infos/delivered",
    "ages": "infos/message_ages",
    "actions": "actions",
    "log_probs": "infos/log_probs",
    "rewards": "infos/agent_rewards",
    "reward_terms": "infos/reward_terms",
    "terminations": "terminations",
    "truncations": "truncations",
    "events": "infos/events",
    "alive": "infos/alive",
    "action_masks": "infos/action_masks",
    "agent_terminations": "infos/agent_terminations",
    "agent_truncations": "infos/agent_truncations",
    "layout": "infos/layout",
    **dict.fromkeys(NOTED_FACTS, "metadata.json"),
}

_SPARE_BYTES = 4 << 20  # bytes that HDF5 may need besides an episode's own, and to close the file

_INFO_KEYS = {
    name: key.removeprefix("infos/") for name, key in KEPT_NAMES.items() if "infos/" in key
}


def _library() -> Any:
    require_extra("minari", "minari", "the Minari format")
    import minari  # noqa: PLC0415  (an extra)
    from minari.dataset.minari_storage import MinariStorage  # noqa: PLC0415

    return minari, MinariStorage


def write(dataset: Dataset, path: Path, frame: str) -> None:
    """Writes a view as a Minari dataset."""
    minari, storage_type = _library()
    from minari.data_collector import EpisodeBuffer  # noqa: PLC0415  (an extra)

    agents = recorded_agents(dataset.spec, dataset.stored.arrays["observations"].shape[2])
    observation, action = (
        to_gymnasium(DictSpace(spaces={agent.name: getattr(agent, kind) for agent in agents}))
        for kind in ("observation", "action")
    )
    path.mkdir()
    storage = storage_type.new(
        path / "data", observation_space=observation, action_space=action, data_format="hdf5",
        jpeg_encoding=False,
    )  # fmt: skip
    names = array_names(dataset)
    storage.update_episodes(
        EpisodeBuffer(seed=np.uint64(episode.seed), **_buffers(episode, agents, names))
        for episode in _while_there_is_room(dataset, path)
    )
    storage.update_metadata(
        {
            **_environments(dataset, frame),
            "dataset_id": dataset.id,
            "minari_version": minari.__version__,
            "algorithm_name": ", ".join(source.label for source in dataset.recipe.policies),
            "description": f"{dataset!r}".removeprefix("<").partition(", at ")[0],
            NOTE_KEY: note_text(dataset, frame),
        }
    )


def _environments(dataset: Dataset, frame: str) -> dict[str, str]:
    """Minari's descriptions of the world that was recorded and of the one for evaluation."""
    world = note_of(dataset, frame).spec.world
    if world is None:
        return {}
    from gymnasium.envs.registration import EnvSpec  # noqa: PLC0415  (only who converts needs it)

    def described(spec: TaskSpec, **options: Any) -> str:
        return EnvSpec(
            id=f"swarmdata/{spec.task}-v{spec.version}",
            entry_point="swarmdata.envs.world.team_env:TeamEnv",
            disable_env_checker=True,  # it warns of observations without bounds
            kwargs={"spec": spec.model_dump(mode="json"), "frame": frame, **options},
        ).to_json()

    return {"env_spec": described(world), "eval_env_spec": described(dataset.task, reserved=True)}


def misplaced(dataset: Dataset, path: Path) -> str | None:
    """Says how Minari finds an export whose folder does not have the name of the dataset."""
    if path.name == dataset.id:
        return None
    data = str(path / "data")
    return (
        f"minari finds a dataset by its id only in a folder of that name: rename {path} to "
        f"{path.with_name(dataset.id)}, or open it with minari.MinariDataset({data!r})"
    )


def _while_there_is_room(dataset: Dataset, path: Path) -> Iterator[Episode]:
    """Yields episodes; raises before a full disk would crash HDF5, whose file Minari opens."""
    reads = MappedReads(dataset.stored.arrays.values())
    for episode in dataset:
        arrays = [getattr(episode, name) for name in episode.__slots__]
        size = sum(array.nbytes for array in arrays if isinstance(array, np.ndarray))
        require_space(path, _SPARE_BYTES + 2 * size)
        yield episode
        reads.add(episode.observations, episode.states, episode.actions)


def _buffers(
    episode: Episode, agents: tuple[RecordedAgent, ...], names: tuple[str, ...]
) -> dict[str, Any]:
    """The fields of an `EpisodeBuffer`."""
    infos = {key: getattr(episode, name) for name, key in _INFO_KEYS.items() if name in names}
    if episode.layout.size:
        infos["layout"] = episode.layout
    if (costs := costs_of(episode.events)) is not None:
        infos["costs"] = costs
    observations, actions = (
        {agent.name: unflatten(getattr(agent, kind), rows[:, k]) for k, agent in enumerate(agents)}
        for kind, rows in (("observation", episode.observations), ("action", episode.actions))
    )
    return {
        "observations": observations,
        "actions": actions,
        "rewards": episode.rewards.mean(axis=1, dtype=np.float64),
        "terminations": episode.terminations,
        "truncations": episode.truncations,
        "infos": infos,
    }


@contextmanager
def read(source: Path, task: str, choices: Choices) -> Iterator[ImportedData]:
    """Opens the folder of a Minari dataset, or the `data` folder inside it.

    The entries of its Dict spaces are the agents if this library wrote it, or if `choices.agents`
    names exactly their keys. Otherwise there is one agent.
    """
    folder = source / "data" if (source / "data").is_dir() else source
    if not (folder / "metadata.json").is_file():
        raise ConversionError(f"{source} has no data/metadata.json, so it is not a Minari dataset")
    found, text, unread = _open(folder)
    if text is None:
        yield _read_foreign(found, source, task, choices, unread)
    else:
        yield _read_exported(found, source, parse_note(text, source))


def _open(folder: Path) -> tuple[Any, str | None, list[str]]:
    """Minari's dataset, the note of an export if it has one, and the infos of its first episode."""
    minari, storage_type = _library()
    with reading(folder, "It is damaged, or not a Minari dataset."):
        raw = storage_type.read_raw_metadata(folder)
        text, spaces = raw.get(NOTE_KEY), {"observation_space", "action_space"} - set(raw)
    if spaces:
        raise ConversionError(
            f"{folder} lacks {', '.join(sorted(spaces))} in its metadata.json. Minari would make "
            "the environment that it names, which may run any program. Add the spaces."
        )
    unread: list[str] = []
    if (file := folder / "main_data.hdf5").is_file():
        with open_hdf5(file) as opened:  # looked at: Minari opens it again
            infos = opened.get("episode_0/infos")
            unread = [f"infos/{name}" for name in infos] if hasattr(infos, "keys") else []
    with reading(folder, "It is damaged, or not a Minari dataset."):
        return minari.MinariDataset(folder), text, unread


def _read_exported(found: Any, source: Path, note: ExportNote) -> ImportedData:
    if len(note.episodes.lengths) != len(found):
        raise ConversionError(
            f"{source} has {len(found)} episodes, but its note of swarmdata says "
            f"{len(note.episodes.lengths)}. It was changed after the export: remove the key "
            f"{NOTE_KEY!r} of its metadata.json to convert it as foreign data."
        )
    with reading(source):
        spaces = found.observation_space.spaces
        widths = [width(space_of(spaces[k], f"space of {k}")) for k in note.spec.agent_names]
    agents = recorded_agents(note.spec, max(widths))
    return note.imported(_exported_episodes(source, found, note, agents))


def _read_foreign(
    found: Any, source: Path, task: str, choices: Choices, unread: list[str]
) -> ImportedData:
    agents, is_team = _foreign_agents(found, choices)
    env_spec = getattr(found, "env_spec", None)
    content = {
        "task": task,
        "library": "" if env_spec is None else re.split(r"[:.]", str(env_spec.entry_point))[0],
        "agents": agents,
        "state_size": sum(width(agent.observation) for agent in agents),
        "state_from": "observations",
    }
    spec = RecordedSpec.parse(content, str(source))
    episodes = _foreign_episodes(source, found, agents, is_team)
    return ImportedData(spec, UNKNOWN_POLICIES, episodes, metadata=unread_note(unread))


def _foreign_agents(found: Any, choices: Choices) -> tuple[tuple[RecordedAgent, ...], bool]:
    observation = space_of(found.observation_space, "observation space")
    action = space_of(found.action_space, "action space")
    names = choices.agents
    if useless := [name for name in choices.given() if name != "agents"]:
        raise ConversionError(
            "Minari says where episodes end and what the spaces are, got "
            f"{', '.join(useless)} as well. Leave these options out; agents takes names, the keys "
            "of Dict spaces."
        )
    if names is None:
        return (RecordedAgent(name="agent_0", observation=observation, action=action),), False
    keys = [sorted(s.spaces) if isinstance(s, DictSpace) else None for s in (observation, action)]
    if keys != [sorted(names)] * 2:
        raise ConversionError(
            f"agents are {names}, expected the keys of the Dict spaces of observations and actions "
            f"({keys[0]}, {keys[1]})"
        )
    assert isinstance(observation, DictSpace)
    assert isinstance(action, DictSpace)
    return tuple(
        RecordedAgent.parse(
            {"name": n, "observation": observation.spaces[n], "action": action.spaces[n]}
        )
        for n in names
    ), True


def _episodes(source: Path, found: Any) -> Iterator[Any]:
    """Yields Minari's episodes, each checked against its metadata."""
    with reading(source):
        metadata = list(found.storage.get_episode_metadata(found.episode_indices))
        episodes = found.iterate_episodes()
    for number, facts in enumerate(metadata):
        with reading(f"{source}, episode {number}"):
            data = next(episodes)
            n, expected = len(data), int(facts["total_steps"])
        if n != expected or not n:
            raise ConversionError(
                f"{source}: episode {data.id} has {n} steps, but its metadata says {expected}. "
                "Minari's Arrow storage cuts long episodes; convert the dataset from its HDF5 "
                "storage."
            )
        yield data


def _joint(
    data: Any, agents: tuple[RecordedAgent, ...], source: Path, is_team: bool
) -> dict[str, NDArray[Any]]:
    """Observations and actions of all agents."""
    rows, T = {}, len(data)
    for field, space, n in (("observations", "observation", T + 1), ("actions", "action", T)):
        values = getattr(data, field)
        parts: list[NDArray[Any]] = []
        for agent in agents:
            where = f"{source}: {field} of {agent.name} in episode {data.id}"
            own = {agent.name: values} if not is_team else values
            if not isinstance(own, Mapping) or agent.name not in own:
                raise ConversionError(f"{where} are missing, expected one entry for each agent")
            parts.append(flatten(getattr(agent, space), own[agent.name], where, (n,)))
        if space == "observation" and all(holds_bytes(agent.observation) for agent in agents):
            parts = [as_bytes(part, f"{source}: {field} of episode {data.id}") for part in parts]
        rows[field] = stack_agents(parts)
    return rows


def _exported_episodes(
    source: Path, found: Any, note: ExportNote, agents: tuple[RecordedAgent, ...]
) -> Iterator[Episode]:
    for k, data in enumerate(_episodes(source, found)):
        rows = _joint(data, agents, source, is_team=True)
        kept = {name: key for name, key in _INFO_KEYS.items() if name in TIME_ARRAYS}
        rows |= {name: data.infos[key] for name, key in kept.items() if key in data.infos}
        where = f"{source}, episode {data.id}"
        rows |= _flags(data, where)
        _check_rows(source, data, rows)
        check_team_rewards(data.rewards, rows["rewards"], where)
        yield note.episode(k, rows, data.infos.get("layout"))


def _flags(data: Any, where: str) -> dict[str, NDArray[Any]]:
    """The team's flags, [T] each."""
    return {
        name: flags_of(getattr(data, name), 1, f"{where}: {name}")[:, 0]
        for name in ("terminations", "truncations")
    }


def _check_rows(source: Path, data: Any, rows: Mapping[str, NDArray[Any]]) -> None:
    for name, values in rows.items():
        expected = len(data) + (name in STATE_ARRAYS)
        if len(values) != expected:
            raise ConversionError(
                f"{source}: {name} of episode {data.id} has {len(values)} rows, expected {expected}"
            )


def _foreign_episodes(
    source: Path, found: Any, agents: tuple[RecordedAgent, ...], is_team: bool
) -> Iterator[Episode]:
    """Episodes that this library did not write: every agent gets the reward; seeds are numbers."""
    for number, data in enumerate(_episodes(source, found)):
        rows = _joint(data, agents, source, is_team)
        widths = [width(agent.observation) for agent in agents]
        observations = [rows["observations"][:, k, :n] for k, n in enumerate(widths)]
        rows["states"] = np.concatenate(observations, axis=1)
        where = f"{source}, episode {data.id}"
        rows |= admit_rows({"rewards": np.asarray(data.rewards)}, len(agents), where)
        flags = _flags(data, where)
        _check_rows(source, data, rows | flags)
        ends = flags["terminations"] | flags["truncations"]
        if ends[:-1].any() or not ends[-1]:
            raise ConversionError(f"{where} does not end exactly once, in its last row")
        end = "termination" if flags["terminations"][-1] else "truncation"
        yield build_episode(rows, seed=number, policy=0, end=end)


FORMAT = Format("minari", "Minari", KEPT_NAMES, {}, read, write, misplaced)
