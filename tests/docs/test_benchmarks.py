"""The ratios of docs/benchmarks.md are those of the measured tables."""

import csv
import re
from pathlib import Path

DOCS = Path(__file__).parents[2] / "docs"
TEXT = " ".join((DOCS / "benchmarks.md").read_text("utf-8").split())


def rows(table: str) -> list[dict[str, str]]:
    text = (DOCS / f"measurements/{table}.csv").read_text("utf-8")
    return list(csv.DictReader(text.splitlines()))


def first(cell: str) -> float:
    return float(cell.partition(" ")[0])


def shown(value: float) -> str:
    return f"{value:.2f}" if value < 1 else f"{value:.1f}"


def test_steps_beside_vmas() -> None:
    early = {row["robots"]: row for row in rows("low-dimensional-observations")}
    late = {row["work"]: first(row["ours / it"]) for row in rows("near-the-limit")}
    table = re.findall(r"\| (\d+) \| (random|expert|scripted) \| ([\d.]+) to ([\d.]+) \|", TEXT)
    for robots, actions, low, high in table:
        column = "64 copies" if actions == "random" else f"64 copies, {actions} actions"
        ratios = (
            float(early[robots][f"{column} / VMAS"]),
            late[f"steps, {robots} robots, 64 copies, {actions} actions"],
        )
        assert (low, high) == tuple(shown(each) for each in sorted(ratios)), (robots, actions)
    assert len(table) == 6


def test_steps_with_a_lidar() -> None:
    ratios = [float(row["64 copies / VMAS"]) for row in rows("lidar-of-rays")]
    said = " / ".join(f"{each:.1f}" if each < 10 else f"{each:.0f}" for each in ratios)
    assert f"ours is {said} times as fast" in TEXT


def test_loading() -> None:
    found = {row["format"]: row for row in rows("loading")}
    names = ("npz", "HDF5, gzip, as D4RL", "Vault of OG-MARL", "Minari, HDF5")
    said = " / ".join(f"{float(found[name]['ratio']):.0f}" for name in names)
    assert f"| {said} times |" in TEXT
    ours = {how: float(found[f"swarmdata, verify='{how}'"]["core s"]) for how in ("fast", "none")}
    assert f"every chunk checked: {ours['fast']:.2f} s" in TEXT
    assert f'`verify="none"` takes {ours["none"]:.3f} s' in TEXT


def test_stacked_seeds() -> None:
    stacked = [row for row in rows("offline-training") if row["run"] == "ours, 5 seeds stacked"]
    for algorithm in ("bc", "maddpg_bc"):
        ratios = [first(r["/ plain loop"]) for r in stacked if r["algorithm"] == f"`{algorithm}`"]
        row = re.search(rf"\| `{algorithm}`, 5 seeds stacked, [^|]+\|[^|]+\| ([\d./ ]+) \|", TEXT)
        assert row
        assert row[1] == " / ".join(map(shown, ratios))


def test_the_limit() -> None:
    late = [(row["work"], first(row["ours / limit"])) for row in rows("near-the-limit")]
    copies = [(work, share) for work, share in late if "64 copies" in work]
    groups = (
        [share for work, share in copies if "random" in work],
        [share for work, share in copies if "random" not in work],
        [share for work, share in late if not work.startswith("steps")],
    )
    spans = [f"{min(group):.2f} to {max(group):.2f}" for group in groups]
    assert f"reaches {spans[0]} of that rate with random actions, and {spans[1]} with" in TEXT
    assert f"ours reaches {spans[2]}" in TEXT
