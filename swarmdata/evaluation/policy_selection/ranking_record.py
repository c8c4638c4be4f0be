"""The ranking of trained policies without a simulator, as a file and as tables."""

from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from swarmdata.drawing import markdown
from swarmdata.drawing.markdown import aligned_table
from swarmdata.evaluation.results.estimate_table import to_csv
from swarmdata.runtime.output_folder import OutputKind, filled
from swarmdata.specs.frozen import Frozen

RANKING = OutputKind("ranking")

Criterion = Literal[
    "fqe", "fqe_pessimistic", "imitation_error", "weighted_imitation_error", "td_error"
]

CRITERIA: dict[Criterion, tuple[str, bool]] = {
    "fqe": ("FQE value", True),
    "fqe_pessimistic": ("pessimistic FQE value", True),
    "imitation_error": ("imitation error", False),
    "weighted_imitation_error": ("weighted imitation error", False),
    "td_error": ("TD error", False),
}
"""The label of each criterion, and whether higher is better."""

Interval = tuple[float, float, float]  # a value and its 95 % interval
Count = Annotated[int, Field(ge=1)]


class RankedPolicy(Frozen):
    """A policy with its origin and its criteria."""

    run: str  # name of the run's folder
    run_hash: str  # of the run's `config.json`
    algorithm: str
    seed: int
    update: int
    fqe: Interval  # discounted team return; the interval is over initial states
    fqe_pessimistic: float  # the least of the fits, at the lower end of its interval
    fqe_curve: tuple[float, ...]  # during the fit; it has not converged if it still changes
    fqe_residual: float  # root mean square of Q - y on the validation split
    fqe_clipped: float  # share of the last targets that the bound clipped
    imitation_error: float
    weighted_imitation_error: float
    td_error: float | None  # None: the algorithm has no such critics
    score: float | None = None  # in a simulator, if it was measured

    @property
    def label(self) -> str:
        """Run, seed and update."""
        return f"{self.run}/seed-{self.seed}@{self.update}"


class CriterionQuality(Frozen):
    """How well a criterion ranked the policies that have it and a score, as a record."""

    n_policies: Count
    spearman: Interval
    regret: dict[int, float]


class Ranking(Frozen):
    """Policies trained on one dataset, sorted by the criterion `by`."""

    format: Literal["swarmdata-ranking"] = "swarmdata-ranking"
    format_version: Literal[2] = 2
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
    bound: tuple[float, float]  # attainable values, to which targets were clipped
    data_value: float  # discounted team return of the validation episodes as recorded
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
        """One row per policy at full precision; unknown values are empty."""
        rows = [
            {"rank": rank, **dict(zip(("fqe", "fqe_low", "fqe_high"), policy.fqe, strict=True))}
            | {name: value for name, value in policy if name not in ("fqe", "fqe_curve")}
            for rank, policy in enumerate(self.policies, 1)
        ]
        return to_csv(rows, "")

    def write(self, folder: Path) -> None:
        """Writes `ranking.md`, `ranking.csv` and `ranking.json`; creates the folder.

        Raises:
            OutputError: the folder has files that no ranking wrote.
        """
        texts = {"md": self.to_markdown(), "csv": self.to_csv(), "json": f"{self.to_json()}\n"}
        with filled(folder, RANKING) as written:
            for ending, text in texts.items():
                (written / f"ranking.{ending}").write_text(text, encoding="utf-8")

    @property
    def caption(self) -> str:
        """The meaning of the numbers, and their limits."""
        low, high = self.bound
        worst = max(policy.fqe_clipped for policy in self.policies)
        bound = (
            f"The bound [{low:.4g}, {high:.4g}] clipped up to {100 * worst:.1f} % of a policy's "
            "last targets: do not trust its value."
            if worst > 0
            else f"The bound [{low:.4g}, {high:.4g}] clipped no target."
        )
        text = (
            f"Trained on {self.dataset} (digest {self.digest[:12]}), ranked by "
            f"{CRITERIA[self.by][0]}, on {self.n_validation_episodes} validation episodes. FQE: "
            f"discounted return ({self.discount:g} per step) from their first states [95 % "
            f"interval over these states], {self.n_updates:,} updates; as recorded it is "
            f"{self.data_value:.3g}. {bound} Errors are lower for better policies. "
            "FQE overrates policies whose actions are far from the data, which a large imitation "
            "error shows."
        )
        if self.score_unit is not None:
            text += (
                f" The {self.score_unit} is that of {self.n_score_episodes} simulated episodes; "
                "rank correlation is Spearman's with it [95 % bootstrap over policies], and "
                "regret@k is how much worse the best of the k chosen policies is than the best of "
                "all."
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
