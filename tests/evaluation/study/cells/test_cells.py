"""What a study asks for: cells with complete configurations, and keys of all that decides them."""

import shutil
from pathlib import Path
from typing import Any

import pytest

from swarmdata.errors import (
    CheckpointError,
    SchemaError,
    SpecError,
    SwarmdataError,
    UnknownNameError,
)
from swarmdata.evaluation.study.cells.cells import FIELDS_OUTSIDE_KEY, Cell, cells_of
from swarmdata.evaluation.study.cells.study_data import (
    dataset_of_size,
    digest_of,
    short_count,
    short_name,
)
from swarmdata.evaluation.study.plan import Study
from swarmdata.learn.training.run_files import find_run, run_hash
from swarmdata.offline_algos.mac_flow import MACFlowConfig
from swarmdata.registry.presets import preset
from swarmdata.specs.rules import chosen_weights
from tests.evaluation.study.conftest import BC, MADDPG, Make


def cells(study: Study) -> dict[str, Cell]:
    return {cell.name: cell for cell in cells_of(study, lambda name: f"digest of {name}")}


def configs(make_study: Make, algorithms: Any, **changes: Any) -> list[dict[str, Any]]:
    """Configurations of the rows on one dataset."""
    study = make_study(algorithms=algorithms, datasets=["coop_nav-medium"], **changes)
    return [cell.config for cell in cells(study).values()]


def test_configurations_are_complete_and_scaled(make_study: Make) -> None:
    row = {**MADDPG, "settings": {"actor_hidden": [4, 4], "max_grad_norm": 2}}
    half, own = configs(make_study, {"maddpg_bc": {}, "own": row}, budget=0.5)
    assert half["n_updates"] == 9000
    assert (half["actor_hidden"], half["critic_hidden"]) == ([8], [8])
    assert (own["n_updates"], own["max_grad_norm"]) == (10, 2.0)
    assert (own["actor_hidden"], own["critic_hidden"]) == ([4, 4], [8])


def test_widths_are_of_actors_and_critics_and_not_of_what_teaches_them(make_study: Make) -> None:
    row = {"algorithm": "mac_flow", "settings": {"flow_hidden": [4, 4]}}
    own, wide = configs(make_study, {"mac_flow": {}, "wide": row})
    assert (own["actor_hidden"], own["critic_hidden"]) == ([8], [8])
    assert own["flow_hidden"] == list(MACFlowConfig().flow_hidden)
    assert wide["flow_hidden"] == [4, 4]


def test_settings_for_all_reach_those_that_have_them(make_study: Make) -> None:
    rows = {"bc": BC, "own": {**MADDPG, "settings": {"max_grad_norm": 2}}}
    bc, own = configs(make_study, rows, settings={"actor_hidden": [4, 4], "max_grad_norm": 3})
    assert (bc["hidden"], own["actor_hidden"], own["critic_hidden"]) == ([8], [4, 4], [8])
    assert own["max_grad_norm"] == 2.0


def test_a_setting_that_nobody_has_is_refused(make_study: Make) -> None:
    with pytest.raises(SpecError, match="settings has sharpness, which none"):
        cells(make_study(settings={"sharpness": 1}))


IDLE = {"memory_size": 8}  # without effect unless `memory` is gru


@pytest.mark.parametrize(
    "changes",
    [
        {"algorithms": {"bc": {"settings": IDLE}}},
        {"algorithms": {"bc": {}}, "settings": IDLE},
        {"online": {"on": {"algorithm": "mappo", "task": "coop_nav", "settings": IDLE}}},
    ],
)
def test_a_setting_without_effect_is_refused(make_study: Make, changes: dict[str, Any]) -> None:
    with pytest.raises(SpecError, match=r"memory_size.* has no effect with memory 'none'"):
        cells(make_study(**changes))


def test_a_setting_for_all_has_an_effect_in_some_row(make_study: Make) -> None:
    rows = {"bc": {}, "gru": {"algorithm": "bc", "settings": {"memory": "gru"}}}
    _, gru = configs(make_study, rows, settings=IDLE)
    assert gru["memory_size"] == 8


def test_updates_of_a_row_win_over_those_for_all(make_study: Make) -> None:
    bc, own = configs(make_study, {"bc": {}, "own": BC}, settings={"n_updates": 7})
    assert (bc["n_updates"], own["n_updates"]) == (7, 20)


def test_sizes_are_datasets_and_a_full_one_is_the_studys_own(make_study: Make) -> None:
    sizes = {"datasets": ["coop_nav-medium"], "algorithms": ["bc"]}
    found = cells(make_study(datasets=["coop_nav-medium"], sizes=sizes))
    assert sorted(found) == [
        "bc/coop_nav-medium",
        "bc/coop_nav-medium-200k",
        "bc/coop_nav-medium-mini",
        "other/coop_nav-medium",
    ]
    assert found["bc/coop_nav-medium-200k"].n_steps == 200_000
    assert found["bc/coop_nav-medium-mini"].source == "coop_nav-medium-mini"


def test_curves_are_of_the_datasets_that_are_named(make_study: Make) -> None:
    curves = {"points": 4, "datasets": ["coop_nav-medium"]}
    names = ["coop_nav-medium", "coop_nav-expert"]
    found = cells(make_study(datasets=names, curves=curves))
    assert found["bc/coop_nav-medium"].curve_every == 5
    assert found["bc/coop_nav-expert"].curve_every is None


OTHERS: dict[str, Any] = {
    "kind": "online", "label": "x", "data": "x", "family": "x", "algorithm": "x", "source": "x",
    "config": {"n_updates": 21}, "run": "x", "digest": "e" * 64, "n_steps": 7, "observation": "x",
    "communication": "x", "frame": "world", "rewards": {"time": 1.0}, "parts": {"x": 1.0},
    "side": "x", "opponents": "x", "opponents_hash": "x", "start": "x", "start_hash": "x",
    "seeds": (0, 2), "n_episodes": 5, "curve_every": 3, "block": "validation",
    "device": "cuda", "curve_episodes": 3, "code_version": "x",
}  # fmt: skip


@pytest.mark.parametrize("name", sorted(Cell.model_fields))
def test_keys_change_with_all_that_decides(make_study: Make, name: str) -> None:
    cell = next(iter(cells(make_study()).values()))
    other = cell.model_copy(update={name: OTHERS[name]})
    assert (other.key == cell.key) == (name in FIELDS_OUTSIDE_KEY)


def test_keys_change_with_files_and_code_that_only_their_names_are_in(
    make_study: Make, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def keys(**changes: Any) -> list[str]:
        return [cell.key for cell in cells(make_study(**changes)).values()]

    task = tmp_path / "mine.yaml"
    task.write_text(preset("coop_nav").to_yaml())
    online = {"on": {"algorithm": "mappo", "task": str(task), "frames": 500}}
    before = keys(online=online)
    task.write_text(preset("coop_nav").with_updates(horizon=50).to_yaml())
    assert [a == b for a, b in zip(before, keys(online=online), strict=True)] == [1, 1, 0]

    run = tmp_path / "evader"
    run.mkdir()
    (run / "config.json").write_text('{"seeds": [3], "dataset": "x"}')
    sides = {"pursuers": "scripted", "evader": str(run)}
    before = keys(sides=sides)
    (run / "checkpoint.safetensors").write_bytes(b"trained further")
    assert [a == b for a, b in zip(before, keys(sides=sides), strict=True)] == [1, 1, 0, 0]
    before, moved = keys(sides=sides), tmp_path / "there" / "evader"
    shutil.copytree(run, moved)
    assert keys(sides=sides | {"evader": str(moved)}) == before, "archives leave places out"

    before = keys()
    monkeypatch.setattr("swarmdata.evaluation.runs.provenance.own_codes", lambda **used: used)
    assert not {*before} & {*keys()}, "the code of a task of a user"


def test_two_cells_of_one_name_are_refused(make_study: Make, data: Path, tmp_path: Path) -> None:
    folders = [str(shutil.copytree(data, tmp_path / part / "same")) for part in "ab"]
    with pytest.raises(SpecError, match="two different cells are called bc/same"):
        cells(make_study(datasets=folders))


def test_data_of_two_names_are_refused(make_study: Make) -> None:
    names = ["coop_nav-medium", "coop_nav-expert", "coop_nav-medium-v1"]
    with pytest.raises(SpecError, match="coop_nav-medium and coop_nav-medium-v1, which hold the"):
        cells_of(make_study(datasets=names), digest_of)
    mixtures = {"a": dict.fromkeys(names[:2], 1), "b": dict.fromkeys(names[:2], 2)}
    with pytest.raises(SpecError, match="a and b, which hold the same data"):
        cells_of(make_study(datasets=["a", "b"], mixtures=mixtures), digest_of)


@pytest.mark.parametrize(
    ("view", "message"),
    [
        ({"observation": "stat"}, "Did you mean 'state'"),
        ({"communication": "none"}, "view is for coop_nav-medium the same as recorded"),
    ],
)
def test_views_that_do_not_fit_are_refused_before_anything_runs(
    make_study: Make, view: dict[str, str], message: str
) -> None:
    views = {"recorded": {}, "view": view}
    plan = {"datasets": ["coop_nav-medium"], "algorithms": ["bc"], "views": views}
    with pytest.raises(SwarmdataError, match=message):
        cells(make_study(datasets=["coop_nav-medium"], information=plan))


def test_unknown_names_are_told(make_study: Make) -> None:
    with pytest.raises(UnknownNameError, match="Did you mean 'maddpg_bc'"):
        cells(make_study(algorithms={"x": {"algorithm": "madpg_bc", "family": "f"}}))
    with pytest.raises(UnknownNameError, match="Did you mean 'output'"):
        cells(make_study(algorithms={"x": {**BC, "settings": {"outputs": "tanh"}}}))
    with pytest.raises(SpecError, match="is not a run folder"):
        cells(make_study(online={"x": {"run": "nowhere"}}))


def test_a_row_may_have_seeds_of_its_own(make_study: Make) -> None:
    algorithms = {"bc": BC, "bc-again": {**BC, "seeds": [5, 6, 7]}}
    found = cells(make_study(algorithms=algorithms, datasets=["coop_nav-medium"], seeds=3))
    first, again = found["bc/coop_nav-medium"], found["bc-again/coop_nav-medium"]
    assert (first.seeds, again.seeds) == ((0, 1, 2), (5, 6, 7))
    assert first.key != again.key


def test_a_row_with_other_rewards_has_their_weights(make_study: Make, data: Path) -> None:
    algorithms = {
        "bc": BC,
        "safe": {**BC, "rewards": "safe"},
        "own": {**BC, "rewards": {"robot_collision": 2.5, "time": 0.02}},
    }
    for dataset, name in (("coop_nav-medium", "coop_nav-medium"), (str(data), data.name)):
        found = cells(make_study(algorithms=algorithms, datasets=[dataset]))
        weights = preset("coop_nav").rules.rewards
        safe = found[f"safe/{name}"].rewards
        assert safe == chosen_weights("safe", preset("coop_nav").rules)
        assert found[f"own/{name}"].rewards == {"robot_collision": 2.5}, "others are as recorded"
        assert weights.time == 0.02
        assert found[f"bc/{name}"].rewards == {}
        assert len({cell.key for cell in found.values()}) == 3


@pytest.mark.parametrize(
    ("rewards", "message"),
    [
        ("save", "unknown set of reward weights 'save'. Did you mean 'safe'"),
        ({"robot_colision": 1}, "unknown reward weight 'robot_colision'. Did you mean"),
        ({"robot_collision": -1}, "rewards.*robot_collision"),
        ({"time": 0.02}, "leave the weights of coop_nav-medium as they are"),
    ],
)
def test_rewards_that_do_not_fit_are_refused_before_anything_runs(
    make_study: Make, rewards: Any, message: str
) -> None:
    row = {**BC, "rewards": rewards}
    with pytest.raises(SwarmdataError, match=message):
        cells(make_study(algorithms={"x": row}, datasets=["coop_nav-medium"]))


def test_views_are_of_the_datasets_that_a_row_is_trained_on(make_study: Make) -> None:
    both = {"datasets": ["coop_nav-medium", "coop_nav-expert"]}
    study = make_study(
        **both,
        algorithms={"bc": BC, "few": {**BC, "datasets": ["coop_nav-expert"]}},
        information={
            **both, "algorithms": ["bc", "few"], "views": {"near": {"observation": "state-1"}}
        },
    )  # fmt: skip
    views = {name for name, cell in cells(study).items() if cell.observation}
    assert views == {
        "bc/coop_nav-medium~state-1", "bc/coop_nav-expert~state-1", "few/coop_nav-expert~state-1"
    }  # fmt: skip


def test_results_from_before_a_setting_are_kept(make_study: Make) -> None:
    """Cells were finished before online algorithms had reward weights."""
    on = {"algorithm": "vdn", "task": "coop_nav", "frames": 500}
    cell = cells(make_study(online={"on": on}))["on/coop_nav"]
    assert (cell.kind, cell.n_updates, cell.seeds) == ("online", 500, (0, 1))
    config = {k: v for k, v in cell.config.items() if k != "reward_weights"}
    assert cell.key == cell.model_copy(update={"config": config}).key
    others = on | {"settings": {"reward_weights": ["time=0.04"]}}
    assert cell.key != cells(make_study(online={"on": others}))["on/coop_nav"].key


def test_an_online_row_takes_over_what_it_starts_from(make_study: Make, tmp_path: Path) -> None:
    start = "zoo:bc/coop_nav-expert"
    folder = find_run(start)
    assert folder is not None
    row = {"algorithm": "maddpg", "task": "coop_nav", "frames": 500}
    fresh, begun = (
        cells(make_study(online={"on": each}))["on/coop_nav"]
        for each in (row, row | {"start": start})
    )
    assert (begun.config["actor_hidden"], begun.start) == ([64, 64], start)
    assert (fresh.start_hash, begun.start_hash) == (None, run_hash(folder, 0))
    copy = shutil.copytree(folder, tmp_path / "copy")
    assert (
        cells(make_study(online={"on": row | {"start": str(copy)}}))["on/coop_nav"].key == begun.key
    )
    with pytest.raises(CheckpointError, match="was trained for coop_nav"):
        cells(make_study(online={"on": row | {"start": start, "task": "formation"}}))


def test_names_and_sizes_of_datasets(data: Path) -> None:
    assert short_name("coop_nav-medium") == "coop_nav-medium"
    assert short_name(str(data)) == "coop_nav-tiny-v0"
    assert dataset_of_size("coop_nav-medium-v1", "mini") == ("coop_nav-medium-mini-v1", None)
    assert (short_count(200_000), short_count(1500)) == ("200k", "1500")
    with pytest.raises(SchemaError, match="has no mini"):
        dataset_of_size(str(data), "mini")
    assert len(digest_of("coop_nav-medium")) == 64
