"""What a tuning chooses, and what k trials can be expected to find."""

from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swarmdata.evaluation.tuning.tuning_record import Trial, Tuning, expected_scores
from swarmdata.types import Double


def by_enumeration(criterion: Double, scores: Double) -> list[float]:
    """The mean over all sets of k trials that contain trial 0."""
    n = len(scores)
    means = []
    for k in range(1, n + 1):
        ends = []
        for others in combinations(range(1, n), k - 1):
            tried = sorted((0, *others))
            ends.append(scores[tried[int(np.argmax(criterion[tried]))]])
        means.append(float(np.mean(ends)))
    return means


@pytest.mark.parametrize("seed", range(5))
def test_the_expected_score_is_the_mean_over_all_sets_of_trials(seed: int) -> None:
    rng = np.random.default_rng(seed)
    scores, criterion = rng.normal(size=6), rng.integers(0, 4, 6).astype(float)  # with ties
    np.testing.assert_allclose(
        expected_scores(criterion, scores), by_enumeration(criterion, scores), atol=1e-12
    )
    best = expected_scores(scores, scores)
    assert (np.diff(best) >= 0).all()
    assert best[-1] == pytest.approx(scores.max())


def trial(score: float | None, fqe: float, other: float = 0.0) -> Trial:
    if score is None:
        return Trial(settings={}, config={}, scores={}, estimates={}, failure="it diverged")
    estimates = {
        name: {"fqe_pessimistic": value, "imitation_error": 0.1, "weighted_imitation_error": 0.2}
        for name, value in (("a", fqe), ("b", other))
    }
    return Trial(settings={}, config={}, scores={"a": score, "b": score + 2}, estimates=estimates)


def tuning(*trials: Trial, **changes: Any) -> Tuning:
    content: dict[str, Any] = {
        "code_version": "0", "algorithm": "bc", "datasets": {"a": "0" * 64, "b": "1" * 64},
        "n_updates": 10, "seeds": (0, 1), "n_episodes": 4, "unit": "score", "trials": trials,
    }  # fmt: skip
    return Tuning(**{**content, **changes})


def test_rules_choose_by_scores_and_by_ranks_over_datasets() -> None:
    made = tuning(trial(5.0, 1.0, 2.0), trial(9.0, 0.0, 1.0), trial(1.0, 9.0, 0.0), trial(None, 0))
    assert made.scores.tolist() == [6.0, 10.0, 2.0, -np.inf]
    assert made.choice("validation") == 1
    assert made.criterion("offline").tolist() == [2.5, 1.5, 2.0, -np.inf]  # not the largest value
    assert made.choice("offline") == 0
    assert made.curve("offline")[-1] == 6.0


@pytest.mark.usefixtures("empty_figures")
def test_a_choice_of_an_earlier_tuning_does_not_stay(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib", reason="a tuning has a figure")
    tuning(trial(5.0, 1.0), trial(9.0, 0.0)).write(tmp_path)
    tuning(trial(5.0, 1.0), trial(9.0, 0.0), n_episodes=0).write(tmp_path)
    kept = {path.name for path in tmp_path.iterdir() if not path.name.startswith(".")}
    assert kept == {"tuning.json", "tuning.md", "trials.csv", "offline.yaml"}


def test_the_table_has_a_row_for_each_trial() -> None:
    made = tuning(trial(5.0, 1.0), trial(None, 0.0))
    head, first, second = made.to_csv().splitlines()
    assert head.startswith("trial,score,score:a,score:b,fqe_pessimistic:a")
    assert first.split(",")[1:4] == ["6.0", "5.0", "7.0"]
    assert second.split(",")[1:4] == ["", "", ""]
    assert second.endswith("it diverged")
