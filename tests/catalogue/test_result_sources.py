"""Results are read from studies and result files, and what is not a result is refused."""

import math
import re
from dataclasses import replace
from pathlib import Path

import pytest

from swarmdata.cards.committed_studies import read_studies
from swarmdata.catalogue import result_sources
from swarmdata.catalogue.boards import boards
from swarmdata.catalogue.build_catalogue import _compared
from swarmdata.catalogue.pages.results_page import results_page
from swarmdata.catalogue.result_sources import (
    Outcome,
    ResultSource,
    _of_results,
    committed_sources,
    own_sources,
    results_on,
    with_differences,
    with_keys,
)
from swarmdata.errors import DatasetNotFoundError, StudyError
from swarmdata.evaluation.results.result_files import Result, save_result
from swarmdata.evaluation.results.result_set import ResultSet, group_results
from swarmdata.learn.training.run_files import find_run, run_hash
from swarmdata.numerics.random import validation_seeds
from swarmdata.registry.presets import preset
from swarmdata.rollouts.score_intervals import difference_interval
from swarmdata.rollouts.score_statistics import Estimate
from swarmdata.runtime.batches import Failures
from swarmdata.specs.model_choice import with_models
from swarmdata.specs.origins import SideSpec
from tests.support.measured import COOP_NAV, EXPERT, MEDIUM, result

HEAD = "label,family,dataset,rewards,digest,seeds,updates,frames,episodes,quantity,mean,low,high\n"
ROW = "bc,cloning,coop_nav-medium-v1,,d1,5,4500,,1000,{},{},{},{}\n"


@pytest.fixture
def study(tmp_path: Path) -> Path:
    folder = tmp_path / "mine"
    folder.mkdir()
    rows = ROW.format("score", 50, 45, 55) + ROW.format("success", 0.5, 0.4, 0.6)
    (folder / "estimates.csv").write_text(HEAD + rows + ROW.format("time_to_goal", "", "", ""))
    (folder / "study.yaml").write_text("title: My <study>\nblock: evaluation\n")
    (folder / "data.csv").write_text("dataset,score\ncoop_nav-medium-v1,57.5\n")
    (folder / "curves.csv").write_text(
        "cell,metric,update,mean,low,high\n"
        "bc/coop_nav-medium,success,500,0.2,0.1,0.3\nbc/coop_nav-medium,success,1000,0.4,0.3,0.5\n"
    )
    (folder / "sweeps").mkdir()
    (folder / "sweeps" / "sweep.csv").write_text(
        "part,parameter,value,as_trained,policy,runs,episodes,metric,estimate,low,high\n"
        "communication,drop,0.5,0,bc,5,200,score,40,30,50\n"
        "communication,drop,0.0,1,bc,5,200,score,60,50,70\n"
    )
    return folder


def page_of(sources: list[ResultSource], known: frozenset[str]) -> str:
    return results_page(boards(sources), sources, known).body


def test_a_study_has_outcomes_curves_and_sweeps(study: Path) -> None:
    (found,) = own_sources([study], Failures(1))

    (outcome,) = found.outcomes
    assert (outcome.label, outcome.n_runs, outcome.dataset) == ("bc", 5, "coop_nav-medium-v1")
    assert tuple(outcome.estimates["score"]) == (50, 45, 55)
    assert math.isnan(outcome.estimates["time_to_goal"].value)
    assert found.data == {"coop_nav-medium-v1": 57.5}
    curve, sweep = found.charts
    assert [each.value for each in curve.lines["bc"].values()] == [20, 40]
    assert list(sweep.lines["bc"]) == [0.0, 0.5]


def test_the_page_shows_and_links_them(study: Path) -> None:
    sources = own_sources([study], Failures(1))
    text = page_of(sources, frozenset({"coop_nav-medium-v1"}))

    assert 'href="datasets/coop_nav-medium-v1.html"' in text
    assert "50.0 [45.0, 55.0]" in text
    assert "My &lt;study&gt;" in text
    assert "<study>" not in text
    assert text.count('class="chart"') == 2
    assert text.count("line series-0 dashed-0") == 2  # of cloning
    assert "datasets/" not in page_of(sources, frozenset()), "none has a page"
    assert "swarmdata catalogue build --results FOLDER" in page_of([], frozenset())


def test_studies_on_validation_seeds_are_no_committed_results(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def of_study(study: object, folder: Path, place: str, shown: object) -> ResultSource:
        return ResultSource("", place, (), {})

    monkeypatch.setattr(result_sources, "_of_study", of_study)  # which reads archives for long
    places = {found.place for found in committed_sources()}

    assert "cards/studies/goals" in places
    assert "cards/studies/validation" not in places


def test_archives_are_read_only_for_datasets_that_are_shown(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    read: list[str] = []

    def results_of(folder: Path) -> dict[tuple[str, str], tuple[Result, ...]]:
        read.append(folder.name)
        return {}

    monkeypatch.setattr(result_sources, "_results_of_study", results_of)

    found = committed_sources({"search-expert-v1"})

    assert read == ["hearing"]
    assert len(found) > len(read)


def test_a_study_whose_episodes_are_not_installed_is_named(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    for name, archive in (("whole", "cells.tar.xz"), ("without", "other")):
        (tmp_path / name).mkdir()
        (tmp_path / name / "estimates.csv").write_text(HEAD + ROW.format("score", 50, 45, 55))
        (tmp_path / name / "study.yaml").write_text("block: evaluation\n")
        (tmp_path / name / archive).touch()
    assert result_sources.studies_without_episodes() == [], "of a clone"
    monkeypatch.setattr(result_sources, "committed_studies", lambda: read_studies(tmp_path))

    assert result_sources.studies_without_episodes() == ["without"]


def test_an_own_study_on_validation_seeds_says_so(study: Path) -> None:
    (study / "study.yaml").write_text("title: Mine\nblock: validation\n")

    assert own_sources([study], Failures(1))[0].title == "Mine (validation seeds)"


def test_result_files_of_ones_own_are_shown_with_their_runs(tmp_path: Path) -> None:
    for index in (0, 1):
        made = result(index=index, run=str(tmp_path / "runs" / "bc"), updates=3000, algorithm="bc")
        save_result(made, tmp_path / "results")

    (found,) = own_sources([tmp_path / "results"], Failures(1))

    (outcome,) = found.outcomes
    assert (outcome.label, outcome.dataset, outcome.n_runs) == ("bc", MEDIUM, 2)
    assert outcome.updates == "3000"
    assert outcome.runs == ("bc",)
    assert outcome.family == "cloning"
    assert found.is_own
    estimate = outcome.estimates["return"]
    assert estimate.low < estimate.value < estimate.high
    assert found.data[MEDIUM] > 0
    page = page_of([found], frozenset({MEDIUM}))
    assert "results (yours)" in page
    assert "runs bc" in page
    assert str(tmp_path) not in page


def test_results_of_another_task_or_other_opponents_have_a_board_of_their_own(
    tmp_path: Path,
) -> None:
    strict, noisy = preset("coop_nav-strict"), with_models(COOP_NAV, "noise-0.1")
    for spec in (COOP_NAV, strict, noisy):
        save_result(result(spec=spec), tmp_path / "results" / spec.hash())
    places = [tmp_path / "results" / each.hash() for each in (COOP_NAV, strict, noisy)]

    found = own_sources(places, Failures(3))

    assert [each.outcomes[0].dataset for each in found] == [
        MEDIUM, f"{MEDIUM}@coop_nav-strict", f"{MEDIUM}@coop_nav-{noisy.hash()[:8]}",
    ]  # fmt: skip
    assert [sorted(each.data) for each in found[:2]] == [[MEDIUM], []]
    (case,) = group_results([result()]).cases
    sides = [SideSpec(whole=preset("tag"), side="evader", opponents=each) for each in ("a", "b")]
    cases = tuple(replace(case, dataset="tag-v0@evader", spec=each) for each in sides)
    boards = {each.dataset for each in _of_results(ResultSet(cases, ()), "mine").outcomes}
    assert boards == {"tag-v0@evader-vs-a", "tag-v0@evader-vs-b"}


def test_own_results_say_their_seeds_and_other_rewards(tmp_path: Path) -> None:
    view = '{"rewards":{"time":0.5}}'
    for index in (0, 1):
        made = result(index=index, run=str(tmp_path / "runs" / "bc"), algorithm="bc", view=view)
        made.evaluation.seeds[:] = validation_seeds(len(made.evaluation.seeds))
        save_result(made, tmp_path / "results")

    (found,) = own_sources([tmp_path / "results"], Failures(1))

    assert found.title == "results (validation seeds)"
    assert "results (yours) (validation seeds)" in page_of([found], frozenset())
    assert found.outcomes[0].rewards == '{"time": 0.5}'


def test_results_beside_a_mini_have_no_pages(tmp_path: Path) -> None:
    save_result(result(algorithm="bc"), tmp_path / "results")
    sources = own_sources([tmp_path / "results"], Failures(1))

    (shown,) = results_on(sources, {MEDIUM})
    (beside,) = results_on(sources, {"coop_nav-medium-mini-v1"}, {MEDIUM})

    assert with_keys([shown])[0].outcomes[0].key
    assert not with_keys([beside])[0].outcomes[0].key
    assert beside.outcomes[0].estimates == shown.outcomes[0].estimates
    assert results_on(sources, {"other-v1"}) == []


def test_absent_results_are_one_sentence(tmp_path: Path) -> None:
    with pytest.raises(DatasetNotFoundError, match=r"no results at .*absent.*swarmdata evaluate"):
        own_sources([tmp_path / "absent"], Failures(1))


@pytest.mark.parametrize(
    ("text", "message"),
    [("a,b\n1,2\n", "no column .*label"), (HEAD + ROW.format("score", "x", 1, 2), "no estimate")],
)
def test_broken_estimates_are_refused(study: Path, text: str, message: str) -> None:
    (study / "estimates.csv").write_text(text)

    with pytest.raises(StudyError, match=message):
        own_sources([study], Failures(1))


def test_entries_are_compared_with_the_best_run_of_the_zoo() -> None:
    """Paired by episode, with runs whose policies are those of the zoo, and with no others."""

    def outcome(label: str, dataset: str, mean: float, content: str | None = None) -> Outcome:
        runs = tuple(
            result(label, dataset, k, mean=mean + 0.1 * k, content=content) for k in range(3)
        )
        return Outcome(label, "cloning", dataset, {}, 3, "", "", (), runs)

    def zoo_content(run: str) -> str:
        folder = find_run(f"zoo:{run}")
        assert folder is not None
        return run_hash(folder, 0)

    studies = [
        source_of(
            outcome("bc", EXPERT, 3.0, zoo_content("bc/coop_nav-expert")),
            outcome("iql", EXPERT, 2.0, zoo_content("iql/coop_nav-expert")),
        ),
        source_of(outcome("maddpg_bc", EXPERT, 9.0, "0" * 64), outcome("bc", MEDIUM, 9.0)),
    ]
    mine, elsewhere = outcome("mine", EXPERT, 4.0), outcome("mine", MEDIUM, 4.0)
    (source,) = with_differences([source_of(mine, elsewhere)], studies)
    compared, alone = source.outcomes
    assert alone.difference is None
    assert compared.difference is not None
    assert compared.difference.run == "zoo:bc/coop_nav-expert"
    case = group_results([*mine.results, *studies[0].outcomes[0].results]).cases[0]
    expected = difference_interval(case.scores("mine"), case.scores("bc"))
    assert compared.difference.score == expected
    measured = Estimate(70.0, 69.0, 71.0)
    old, new = (
        replace(
            source,
            outcomes=(replace(compared, label=label, estimates={"score": measured}),),
            is_verified=True,
            submitted=day,
        )
        for label, day in (("old", "2026-11-30"), ("new", "2026-12-01"))
    )
    page = page_of([new, old], frozenset())
    lines = re.findall(r"<p class=\"note\">(2026-\S+) <strong>(\w+)</strong>: (.+?)</p>", page)
    assert [line[:2] for line in lines] == [("2026-11-30", "old"), ("2026-12-01", "new")]
    assert lines[0][2] == (
        f"score 70.0 [69.0, 71.0], +{expected.value:.1f} [{expected.low:.1f}, {expected.high:.1f}]"
        " relative to zoo:bc/coop_nav-expert, paired by episode."
    )


def source_of(*outcomes: Outcome) -> ResultSource:
    return ResultSource("Some", "some", outcomes, {})


def test_studies_are_beside_own_results_on_datasets_without_a_page() -> None:
    name = "search-expert-v1"
    own = results_on(committed_sources({name}), {name})
    committed, _ = _compared([], own, [], all_committed=False)
    assert {each.dataset for source in committed for each in source.outcomes} == {name}
    assert _compared([], [], [], all_committed=False) == ([], [])
