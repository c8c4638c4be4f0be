"""A report holds every table and figure that the results allow."""

import json
from pathlib import Path

import pytest

from swarmdata.errors import SchemaError
from swarmdata.evaluation.results import report
from swarmdata.evaluation.results.report import REPORT, shown_cases, tables_of, write_report
from swarmdata.evaluation.results.result_files import save_result
from swarmdata.evaluation.results.result_set import group_results
from tests.support.measured import EXPERT, MEANS, MEDIUM, foreign, grid, result


@pytest.mark.slow
@pytest.mark.usefixtures("empty_figures")
def test_a_report_of_several_datasets(tmp_path: Path) -> None:
    folder, out = tmp_path / "results", tmp_path / "out"
    for each in [*grid(MEANS, 2), *grid({"iql": {MEDIUM: 0.0}}, 2), result("idle", None)]:
        save_result(each, folder)
    text = write_report([folder], out)
    tables = ("scores", "aggregates", "differences", MEDIUM, EXPERT)
    figures = ("scores", "profile", "pareto", MEDIUM, EXPERT)  # two labels have no matrix
    files = {f"{name}{ending}" for name in tables for ending in (".md", ".csv", ".tex")}
    files |= {f"{name}{ending}" for name in figures for ending in (".png", ".pdf")}
    files |= {"report.md", "runs.csv", "marl-eval.json"}
    assert {path.name for path in out.iterdir()} == files | {REPORT.list_file}
    assert [line for line in text.splitlines() if line in tables] == list(tables)
    page = (out / "report.md").read_text()
    for name in figures:
        assert f"![{name}]({name}.png)" in page
    assert "Not in marl-eval.json: iql." in page
    assert "coop_nav" in json.loads((out / "marl-eval.json").read_text())


def test_one_case_is_the_table() -> None:
    assert list(shown_cases(group_results([result("idle", None)]))) == ["table"]
    assert list(tables_of(group_results([result("idle", None)]))) == ["table"]
    one = tables_of(group_results(grid({"bc": {MEDIUM: 1.0}}, 2)))
    assert list(one) == ["scores", "aggregates", "table"]  # nobody to beat
    whole = shown_cases(group_results([result(), result("idle", None)]))
    assert list(whole["table"].runs) == ["idle", "bc"]


def test_results_of_other_environments_have_a_table_and_no_scores(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib", reason="the report has pictures")
    save_result(foreign(**{"return": [1.0, 2.0], "length": [3.0, 5.0]}), tmp_path / "results")
    write_report([tmp_path / "results"], tmp_path / "out", suffix=".svg")
    write_report([tmp_path / "results"], tmp_path / "out", suffix=".png")
    assert not [*tmp_path.glob("out/*.svg")], "of the earlier report"
    names = {path.stem for path in (tmp_path / "out").iterdir()}
    assert names - {".swarmdata-files"} == {"table", "report", "runs", "marl-eval"}


@pytest.mark.usefixtures("empty_figures")
def test_runs_whose_folders_have_one_name_have_a_curve_each(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    save_result(result(), tmp_path / "results")
    runs, drawn = [tmp_path / dataset / "bc" for dataset in ("a", "b")], list[str]()
    for run in runs:
        run.mkdir(parents=True)
        (run / "config.json").touch()
        (run / "curve.csv").write_text("update,seed,success\n10,0,0.5\n20,0,0.5\n")
    monkeypatch.setattr(report, "plot_curves", lambda curves, *_, **__: drawn.extend(curves))
    write_report([tmp_path / "results"], tmp_path / "out", runs=runs)
    assert drawn == list(map(str, runs))


def test_unknown_pictures_are_refused(tmp_path: Path) -> None:
    save_result(result(), tmp_path / "results")
    with pytest.raises(SchemaError, match=r"figures as '\.gif'"):
        write_report([tmp_path / "results"], tmp_path / "out", suffix=".gif")
    assert not (tmp_path / "out").exists()
