"""Ranking, what is known of trained policies without a simulator, as a file and as tables."""

import csv
import io
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from swarmdata.drawing import markdown
from swarmdata.drawing.aligned_text import aligned_table
from swarmdata.runtime.atomic import write_file
from swarmdata.specs.frozen import Frozen

Criterion = Literal["fqe", "imitation_error", "weighted_imitation_error", "td_error"]

CRITERIA: dict[Criterion, tuple[str, bool]] = {
    "fqe": ("FQE value", True),
    "imitation_error": ("imitation error", False),
    "weighted_imitation_error": ("weighted imitation error", False),
    "td_error": ("TD error", False),
}
"""Label of each criterion, and whether more of it is better."""

Interval = tuple[float, float, float]  # a value and the ends of its 95 % interval
Count = Annotated[int, Field(ge=1)]


class RankedPolicy(Frozen):
    """One policy: where it comes from, and every criterion that it has."""

    run: str  # name of the run's folder
    run_hash: str  # of the run's `config.json`
    algorithm: str
    seed: int
    update: int
    fqe: Interval  # discounted team return; the interval is over initial states
    fqe_curve: tuple[float, ...]  # the value on the way; one that still moves has not settled
    fqe_residual: float  # root mean square of Q - y on the validation split
    fqe_clipped: float  # share of the last targets that the bound cut
    imitation_error: float
    weighted_imitation_error: float
    td_error: float | None  # None: the algorithm has no critics of the kind
    score: float | None = None  # in a simulator, where it was measured

    @property
    def label(self) -> str:
        """Run, seed and update."""
        return f"{self.run}/seed-{self.seed}@{self.update}"


class CriterionQuality(Frozen):
    """How well one criterion ranked the policies that have it and a score: `ranking.Quality`."""

    n_policies: Count
    spearman: Interval
    regret: dict[int, float]


class Ranking(Frozen):
    """Policies trained on one dataset, the best by `by` first."""

    format: Literal["swarmdata-ranking"] = "swarmdata-ranking"
    format_version: Literal[1] = 1
    code_version: str
    dataset: str
    digest: str
    view: str | None
    by: Criterion
    n_validation_episodes: Count
    n_updates: Count  # of the fitted Q evaluation; with the rest of its settings:
    batch_size: Count
    hidden: tuple[int, ...]
    n_fits: Count
    discount: float
    bound: tuple[float, float]  # the attainable values, to which targets were clipped
    data_value: float  # discounted team return of the validation episodes as they were recorded
    score_unit: Literal["score", "return"] | None = None
    n_score_episodes: Count | None = None
    policies: Annotated[tuple[RankedPolicy, ...], Field(min_length=1)]
    quality: dict[Criterion, CriterionQuality] = Field(default_factory=dict)

    def to_text(self) -> str:
        """The tables aligned with spaces, for a terminal."""
        tables = [aligned_table(head, rows) for head, *rows in self._grids()]
        return "\n".join([*tables, self.caption, ""])

    def to_markdown(self) -> str:
        """The tables for GitHub."""
        tables = [markdown.table(head, rows, is_numeric=True) for head, *rows in self._grids()]
        return "\n".join([*tables, self.caption, ""])

    def to_csv(self) -> str:
        """One row per policy at full precision; what is not known is empty."""
        out = io.StringIO()
        writer = csv.writer(out, lineterminator="\n")
        ends = ("fqe", "fqe_low", "fqe_high")
        plain = [name for name in RankedPolicy.model_fields if name not in ("fqe", "fqe_curve")]
        writer.writerow(["rank", *ends, *plain])
        for rank, policy in enumerate(self.policies, 1):
            values = [*policy.fqe, *(getattr(policy, name) for name in plain)]
            writer.writerow([rank, *("" if value is None else value for value in values)])
        return out.getvalue()

    def write(self, folder: Path) -> None:
        """Writes `ranking.md`, `ranking.csv` and `ranking.json`; the folder is made if need be."""
        folder.mkdir(parents=True, exist_ok=True)
        texts = {"md": self.to_markdown(), "csv": self.to_csv(), "json": f"{self.to_json()}\n"}
        for ending, text in texts.items():
            write_file(folder / f"ranking.{ending}", text.encode())

    @property
    def caption(self) -> str:
        """What the numbers are, and what to know before believing them."""
        low, high = self.bound
        worst = max(policy.fqe_clipped for policy in self.policies)
        bound = (
            f"The bound [{low:.4g}, {high:.4g}] cut up to {100 * worst:.1f} % of a policy's last "
            "targets: its value is not to be trusted."
            if worst > 0
            else f"No target met the bound [{low:.4g}, {high:.4g}]."
        )
        text = (
            f"Trained on {self.dataset} (digest {self.digest[:12]}), ranked by "
            f"{CRITERIA[self.by][0]}, on {self.n_validation_episodes} validation episodes. FQE: "
            f"discounted return ({self.discount:g} per step) from their first states [95 % "
            f"interval over these states], {self.n_updates:,} updates; as recorded it is "
            f"{self.data_value:.3g}. {bound} Errors are lower for better policies. "
            "FQE overrates policies whose actions left the data, as a large imitation error shows."
        )
        if self.score_unit is not None:
            text += (
                f" The {self.score_unit} is that of {self.n_score_episodes} simulated episodes; "
                "Spearman's correlation with it [95 % bootstrap over policies], and how much worse "
                "the best of the k policies chosen is than the best of all (regret@k)."
            )
        return text

    def _grids(self) -> list[list[list[str]]]:
        return [self._policies(), *([self._qualities()] if self.quality else [])]

    def _policies(self) -> list[list[str]]:
        unit = [] if self.score_unit is None else [self.score_unit]
        head = ["policy", *(label for label, _ in CRITERIA.values()), *unit]
        rows = [
            [
                policy.label,
                _interval(policy.fqe, 3),
                *(_number(getattr(policy, name), 4) for name in list(CRITERIA)[1:]),
                *(_number(policy.score, 1 if unit == ["score"] else 2) for _ in unit),
            ]
            for policy in self.policies
        ]
        return [head, *rows]

    def _qualities(self) -> list[list[str]]:
        ks = sorted({k for each in self.quality.values() for k in each.regret})
        head = ["criterion", "policies", "rank correlation", *(f"regret@{k}" for k in ks)]
        rows = [
            [
                CRITERIA[name][0],
                str(each.n_policies),
                _interval(each.spearman, 2),
                *(_number(each.regret.get(k), 2) for k in ks),
            ]
            for name, each in self.quality.items()
        ]
        return [head, *rows]


def _number(value: float | None, decimals: int) -> str:
    return "–" if value is None else f"{value:.{decimals}f}"


def _interval(values: Interval, decimals: int) -> str:
    value, low, high = (f"{number:.{decimals}f}" for number in values)
    return f"{value} [{low}, {high}]"
