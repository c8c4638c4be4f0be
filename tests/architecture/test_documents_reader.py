"""Whatever reads YAML does so through one reader, which has bounds."""

import re
from pathlib import Path

ROOT = Path(__file__).parents[2]


def test_only_one_module_parses_yaml() -> None:
    folders = ("swarmdata", "envs", "behavior_policies", "offline_algos", "online_algos", "cards")
    functions = r"(safe_|full_|unsafe_)?(load|parse|compose)(_all)?"
    parsing = re.compile(rf"yaml\.{functions}\(|yaml\.\w*Loader")
    found = {
        path.relative_to(ROOT).as_posix()
        for folder in folders
        for path in (ROOT / folder).rglob("*.py")
        if parsing.search(path.read_text(encoding="utf-8"))
    }
    assert found == {"swarmdata/runtime/yaml_documents.py"}
