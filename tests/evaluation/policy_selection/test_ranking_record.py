"""A ranking as tables and as a file."""

from pathlib import Path
from typing import Any

import pytest

from swarmdata.errors import SpecError
from swarmdata.evaluation.policy_selection.ranking_record import (
    CRITERIA,
    RANKING,
    CriterionQuality,
    RankedPolicy,
    Ranking,
)
from tests.support.measured import csv_rows


def policy(**changes: Any) -> RankedPolicy:
    values: dict[str, Any] = {
        "run": "bc",
        "run_hash": "0" * 64,
        "algorithm": "bc",
        "seed": 0,
        "update": 100,
        "fqe": (1.5, 1.0, 2.0),
        "fqe_pessimistic": 0.75,
        "fqe_curve": (0.5, 1.5),
        "fqe_residual": 0.1,
        "fqe_clipped": 0.0,
        "imitation_error": 0.01234,
        "weighted_imitation_error": 0.02,
        "td_error": None,
    }
    return RankedPolicy(**{**values, **changes})


def ranking(*policies: RankedPolicy, **changes: Any) -> Ranking:
    values: dict[str, Any] = {
        "code_version": "0",
        "dataset": "coop_nav-medium-v1",
        "digest": "ab" * 32,
        "view": None,
        "by": "fqe",
        "n_validation_episodes": 18,
        "n_updates": 3000,
        "batch_size": 256,
        "hidden": (128, 128),
        "n_fits": 1,
        "discount": 0.99,
        "bound": (-10.0, 5.0),
        "data_value": 1.25,
        "policies": policies or (policy(),),
    }
    return Ranking(**{**values, **changes})


def scored() -> Ranking:
    quality = CriterionQuality(n_policies=2, spearman=(1.0, 0.5, 1.0), regret={1: 0.0})
    return ranking(
        policy(score=50.0),
        policy(run="maddpg_bc", seed=3, td_error=0.25, score=41.2),
        score_unit="score",
        n_score_episodes=200,
        quality={"fqe": quality, "imitation_error": quality},
    )


def test_a_row_says_who_and_every_criterion() -> None:
    lines = scored().to_text().splitlines()
    head, first, second = lines[0], lines[2], lines[3]
    assert all(label in head for label, _ in CRITERIA.values())
    assert first.split()[:4] == ["bc/seed-0@100", "1.500", "[1.000,", "2.000]"]
    assert first.split()[4:] == ["0.7500", "0.0123", "0.0200", "–", "50.0"]
    assert second.split()[0] == "maddpg_bc/seed-3@100"
    assert second.split()[-2:] == ["0.2500", "41.2"]


def test_csv_has_every_value_at_full_precision() -> None:
    rows = csv_rows(scored().to_csv())
    assert [row["rank"] for row in rows] == ["1", "2"]
    assert float(rows[0]["imitation_error"]) == 0.01234
    assert (rows[0]["fqe_low"], rows[0]["td_error"]) == ("1.0", "")
    assert (rows[1]["run"], rows[1]["seed"], rows[1]["score"]) == ("maddpg_bc", "3", "41.2")


def test_a_file_is_read_back(tmp_path: Path) -> None:
    made = scored()
    made.write(tmp_path / "new" / "folder")
    files = sorted(path.name for path in (tmp_path / "new" / "folder").iterdir())
    assert files == [RANKING.list_file, "ranking.csv", "ranking.json", "ranking.md"]
    assert Ranking.from_file(tmp_path / "new" / "folder" / "ranking.json") == made


def test_another_format_is_an_error() -> None:
    with pytest.raises(SpecError, match="format_version"):
        Ranking.parse({**scored().model_dump(mode="json"), "format_version": 1})
