"""A table of estimates, written as Markdown, CSV, LaTeX or aligned text."""

import csv
import io
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from swarmdata.drawing import markdown
from swarmdata.drawing.markdown import aligned_table
from swarmdata.errors import UnknownNameError
from swarmdata.rollouts.score_intervals import UNBOUNDED, Bounds
from swarmdata.rollouts.score_statistics import Estimate

UNDEFINED = "–"  # in place of a value that was not measured or is not defined


@dataclass(frozen=True, slots=True)
class Column:
    """A column of a table and the format of its numbers."""

    key: str  # in CSV
    label: str
    unit: str  # empty if there is none
    decimals: int
    factor: float = 1.0  # from the stored value to the shown one: 100 for percentages
    is_rate: bool = False  # a share of episodes, whose interval is the binomial one
    bounds: Bounds = UNBOUNDED  # of the stored values, and so of intervals

    @property
    def header(self) -> str:
        """Label with unit."""
        return f"{self.label} ({self.unit})" if self.unit else self.label

    def shown(self, estimate: Estimate) -> Estimate:
        """An estimate in the unit of tables and figures."""
        return Estimate(*(self.factor * end for end in estimate))


@dataclass(frozen=True, slots=True)
class Row:
    """One policy or algorithm."""

    label: str
    n_runs: int  # 0 if the row is not a policy, such as the mean of a dataset
    estimates: tuple[Estimate, ...]  # one per column; NaN if undefined


@dataclass(frozen=True, slots=True)
class Table:
    """Estimates of several policies on the same episodes."""

    columns: tuple[Column, ...]
    rows: tuple[Row, ...]
    caption: str

    def to_markdown(self) -> str:
        """A GitHub table with the caption below it."""
        head, *rows = self._grid()
        return f"{markdown.table(head, rows, is_numeric=True)}\n{self.caption}\n"

    def to_text(self) -> str:
        """Columns aligned with spaces, for a terminal, with the caption below."""
        head, *rows = self._grid()
        return f"{aligned_table(head, rows)}\n{self.caption}\n"

    def to_csv(self) -> str:
        """All values and intervals at full precision, in stored units; undefined ones are empty."""
        names = [c.key + end for c in self.columns for end in ("", "_low", "_high")]
        rows = [
            {"policy": row.label, "runs": row.n_runs}
            | dict(zip(names, (end for each in row.estimates for end in each), strict=True))
            for row in self.rows
        ]
        return to_csv(rows, "")

    def to_latex(self) -> str:
        """A table in the style of the LaTeX package `booktabs`, its text escaped."""
        grid = [[_latex(cell) for cell in line] for line in self._grid()]
        rows = [f"    {' & '.join(line)} \\\\" for line in grid]
        return "\n".join(
            [
                r"\begin{table}",
                r"  \centering",
                f"  \\caption{{{_latex(self.caption)}}}",
                f"  \\begin{{tabular}}{{l{'r' * (len(grid[0]) - 1)}}}",
                r"    \toprule",
                rows[0],
                r"    \midrule",
                *rows[1:],
                r"    \bottomrule",
                r"  \end{tabular}",
                r"\end{table}",
                "",
            ]
        )

    def panels(self, keys: Sequence[str]) -> dict[str, dict[str, Estimate]]:
        """Returns columns in shown units, for `plot_estimates`: header -> row -> estimate."""
        known = {column.key: index for index, column in enumerate(self.columns)}
        chosen = {}
        for key in keys:
            if key not in known:
                raise UnknownNameError("column", key, known)
            column = self.columns[known[key]]
            rows = {row.label: row.estimates[known[key]] for row in self.rows}
            chosen[column.header] = {label: column.shown(each) for label, each in rows.items()}
        return chosen

    def _grid(self) -> list[list[str]]:
        """The cells as text, header first; with numbers of runs if some row has several."""
        has_runs = any(row.n_runs > 1 for row in self.rows)
        head = ["policy", *(["runs"] if has_runs else []), *(c.header for c in self.columns)]
        body = [
            [
                row.label,
                *([str(row.n_runs or UNDEFINED)] if has_runs else []),
                *(format_estimate(e, c) for e, c in zip(row.estimates, self.columns, strict=True)),
            ]
            for row in self.rows
        ]
        return [head, *body]


def format_number(value: float, column: Column) -> str:
    """Formats a number in the column's unit and decimals; an undefined one is a dash."""
    if math.isnan(value):
        return UNDEFINED
    text = f"{value * column.factor:.{column.decimals}f}"
    return text.removeprefix("-") if not float(text) else text  # no negative zero


def format_estimate(estimate: Estimate, column: Column) -> str:
    """Formats `value [low, high]`; only the value without an interval, a dash if undefined."""
    value, low, high = (format_number(number, column) for number in estimate)
    return value if math.isnan(estimate.low) else f"{value} [{low}, {high}]"


_LATEX = str.maketrans(
    {
        "\\": r"\textbackslash{}",
        "~": r"\textasciitilde{}",
        "^": r"\textasciicircum{}",
        "–": "--",
        "<": r"\textless{}",
        ">": r"\textgreater{}",
        **{character: f"\\{character}" for character in "&%$#_{}"},
    }
)


def _latex(text: str) -> str:
    escaped = text.translate(_LATEX)
    # a bracket at the beginning of a row would be an argument of the previous row
    return f"{{{escaped}}}" if escaped.startswith("[") else escaped


def to_csv(rows: Sequence[Mapping[str, object]], digits: str = ".8g") -> str:
    """The rows, which may lack some columns, as CSV in the order of their keys; NaN is empty.

    `digits` is the format of floats, by default the same on every machine; empty: every bit.
    """
    names = list(dict.fromkeys(name for row in rows for name in row))
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(names)
    writer.writerows([[_format_cell(row.get(name), digits) for name in names] for row in rows])
    return out.getvalue()


def _format_cell(value: object, digits: str) -> str:
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return ""
    if isinstance(value, float):
        return format(value, digits) if digits else repr(float(value))
    return str(value)
