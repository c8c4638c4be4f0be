"""The page of two simulators: its numbers are those of the results."""

from pathlib import Path

from swarmdata.evaluation.transfer.simulator_transfer import plan_transfer, run_transfer
from swarmdata.evaluation.transfer.transfer_page import transfer_page


def test_the_page_says_what_was_measured(tmp_path: Path) -> None:
    names = ["idle", "random", "straight"]
    planned = plan_transfer(names, ["coop_nav"], tmp_path, backend="kinematic", n_episodes=3)
    teams = run_transfer(planned, progress=False)
    page = transfer_page(teams)
    assert "in Pymunk and in a world without contacts" in page
    assert " of 3 teams is clearly lower than in Pymunk" in page
    assert "Rank correlation of the policies' scores in Pymunk and a world without" in page
    assert (
        "swarmdata transfer idle random straight --task coop_nav --backend kinematic "
        "--episodes 3 --results FOLDER --out FILE" in page
    )
    row = next(line for line in page.splitlines() if line.startswith("| straight |"))
    cells = [cell.strip() for cell in row.strip("|").split("|")]
    known, new = teams[2].metric("obstacle_collisions")
    assert cells[-2:] == [f"{known.mean():.2f}", f"{new.mean():.2f}"] == [cells[-2], "0.00"]
    assert cells[1] == "1"
    idle = next(line for line in page.splitlines() if line.startswith("| idle |"))
    assert "+0.0 [0.0, 0.0]" in idle
