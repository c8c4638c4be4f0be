"""How long to train: what doubling the updates changes."""

from collections.abc import Sequence
from pathlib import Path

from swarmdata.evaluation.study.answers.answer import Answer
from swarmdata.evaluation.study.answers.compared_rows import (
    compared_rows,
    counted_verdicts,
    plot_compared,
    tables_of,
)
from swarmdata.evaluation.study.answers.doubled_orders import (
    doubled_orders,
    order_sentences,
    order_table,
    orders_kept,
)
from swarmdata.evaluation.study.answers.evidence import Evidence
from swarmdata.evaluation.study.pages.row_differences import doubling_sentences

DIFFERENCES = "doubling"
"""What studies call these pairs."""


def answer_training_length(evidence: Sequence[Evidence], out: Path) -> Answer | None:
    """Answers from the pairs that studies call `doubling`."""
    compared = compared_rows(evidence, DIFFERENCES)
    if not compared:
        return None
    sentences, orders, kept = [], "", []
    for each in compared:
        found = each.evidence.found
        plan = found.study.differences[DIFFERENCES]
        doubled = doubled_orders(found, plan)
        kept += [orders_kept(doubled)] if doubled else []
        sentences += order_sentences(doubled)
        sentences += doubling_sentences(found, plan)
        orders += f"Study {each.evidence.name}:\n\n{order_table(found, plan)}\n"
    changes = counted_verdicts(compared, "doubling the updates")
    figure = "training-length.png"
    plot_compared(compared, out / figure)
    details = (
        "Families by score, the best first. `>`: clearly better than the next, paired by episode; "
        f"`≥`: not clearly.\n\n{orders}![what doubling changes]({figure})\n\n"
        f"{tables_of(compared)}"
    )
    studies = tuple(each.evidence for each in compared)
    headline = " ".join([*kept, changes])
    return Answer(headline, tuple(sentences), details, studies, (figure,))
