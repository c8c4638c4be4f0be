"""A clean dataset of our own, a clean recording, and copies of them with planted flaws."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from swarmdata.audit import Audit, audit
from swarmdata.building.part_maker import make_part
from swarmdata.cards.card import write_card
from swarmdata.registry.components import make_env
from swarmdata.registry.presets import preset
from swarmdata.specs.origins import Origin
from swarmdata.specs.origins.recording_origin import Recording
from swarmdata.specs.recipe import PolicySource, Recipe
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.store import EpisodeTable, open_store
from swarmdata.store.arrays.layout import ALL_FIELDS, DType
from swarmdata.store.assembly import write_dataset
from swarmdata.types import END_REASONS
from tests.interop import conftest as recordings
from tests.interop.conftest import recorded_episode
from tests.support.made_episodes import stored

Arrays = dict[str, NDArray[Any]]
Flaw = Callable[[Arrays, EpisodeTable], Mapping[str, Any] | None]
Forge = Callable[..., Path]


def put(name: str, episode: int, step: int, place: tuple[int, ...], value: object) -> Flaw:
    """A value in the row of a step, or of the state before it."""

    def flaw(arrays: Arrays, table: EpisodeTable) -> None:
        extra = episode * (ALL_FIELDS[name].rows == "states")
        arrays[name][(table.starts[episode] + extra + step, *place)] = value

    return flaw


def timeouts_as(reason: str) -> Flaw:
    """Truncations become terminations, for this reason."""

    def flaw(arrays: Arrays, table: EpisodeTable) -> dict[str, Any]:
        arrays["terminations"] |= arrays["truncations"]
        arrays["truncations"][:] = False
        ends = np.full(len(table), END_REASONS.index(reason), np.uint8)
        return {"end_reason": ends, "success": np.zeros_like(table.success)}

    return flaw


def frozen(name: str) -> Flaw:
    """Every row of an episode is its first."""

    def flaw(arrays: Arrays, table: EpisodeTable) -> None:
        first = np.repeat(table.starts + np.arange(len(table)), table.lengths + 1)
        arrays[name][:] = arrays[name][first]

    return flaw


def final_rows(table: EpisodeTable) -> Any:
    return table.starts + np.arange(len(table)) + table.lengths


def crossing_windows(arrays: Arrays, table: EpisodeTable) -> None:
    """The last row of each episode is the first of the next, as after a reset by itself."""
    for name in ("observations", "states"):
        arrays[name][final_rows(table)[:-1]] = arrays[name][final_rows(table)[:-1] + 1]


def look(path: Path, sample: int = 4) -> Audit:
    return audit(path, sample=sample, progress=False)


def messages(found: Audit, check: str, level: str = "problem") -> str:
    return " | ".join(f.message for f in found.findings if (f.check, f.level) == (check, level))


@dataclass(frozen=True)
class InMemory:
    """Any table and arrays as the source of a dataset, however wrong they are."""

    table: EpisodeTable
    arrays: Mapping[str, NDArray[Any]]

    @property
    def names(self) -> Sequence[str]:
        return tuple(name for name in self.arrays if name in ALL_FIELDS)

    def row_shape(self, name: str) -> tuple[int, ...]:
        return self.arrays[name].shape[1:]

    def dtype(self, name: str) -> DType:
        return ALL_FIELDS[name].dtype

    def blocks(self, name: str) -> Iterator[NDArray[Any]]:
        extra = ALL_FIELDS[name].rows == "states"
        yield from np.split(self.arrays[name], np.cumsum(self.table.lengths + extra)[:-1])


@pytest.fixture
def forge(tmp_path: Path) -> Forge:
    """Writes a copy of a dataset with other arrays, columns or origin, rightly signed.

    Returns follow the rewards, as if somebody had converted wrong data with care.
    """

    def write(
        source: Path, change: Flaw = lambda arrays, table: None, recipe: Origin | None = None
    ) -> Path:
        stored = open_store(source)
        arrays = {name: array.copy() for name, array in stored.arrays.items()}
        columns = change(arrays, stored.table) or {}
        means = arrays["rewards"].mean(axis=1, dtype=np.float64)
        returns = np.add.reduceat(means, stored.table.starts)
        table = replace(stored.table, **{"team_return": returns, **columns})
        origin = recipe or stored.recipe
        folder = tmp_path / f"forged-{len(list(tmp_path.iterdir()))}"
        write_dataset(folder, origin, InMemory(table, arrays))
        return folder

    return write


@pytest.fixture(scope="session")
def clean(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A dataset of two policies in a short task whose robots talk, with all splits and its card."""
    folder = tmp_path_factory.mktemp("audit") / "clean"
    channel = {"kind": "broadcast", "drop_probability": 0.3}
    recipe = Recipe(
        id="coop_nav-small-v0",
        tier="small",
        spec=preset("coop_nav").with_updates(horizon=20, communication=channel),
        policies=tuple(PolicySource(label=name, name=name) for name in ("random", "straight")),
        n_steps=40 * 20,
        part_episodes=24,
    )
    env = make_env(recipe.spec, 24)
    stored(folder, recipe, [make_part(recipe, policy, 0, env) for policy in range(2)])
    write_card(folder)
    return folder


RECORDING = recordings.RECORDING.model_copy(
    update={"spec": recordings.SPEC.model_copy(update={"horizon": 12})}
)


def write_recording(folder: Path, seeds: Sequence[int]) -> Path:
    """Stores recorded episodes of these seeds; the odd ones are cut by the horizon."""
    episodes = [recorded_episode(12 if seed % 2 else 5 + seed % 7, seed) for seed in seeds]
    return stored(folder, RECORDING, [episodes]).path


@pytest.fixture(scope="session")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording of another environment, in which agents leave and have masks."""
    return write_recording(tmp_path_factory.mktemp("audit") / "recording", range(40))


@pytest.fixture(scope="session")
def long_recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The same, of episodes that are all cut by the horizon."""
    return write_recording(tmp_path_factory.mktemp("audit") / "long", range(1, 161, 4))


@pytest.fixture(scope="session")
def own_recording(clean: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The clean dataset as if somebody had recorded it: the same spec, another origin."""
    stored, folder = open_store(clean), tmp_path_factory.mktemp("audit") / "own"
    spec = stored.recipe.spec
    assert isinstance(spec, TaskSpec)
    policies = tuple(p.model_copy(update={"name": "external"}) for p in stored.recipe.policies)
    origin = Recording(id="coop_nav-mine-v0", spec=spec, policies=policies, source="recorder")
    write_dataset(folder, origin, InMemory(stored.table, stored.arrays))
    return folder
