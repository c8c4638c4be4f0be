"""Which algorithm for which data: many datasets are a matrix, with the data's own mean."""

import math
from collections.abc import Callable
from pathlib import Path

import pytest

pytest.importorskip("torch", reason="a study needs the torch extra")

from swarmdata.evaluation.study.answers import data_regimes
from swarmdata.evaluation.study.answers.evidence import open_evidence
from swarmdata.evaluation.study.plan import Study
from swarmdata.evaluation.study.run_study import StudyOptions, run_study
from tests.evaluation.study.conftest import BC


@pytest.mark.usefixtures("here", "empty_figures")
def test_many_datasets_are_a_matrix_without_ablations(
    make_study: Callable[..., Study],
    data: Path,
    other_data: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    rows = {
        "bc": {**BC, "family": "cloning"},
        "late": {**BC, "family": "late", "updates": 5, "datasets": [str(data)]},
        "bc-without": {**BC, "family": "ablations", "updates": 1},
    }
    study = make_study(algorithms=rows, datasets=[str(data), str(other_data)])
    options = StudyOptions(tmp_path / "studies/tiny", tmp_path / "work", progress=False)
    run_study(study, options, "x")
    drawn = []
    monkeypatch.setattr(data_regimes, "MOST_PANELS", 1)
    monkeypatch.setattr(
        data_regimes, "plot_score_matrix", lambda values, *_, **__: drawn.append(values)
    )
    with open_evidence(tmp_path / "studies") as (evidence, _):
        answer = data_regimes.answer_data_regimes(evidence, tmp_path)
    assert answer is not None
    (values,) = drawn
    assert [list(row) for row in values.values()] == [["mean of the data", "bc", "late"]] * 2
    empty = [[name for name, value in row.items() if math.isnan(value)] for row in values.values()]
    assert sorted(empty) == [[], ["late"]]
    assert "`bc-without`" in answer.details
    assert "ablations has" not in " ".join(answer.sentences).lower()
