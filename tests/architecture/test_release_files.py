"""What is published with the package agrees with it; what has to be filled in first is known."""

import json
import os
import re
import shlex
import subprocess
import tomllib
from importlib.util import find_spec
from pathlib import Path
from shutil import copy, rmtree

import pytest
import yaml

import swarmdata
from tests.support.package_sources import ROOT

PLACEHOLDERS = {
    ".ci/conda/recipe.yaml", ".zenodo.json", "CITATION.cff", "codemeta.json", "pyproject.toml",
    "README.md", "docs/citing.md",
    *(f"docs/tutorials/{path.name}" for path in (ROOT / "docs/tutorials").glob("*.ipynb")),
}  # fmt: skip
"""Files that name the repository's owner or the archive's checksum, which nobody knows yet."""

CONDA_NAMES = {"huggingface-hub": "huggingface_hub", "xxhash": "python-xxhash"}

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
WORKFLOWS = sorted((ROOT / ".github/workflows").glob("*.yml"))
FORMS = sorted((ROOT / ".github/ISSUE_TEMPLATE").glob("*.yml"))


def loaded(name: str) -> dict[str, object]:
    text = (ROOT / name).read_text(encoding="utf-8")
    found = json.loads(text) if name.endswith(".json") else yaml.safe_load(text)
    assert isinstance(found, dict)
    return found


def test_placeholders_are_where_the_list_says() -> None:
    pattern = re.compile(r"\bOWNER\b|SHA256-OF-THE-SOURCE")
    tracked = subprocess.run(
        ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"],
        cwd=ROOT, capture_output=True, check=True, text=True,
    ).stdout.split("\0")  # fmt: skip
    kinds = (".json", ".toml", ".yaml", ".yml", ".cff", ".md", ".ipynb")
    found = {
        name for name in tracked
        if name.endswith(kinds) and (ROOT / name).stat().st_size < 200_000
        and pattern.search((ROOT / name).read_text(encoding="utf-8"))
    }  # fmt: skip
    assert found - {"CONTRIBUTING.md"} == PLACEHOLDERS


@pytest.mark.parametrize("name", ["CITATION.cff", ".zenodo.json", "codemeta.json"])
def test_the_version_and_license_are_those_of_the_package(name: str) -> None:
    found = loaded(name)
    assert found["version"] == PROJECT["version"] == swarmdata.__version__
    assert str(found["license"]).rpartition("/")[2] == PROJECT["license"]
    assert name != "CITATION.cff" or found["authors"] == PROJECT["authors"]


def test_the_conda_recipe_requires_what_the_package_does() -> None:
    recipe = loaded(".ci/conda/recipe.yaml")
    assert recipe["context"] == {"version": PROJECT["version"]}
    expected = {f"python {PROJECT['requires-python']}"}
    for each in PROJECT["dependencies"]:
        name, bounds = re.fullmatch(r"([\w-]+)(.*)", each).groups()  # type: ignore[union-attr]
        expected.add(f"{CONDA_NAMES.get(name, name)} {bounds}")
    assert set(recipe["requirements"]["run"]) == expected  # type: ignore[index]


@pytest.mark.parametrize("path", WORKFLOWS, ids=lambda path: path.stem)
def test_workflows_run_what_is_there(path: Path) -> None:
    jobs = yaml.safe_load(path.read_text(encoding="utf-8"))["jobs"]
    targets = set(re.findall(r"^([\w-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE))
    commands = [
        shlex.split(step["run"]) for job in jobs.values() for step in job["steps"] if "run" in step
    ]
    for words in commands:
        assert (words[0] == "make" and words[1] in targets) or (ROOT / words[1]).exists(), words
    for step in (step for job in jobs.values() for step in job["steps"] if "uses" in step):
        assert re.fullmatch(r"[\w-]+/[\w-]+@[\w/.]+", step["uses"])


@pytest.mark.parametrize("name", ["Makefile", "Dockerfile", ".ci/verify_entries"])
def test_the_modules_that_it_runs_are_there(name: str) -> None:
    text = (ROOT / name).read_text(encoding="utf-8")
    modules = re.findall(r"-m ((?:swarmdata|tests|docs)(?:\.\w+)*)", text)
    assert modules
    assert [module for module in modules if find_spec(module) is None] == []


@pytest.mark.parametrize("path", FORMS, ids=lambda path: path.stem)
def test_forms_ask_something(path: Path) -> None:
    form = yaml.safe_load(path.read_text(encoding="utf-8"))
    names = [field["id"] for field in form["body"]]
    assert {"name", "description", "body"} <= form.keys()
    assert len(set(names)) == len(names) > 0
    assert any(field.get("validations", {}).get("required") for field in form["body"])


def test_the_index_shows_the_readme_with_links_that_work_there() -> None:
    pytest.importorskip("hatch_fancy_pypi_readme", reason="builds the wheel; the group 'test'")
    from hatchling.builders.wheel import WheelBuilder

    text = WheelBuilder(str(ROOT)).metadata.core.readme
    assert not re.findall(r"\]\((?!https?:|#)|src=\"(?!https?:)", text)
    assert "github.com/OWNER/swarmdata/blob/main/docs/" in text


def test_the_entries_of_a_pull_request_are_verified(tmp_path: Path) -> None:
    """Those that it changes, also where it only removes a file; all of them, after one fails."""
    repository, programs = tmp_path / "repository", tmp_path / "programs"
    for name in ("kept", "with space", "bad", "shrunk", "removed"):
        (repository / "entries" / name).mkdir(parents=True)
        for file in ("entry.json", "policy-0.onnx"):
            (repository / "entries" / name / file).write_text(name)
    (repository / ".ci").mkdir()
    copy(ROOT / ".ci/verify_entries", repository / ".ci")

    def git(*words: str) -> None:
        who = ("-c", "user.name=a", "-c", "user.email=a@example.org")
        subprocess.run(["git", *who, *words], cwd=repository, check=True, capture_output=True)

    git("init", "--initial-branch=main")
    git("add", ".")
    git("commit", "--message=before")
    for name in ("with space", "bad"):
        (repository / "entries" / name / "entry.json").write_text("changed")
    (repository / "entries/shrunk/policy-0.onnx").unlink()
    rmtree(repository / "entries/removed")
    (repository / "entries/README.md").write_text("no entry")
    git("add", "--all")
    git("commit", "--message=after")
    programs.mkdir()
    python = programs / "python3"
    python.write_text('#!/bin/sh\necho "$@" >>"$LOG"\ncase "$*" in *bad*) exit 1;; esac\n')
    python.chmod(0o755)
    log = tmp_path / "log"
    environment = {**os.environ, "PATH": f"{programs}:{os.environ['PATH']}", "LOG": str(log)}

    def verified(base: str) -> int:
        command = ["bash", ".ci/verify_entries", base]
        return subprocess.run(command, cwd=repository, env=environment, check=False).returncode

    assert verified("HEAD~1") == 1
    *installed, bad, shrunk, space = log.read_text().splitlines()
    assert installed[-1].endswith(".[torch,onnx]")
    assert bad.startswith("-m swarmdata leaderboard verify --threads ")
    assert [each.partition("entries/")[2] for each in (bad, shrunk, space)] == [
        "bad", "shrunk", "with space"
    ]  # fmt: skip
    git("checkout", "HEAD~1", "entries/bad")
    git("commit", "--message=without bad")
    assert verified("HEAD~2") == 0
    assert verified("no-such-branch") != 0
