"""Every format: any view survives there and back in what its table promises."""

import json
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from docs.site.data_pages import YOUR_DATA, your_data_page
from swarmdata.datasets.dataset import Dataset
from swarmdata.errors import ConversionError, DatasetNotFoundError, UnknownNameError
from swarmdata.evaluation.runs.generated_dataset import generate
from swarmdata.interop.conversion.dataset_facts import DATASET_FACTS, TIME_ARRAYS
from swarmdata.interop.conversion.export_note import note_of, parse_note
from swarmdata.interop.conversion.user_choices import Choices
from swarmdata.interop.convert import import_dataset, source_digest
from swarmdata.interop.export import export_dataset
from swarmdata.interop.formats import FORMATS, all_formats, find_format
from swarmdata.specs.origins.recording_origin import Recording
from swarmdata.types import END_REASONS, Episode
from tests.interop.foreign import NEEDS

SLOW = ("torchrl", "vault")
WRITTEN = [
    pytest.param(name, marks=[pytest.mark.slow] if name in SLOW else [])
    for name in FORMATS
    if find_format(name).read is not None
]


def check_kept(before: Sequence[Episode], after: Sequence[Episode], kept: Iterable[str]) -> None:
    """Every fact of episodes that a format keeps is the same, bit for bit."""
    for expected, got in zip(before, after, strict=True):
        for name in kept:
            ours, theirs = getattr(expected, name), getattr(got, name)
            if name in TIME_ARRAYS and ours is not None and not ours.size:
                assert not theirs.size, name
            else:
                assert getattr(theirs, "dtype", None) == getattr(ours, "dtype", None), name
                np.testing.assert_array_equal(theirs, ours, err_msg=name)


def episode_facts(name: str) -> list[str]:
    return [fact for fact in find_format(name).kept if fact not in ("split", "spec")]


@pytest.mark.parametrize("kind", ["ours", "recorded", "images"])
@pytest.mark.parametrize("name", WRITTEN)
def test_a_dataset_survives(
    name: str, kind: str, request: pytest.FixtureRequest, tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    """In blocks of a few rows."""
    pytest.importorskip(NEEDS.get(name, "h5py"), reason=f"the extra of {name}")
    monkeypatch.setattr("swarmdata.interop.conversion.dataset_facts.BLOCK_BYTES", 2000)
    monkeypatch.setattr("swarmdata.interop.conversion.foreign_data.BLOCK_BYTES", 1500)
    monkeypatch.setattr("swarmdata.interop.convert.BLOCK_BYTES", 1000)
    monkeypatch.setattr("swarmdata.interop.parquet._GROUP_ROWS", 3)
    dataset: Dataset = request.getfixturevalue(kind)
    (tmp_path / "there").mkdir()
    path = export_dataset(dataset, tmp_path / "there" / dataset.id, format=name)
    made = import_dataset(path, tmp_path / "back", format=name, id="tag_v3-back-v0", splits="kept")
    back = Dataset.open(made.path, verify="full")
    check_kept(list(dataset), list(back), episode_facts(name))
    np.testing.assert_array_equal(back.episodes.split, dataset.episodes.split)
    assert isinstance(back.recipe, Recording)
    assert back.recipe.source == name
    assert (back.spec, back.recipe.policies) == (dataset.spec, dataset.recipe.policies)
    for array in ("observations", "states"):
        assert back.stored.arrays[array].dtype == dataset.stored.arrays[array].dtype
    if ("alive" in back.stored.arrays) == ("alive" in dataset.stored.arrays):
        assert back.statistics.reward_mean == dataset.statistics.reward_mean


@pytest.mark.parametrize("name", WRITTEN)
@given(data=st.data())
@settings(max_examples=4)
def test_any_view_survives(
    name: str, data: st.DataObject, ours: Dataset, recorded: Dataset,
    tmp_path_factory: pytest.TempPathFactory,
) -> None:  # fmt: skip
    pytest.importorskip(NEEDS.get(name, "h5py"), reason=f"the extra of {name}")
    whole = data.draw(st.sampled_from((ours, recorded)))
    chosen = data.draw(st.sets(st.integers(0, len(whole) - 1), min_size=1))
    view = replace(whole, selection=whole.selection[sorted(chosen)])
    block = data.draw(st.sampled_from((1, 500, 1 << 20)))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("swarmdata.interop.conversion.dataset_facts.BLOCK_BYTES", block)
        patch.setattr("swarmdata.interop.conversion.foreign_data.BLOCK_BYTES", block)
        path = tmp_path_factory.mktemp("any") / whole.id
        read = find_format(name).read
        assert read is not None
        with read(export_dataset(view, path, format=name), "task", Choices()) as incoming:
            episodes = list(incoming.episodes)
    assert incoming.spec == whole.spec
    assert incoming.splits is not None
    np.testing.assert_array_equal(incoming.splits, view.episodes.split)
    check_kept(list(view), episodes, episode_facts(name))


def test_tables_name_every_fact_once() -> None:
    for kind in all_formats():
        assert sorted([*kind.kept, *kind.lost]) == sorted(DATASET_FACTS), kind.name


def test_golden_page(update_golden: bool) -> None:
    if update_golden:
        YOUR_DATA.write_text(your_data_page(), encoding="utf-8")
    assert YOUR_DATA.read_text(encoding="utf-8") == your_data_page()


def test_notes_survive(ours: Dataset, recorded: Dataset) -> None:
    for dataset in (ours, recorded):
        note = note_of(dataset, "world")
        assert parse_note(note.to_json(), "x") == note
    content = note.model_dump(mode="json")
    for text in ("{", "[]", "{}", json.dumps(content | {"id": "no"})):
        with pytest.raises(ConversionError, match="the note of swarmdata in x cannot be read"):
            parse_note(text, "x")
    earlier = {**content, "episodes": {**content["episodes"], "truncated": []}}
    at_horizon = np.array(note.episodes.end_reason) == END_REASONS.index("horizon")
    assert (parse_note(json.dumps(earlier), "x").truncated == at_horizon).all()
    assert (note.truncated != at_horizon).any(), "an episode was cut although it succeeded"
    content["episodes"]["seeds"] = [1]
    with pytest.raises(ConversionError, match="columns of different lengths"):
        parse_note(json.dumps(content), "x")


def test_one_side_is_no_dataset_of_its_task(tmp_path: Path) -> None:
    made = generate(
        "tag", ["scripted"], id="tag-x-v0", n_steps=400, out=tmp_path / "ds", progress=False
    )
    path = export_dataset(made.side("evader"), tmp_path / "side", format="numpy")
    with pytest.raises(ConversionError, match="holds one side of tag-x-v0, the evader"):
        import_dataset(path, tmp_path / "back", format="numpy", id="tag-back-v0")


def test_source_digests(tmp_path: Path) -> None:
    (tmp_path / "a/b").mkdir(parents=True)
    (tmp_path / "a/b/x").write_bytes(b"1")
    first = source_digest(tmp_path / "a")
    (tmp_path / "a/y").write_bytes(b"2")
    second = source_digest(tmp_path / "a")
    (tmp_path / "a/y").rename(tmp_path / "a/b/y")
    assert len({first, second, source_digest(tmp_path / "a")}) == 3


def test_wrong_requests(ours: Dataset, tmp_path: Path) -> None:
    with pytest.raises(UnknownNameError, match="Did you mean 'minari'"):
        export_dataset(ours, tmp_path / "x", format="minary")
    with pytest.raises(DatasetNotFoundError, match="nothing at"):
        import_dataset(tmp_path / "x", tmp_path / "y", format="d4rl", id="a-b-v0")
    empty = replace(ours, selection=ours.selection[:0])
    with pytest.raises(ConversionError, match="no episodes"):
        export_dataset(empty, tmp_path / "x", format="d4rl")
    assert not list(tmp_path.iterdir())


def test_wrong_choices() -> None:
    for answers, problem in (
        ({"time_limit": -1}, "time_limit is -1"),
        ({"time_limit": "10"}, "expected a whole number of at least 0"),
        ({"episode_length": 0}, "episode_length is 0"),
        ({"episode_length": 10.5}, "expected a whole number of at least 1"),
        ({"agents": 2.0}, "n_agents is 2.0"),
        ({"final": "no"}, "final is 'no'"),
        ({"unfinished": "no"}, "unfinished is 'no'"),
        ({"agents": "a,a"}, "expected different names"),
        ({"action_low": 2.0, "action_high": 1.0}, "is above action_high"),
        ({"action_low": "-1", "action_high": np.nan}, "expected numbers"),
    ):
        with pytest.raises(ConversionError, match=problem):
            Choices.of(**answers)
    assert Choices.of(agents="3").n_agents == Choices.of(agents=np.int64(3)).n_agents == 3
    assert Choices.of(agents="a,b").agents == ("a", "b")


def test_a_failed_export_leaves_nothing(
    ours: Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("swarmdata.interop.d4rl.note_text", lambda *view: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        export_dataset(ours, tmp_path / "x", format="d4rl")
    assert not list(tmp_path.iterdir())
