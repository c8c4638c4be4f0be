"""The trials of a tuning: which one each rule chooses, what k trials can be expected to find."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import yaml
from pydantic import Field

from swarmdata.drawing import markdown
from swarmdata.drawing.markdown import aligned_table
from swarmdata.errors import ResultsError
from swarmdata.evaluation.policy_selection.rank_statistics import ranks
from swarmdata.evaluation.results.estimate_table import to_csv
from swarmdata.evaluation.results.learning_curves import Curve, plot_curves
from swarmdata.runtime.output_folder import OutputKind, filled, remove_others
from swarmdata.specs.frozen import Frozen
from swarmdata.types import Double

TUNING = OutputKind("tuning")

CELLS = "cells"  # the folder of trainings and their results, beside what is written from them

RECORD = "tuning.json"  # the trials, from which all else is written

Rule = Literal["validation", "offline"]

RULES: dict[Rule, str] = {"validation": "validation episodes", "offline": "offline estimates"}
"""What trials are chosen by: A, and B, which needs no simulator."""

ESTIMATES = ("fqe_pessimistic", "imitation_error", "weighted_imitation_error")
"""Criteria of `rank` that a trial records, means over seeds; the first one decides rule B."""


class Trial(Frozen):
    """One configuration, trained with all seeds on all datasets."""

    settings: dict[str, Any]  # drawn; none of the first trial, which is the configuration as it is
    config: dict[str, Any]  # all settings that differ from the algorithm's defaults
    scores: dict[str, float]  # by dataset: mean over seeds and validation episodes; {}: none
    estimates: dict[str, dict[str, float]]  # by dataset and criterion; {}: none
    failure: str | None = None  # why it has no scores


class Tuning(Frozen):
    """The trials of one algorithm, the unchanged configuration first."""

    format: Literal["swarmdata-tuning"] = "swarmdata-tuning"
    format_version: Literal[1] = 1
    code_version: str
    algorithm: str
    datasets: dict[str, str]  # digests of what was trained on, by the short name
    n_updates: int
    seeds: tuple[int, ...]
    n_episodes: int  # validation episodes of each seed; 0: the data have no simulator
    unit: Literal["score", "return"]
    without_estimates: str | None = None  # why rule B could not choose
    trials: Annotated[tuple[Trial, ...], Field(min_length=2)]

    @property
    def rules(self) -> tuple[Rule, ...]:
        """The rules that could choose."""
        can_choose = {"validation": self.n_episodes > 0, "offline": not self.without_estimates}
        return tuple(rule for rule in RULES if can_choose[rule])

    @property
    def scores(self) -> Double:
        """The score of each trial, a mean over datasets; of one without -infinity, [n]."""
        means = [np.mean([*each.scores.values()] or [-np.inf]) for each in self.trials]
        return np.array(means, dtype=np.float64)

    def criterion(self, rule: Rule) -> Double:
        """What a rule chooses the largest of, [n]; of a trial that failed -infinity.

        Rule B: the mean over datasets of the trial's rank by the first of `ESTIMATES`, since values
        in different tasks have no common unit.
        """
        scores = self.scores
        if rule == "validation":
            return scores
        known = [k for k, each in enumerate(self.trials) if each.failure is None]
        found = np.full(len(scores), -np.inf)
        by_dataset = [
            [self.trials[k].estimates[name][ESTIMATES[0]] for k in known] for name in self.datasets
        ]
        found[known] = ranks(np.array(by_dataset, dtype=np.float64)).mean(axis=0)
        return found

    def choice(self, rule: Rule) -> int:
        """The number of the trial that a rule chooses, the first of equal ones."""
        found = self.criterion(rule)
        if np.isneginf(found).all():
            raise ResultsError(f"all trials of {self.algorithm} failed: {self.trials[0].failure}")
        return int(found.argmax())

    def curve(self, rule: Rule) -> Double:
        """The expected score of what a rule chooses of k trials, for k from 1 to n, [n]."""
        is_known = [each.failure is None for each in self.trials]
        scores = np.where(is_known, self.scores, self.scores[is_known].min())
        return expected_scores(self.criterion(rule), scores)

    def write(self, folder: Path) -> None:
        """Writes the page, the table, the curve and the settings that the rules chose.

        Raises:
            OutputError: the folder has files that no tuning wrote.
            MissingExtraError: matplotlib is not installed.
        """
        with filled(folder, TUNING, besides=CELLS) as written:
            (written / RECORD).write_text(f"{self.to_json()}\n", encoding="utf-8")
            (written / "tuning.md").write_text(self.to_markdown(), encoding="utf-8")
            (written / "trials.csv").write_text(self.to_csv(), encoding="utf-8")
            if self.n_episodes:
                self._write_curve(written)
            for rule in self.rules:
                chosen = self.trials[self.choice(rule)].config
                text = yaml.safe_dump(chosen, sort_keys=False) if chosen else "{}\n"
                (written / f"{rule}.yaml").write_text(text, encoding="utf-8")
            kept = {path.name for path in written.iterdir()}
        remove_others(folder, TUNING, kept)

    def to_csv(self) -> str:
        """One row for each trial; what is unknown is empty."""
        rows = []
        drawn = dict.fromkeys(name for each in self.trials for name in each.settings)
        for number, (each, score) in enumerate(zip(self.trials, self.scores.tolist(), strict=True)):
            row = {"trial": number, **drawn, **each.settings}
            row[self.unit] = score if each.scores else None
            row |= {f"{self.unit}:{name}": each.scores.get(name) for name in self.datasets}
            for name in self.datasets:
                found = each.estimates.get(name, {})
                row |= {f"{key}:{name}": found.get(key) for key in ESTIMATES}
            for rule in self.rules:
                row[f"chosen by {RULES[rule]}"] = int(number == self.choice(rule))
            rows.append({**row, "failure": each.failure})
        return to_csv(rows, "")

    def to_text(self) -> str:
        """Both choices with their scores, aligned with spaces, for a terminal."""
        return "\n".join([aligned_table(*self._choices()), self.caption, ""])

    def to_markdown(self) -> str:
        """The page: both choices with their scores, and how they were found."""
        parts = [f"# Tuning of {self.algorithm}\n", markdown.table(*self._choices()), self.caption]
        if self.n_episodes:
            parts.append("\n![expected score of what k trials end with](curve.png)\n")
        return "\n".join(parts)

    def _choices(self) -> tuple[list[str], list[list[str]]]:
        numbers = {"the configuration as it is": 0}
        numbers |= {f"chosen by {RULES[rule]}": self.choice(rule) for rule in self.rules}
        estimated = (f"{ESTIMATES[0]} of {name}" for name in self.datasets)
        shown = (self.unit, *self.datasets) if self.n_episodes else (*estimated,)
        head = ["", "trial", *shown, "settings"]
        rows = []
        for words, k in numbers.items():
            settings = (f"{key}={value}" for key, value in self.trials[k].settings.items())
            rows.append([words, str(k), *self._numbers(self.trials[k]), ", ".join(settings)])
        return head, rows

    def _numbers(self, trial: Trial) -> list[str]:
        """What the trial reached: its scores; of data without a simulator, what decides rule B."""
        if self.n_episodes:
            every = [trial.scores.get(name, math.nan) for name in self.datasets]
            return [f"{value:.1f}" for value in (np.mean(every), *every)]
        found = (trial.estimates.get(name, {}) for name in self.datasets)
        return [f"{each.get(ESTIMATES[0], math.nan):.3g}" for each in found]

    @property
    def caption(self) -> str:
        """How the trials were run, and what their scores do not say."""
        failed = sum(each.failure is not None for each in self.trials)
        seeds = f"{len(self.seeds)} seed{'s' * (len(self.seeds) > 1)}"
        text = (
            f"{len(self.trials)} trials, {failed} of them failed; {self.n_updates:,} updates and "
            f"{seeds} each. "
        )
        if not self.n_episodes:
            return text + (
                "The data have no simulator, so that nothing was chosen by validation episodes. "
                "Offline estimates overrate policies that leave the data."
            )
        text += (
            f"The {self.unit} is the mean over {self.n_episodes} "
            "validation episodes of each seed. That of the trial chosen by it is too high, as the "
            "largest of several measurements is: evaluate what was chosen on the reserved episodes."
        )
        if self.without_estimates:
            text += f" Nothing was chosen by offline estimates: {self.without_estimates}"
        return text

    def _write_curve(self, folder: Path) -> None:
        values, n = [self.curve(rule) for rule in self.rules], len(self.trials)
        rows = zip(range(1, n + 1), *(each.tolist() for each in values), strict=True)
        table = to_csv([dict(zip(("trials", *self.rules), row, strict=True)) for row in rows])
        (folder / "curve.csv").write_text(table, encoding="utf-8")
        curves = {
            RULES[rule]: Curve(np.arange(1.0, n + 1), each[None])
            for rule, each in zip(self.rules, values, strict=True)
        }
        plot_curves(
            curves, folder / "curve.png", ylabel=f"expected {self.unit}", xlabel="trials",
            references={"default": float(self.scores[0])} if self.trials[0].scores else {},
        )  # fmt: skip


def expected_scores(criterion: Sequence[float] | Double, scores: Double) -> Double:
    """Returns the expected score of the trial that k trials would have ended with, k = 1 ... n.

    Trial 0 is always among them, the others are k - 1 of the rest, each set of that size as likely
    as any other; that of the largest criterion, [n], of equal ones the first, is chosen. With the
    score as its criterion, it is the expected validation performance of Dodge et al., "Show Your
    Work: Improved Reporting of Experimental Results", EMNLP 2019, section 3, with trials drawn
    without replacement, which has no bias (Tang et al., "Showing Your Work Doesn't Always Work",
    ACL 2020).
    """
    found = np.asarray(criterion)
    order = [k for k in np.lexsort((-np.arange(len(found)), found)) if k > 0]  # the best last
    n = len(order)
    expected = np.full(n + 1, scores[0], dtype=np.float64)
    for m in range(1, n + 1):
        for rank, k in enumerate(order, 1):
            if found[k] > found[0]:
                share = math.comb(rank - 1, m - 1) / math.comb(n, m)
                expected[m] += share * (scores[k] - scores[0])
    return expected
