"""A result's file gives back the same bits, says where they come from, and is refused if broken."""

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmdata import __version__
from swarmdata.errors import FormatVersionError, OutputError, SchemaError
from swarmdata.evaluation.results.result_files import Result, load_result, save_result
from swarmdata.evaluation.runs.provenance import Provenance, file_name
from swarmdata.specs.model_choice import with_models
from tests.support.measured import COOP_NAV, MEDIUM, foreign, result


def same(one: Result, other: Result) -> None:
    assert one.spec == other.spec
    assert one.provenance == other.provenance
    a, b = one.evaluation, other.evaluation
    assert (a.policy, a.task, a.spec_hash) == (b.policy, b.task, b.spec_hash)
    np.testing.assert_array_equal(a.seeds, b.seeds)
    assert a.seeds.dtype == b.seeds.dtype == np.uint64
    assert list(a.metrics) == list(b.metrics)
    for name in a.metrics:  # NaN equals NaN; everything else has the same bits
        np.testing.assert_array_equal(a.metrics[name], b.metrics[name])


@given(
    index=st.integers(0, 9),
    seed=st.none() | st.integers(0, 2**40),
    values=st.lists(st.floats(allow_nan=True, allow_infinity=False), min_size=3, max_size=3),
    view=st.none() | st.text(max_size=20),
)
def test_saved_and_loaded_bits_are_equal(
    tmp_path_factory: pytest.TempPathFactory,
    index: int,
    seed: int | None,
    values: list[float],
    view: str | None,
) -> None:
    made = result(index=index, n=3, seed=seed, view=view, frames=7)
    made.evaluation.metrics["return"][:] = values
    path = save_result(made, tmp_path_factory.mktemp("results"))
    same(load_result(path), made)
    assert load_result(path).path == path
    assert load_result(path).provenance.code_version == __version__


def test_the_name_is_unique_over_labels_datasets_views_specs_and_indices() -> None:
    lidar = with_models(COOP_NAV, "lidar")
    variants = [
        result(),
        result("vdn"),
        result(dataset=None),
        result(dataset="coop_nav-expert-v1"),
        result(view="{}"),
        result(view="{ }"),
        result(spec=lidar),
        result(index=1),
    ]
    names = {file_name(each.provenance, each.evaluation.spec_hash) for each in variants}
    assert len(names) == len(variants)
    assert f"bc--{MEDIUM}--{COOP_NAV.hash()[:8]}-0.json" in names
    assert f"bc--{COOP_NAV.hash()[:8]}-0.json" in names


def test_labels_stay_within_their_folder() -> None:
    for label in ("../bc", "a/b", "", ".bc", "a\nb", "a\x1b[31m", "b\u0441", "a" * 97, "con"):
        with pytest.raises(ValueError, match="label"):
            Provenance(label=label)
        with pytest.raises(ValueError, match="dataset"):
            Provenance(label="bc", dataset=label)


def test_what_json_cannot_hold_is_refused_and_the_old_file_stays(tmp_path: Path) -> None:
    path = save_result(result(), tmp_path)
    before, broken = path.read_bytes(), result()
    broken.evaluation.metrics["path_length"][0] = math.inf
    with pytest.raises(SchemaError, match="'bc' cannot be written as JSON"):
        save_result(broken, tmp_path, replace=True)
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == [path.name]


@pytest.mark.parametrize(
    ("metric", "value"), [("return", math.nan), ("success", 0.5), ("clean_success", 100.0)]
)
def test_values_that_a_metric_cannot_have_are_refused(
    metric: str, value: float, tmp_path: Path
) -> None:
    broken = result()
    broken.evaluation.metrics[metric][0] = value
    with pytest.raises(SchemaError, match=f"impossible values of {metric}"):
        save_result(broken, tmp_path)


def test_a_seed_counts_once(tmp_path: Path) -> None:
    made = result()
    seeds = np.full_like(made.evaluation.seeds, 7)
    with pytest.raises(SchemaError, match="impossible values of seeds"):
        save_result(replace(made, evaluation=replace(made.evaluation, seeds=seeds)), tmp_path)


def test_another_result_is_replaced_on_request_only(tmp_path: Path) -> None:
    path, other = save_result(result(), tmp_path), result()
    other.evaluation.metrics["return"][0] += 1
    before = path.read_bytes()
    assert save_result(result(), tmp_path) == path
    with pytest.raises(OutputError, match=r"another result of bc number 0.*index=k"):
        save_result(other, tmp_path)
    assert path.read_bytes() == before
    same(load_result(save_result(other, tmp_path, replace=True)), other)


def edited(path: Path, **changes: Any) -> Path:
    path.write_text(json.dumps({**json.loads(path.read_text()), **changes}))
    return path


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"note": "hello"}, "note: unknown key"),
        ({"metrics": {}}, r"missing .*'return'"),
        ({"seeds": []}, "has 0 seeds but"),
        ({"spec_hash": "0" * 64}, "was measured in spec 000000000000, but holds one with hash"),
        ({"provenance": {"label": "bc", "seed": -1}}, "seed: "),
    ],
)
def test_broken_files_are_refused(tmp_path: Path, changes: dict[str, Any], message: str) -> None:
    with pytest.raises(SchemaError, match=message):
        load_result(edited(save_result(result(), tmp_path), **changes))


def test_unreadable_files_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "r.json"
    with pytest.raises(FileNotFoundError):
        load_result(path)
    path.write_text('{"half": ')
    with pytest.raises(SchemaError, match="is not JSON"):
        load_result(path)
    path.write_text("[]")
    with pytest.raises(SchemaError, match="is not an evaluation result"):
        load_result(path)
    with pytest.raises(FormatVersionError, match="format 3, this swarmdata reads up to 2"):
        load_result(edited(save_result(result(), tmp_path / "later"), format_version=3))
    with pytest.raises(SchemaError, match=r"format_version.*Evaluate again"):
        load_result(edited(save_result(result(), tmp_path / "older"), format_version=1))


def test_results_of_other_environments_are_kept_as_well(tmp_path: Path) -> None:
    made = foreign(**{"return": [1.0, 2.0], "length": [3.0, 4.0], "success": [math.nan] * 2})
    same(load_result(save_result(made, tmp_path)), made)
    with pytest.raises(SchemaError, match=r"missing \['length'\]"):
        save_result(foreign(**{"return": [1.0, 2.0]}), tmp_path)


def test_a_result_and_its_provenance_have_one_label(tmp_path: Path) -> None:
    other = result().provenance.model_copy(update={"label": "ours"})
    torn = replace(result(), provenance=other)
    with pytest.raises(SchemaError, match="is of 'bc', its provenance of 'ours'"):
        save_result(torn, tmp_path)
