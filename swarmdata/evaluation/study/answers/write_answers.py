"""Writes the pages of all questions that the studies of a folder can answer, and their index."""

import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

from swarmdata.evaluation.study.answers.answer import Answer, Question
from swarmdata.evaluation.study.answers.conditions.information_regimes import (
    answer_information_regimes,
)
from swarmdata.evaluation.study.answers.conditions.other_places import answer_other_places
from swarmdata.evaluation.study.answers.conditions.robustness import answer_robustness
from swarmdata.evaluation.study.answers.data_efficiency import answer_data_efficiency
from swarmdata.evaluation.study.answers.data_regimes import answer_data_regimes
from swarmdata.evaluation.study.answers.distance_from_data import answer_distance_from_data
from swarmdata.evaluation.study.answers.evidence import Evidence, limits, open_evidence
from swarmdata.evaluation.study.answers.ingredients import answer_ingredients
from swarmdata.evaluation.study.answers.online_algorithms import answer_online_algorithms
from swarmdata.evaluation.study.answers.safety import answer_safety
from swarmdata.evaluation.study.answers.training_length import answer_training_length
from swarmdata.rollouts.score_intervals import TARGET_OF_SEVERAL
from swarmdata.runtime.output_folder import OutputKind, check_output, filled

ANSWERS = OutputKind("folder of study pages")

INDEX_FILE = "README.md"

OTHER_PAGES = ("simulators.md",)
"""Pages in the folder that other commands write: `swarmdata transfer`."""

QUESTIONS = (
    Question(
        "ingredients",
        "What do the ingredients do?",
        "measured pairs under `differences: ingredient`",
        answer_ingredients,
        "An algorithm that learns as well without what it is named after has not earned its name. "
        "Each row is compared with the same algorithm without its ingredient, trained as long.",
    ),
    Question(
        "training-length",
        "How long to train?",
        "measured pairs under `differences: doubling`",
        answer_training_length,
        "A budget is long enough where doubling it, with a schedule of its own, changes no score "
        "clearly. No clear change is not the same as no change: the intervals say what they "
        "leave room for.",
    ),
    Question(
        "data-regimes",
        "Which algorithm for which data?",
        "several datasets on the reserved seeds",
        answer_data_regimes,
        "The same algorithms with the same settings on data of different quality.",
    ),
    Question(
        "online",
        "How far do algorithms get that learn in the task?",
        "`online` rows in the task of one of its datasets",
        answer_online_algorithms,
        "Online algorithms collect their own data; offline ones learn from what was recorded. Both "
        "are evaluated on the same episodes, with the last policy of each seed.",
    ),
    Question(
        "information",
        "What does information cost?",
        "measured views under `information`",
        answer_information_regimes,
        "The same data seen and heard in other ways, for training and for evaluation. Every view "
        "is compared with the first one of its study.",
    ),
    Question(
        "robustness",
        "How do they take worse radios and sensors than in training?",
        "measured `sweeps`",
        answer_robustness,
        "Policies keep what they learned; only one parameter of what they hear or see gets worse. "
        "Changes are paired by training seed and episode.",
    ),
    Question(
        "places",
        "Do they act in other places and larger teams?",
        "policies evaluated in other `tasks`",
        answer_other_places,
        "Policies are used as they are, in arenas and teams that they were not trained in.",
    ),
    Question(
        "data-efficiency",
        "How much data do they need?",
        "measured `sizes`",
        answer_data_efficiency,
        "The same algorithms with the same updates on the first episodes of the same data.",
    ),
    Question(
        "safety",
        "How safe are they?",
        "results on the reserved seeds, or measured pairs under `differences: rewards`",
        answer_safety,
        "An episode is solved cleanly if no robot touched another one or an obstacle. Collisions "
        "are new contacts, counted from events, which no weight of the rewards changes.",
    ),
    Question(
        "distance-from-data",
        "How far from the data do they get?",
        "a plain clone (`bc`) among its rows, on the reserved seeds",
        answer_distance_from_data,
        "What algorithms add to the mean of the data, and to a clone of the data, which learns "
        "without rewards. How far actions are from recorded ones is not measured here.",
    ),
)
"""The pages, in the order of the index."""

CAVEATS = (
    f"Intervals are 95 % intervals for {TARGET_OF_SEVERAL}, each on its own: they are not widened "
    "for the number of comparisons on a page; where nothing differs, one in twenty looks clear by "
    "chance. Datasets and settings are fixed."
)


def write_answers(studies: Path, out: Path) -> tuple[list[Path], dict[str, str]]:
    """Writes a page for each question that has an answer, their figures, and an index.

    A page of a question that has no answer any more is removed. If an answer fails, all pages stay
    as they were.

    Args:
        studies: folder of studies, such as `cards/studies`.
        out: folder of the pages.

    Returns:
        The pages, the index first; and what was left out, with the reason: studies and pages.

    Raises:
        OutputError: `out` has files that this did not write.
        StudyError: no study in the folder has an archive.
        MissingExtraError: matplotlib is not installed.
    """
    check_output(out, ANSWERS)
    place = out.absolute().parent
    place.mkdir(parents=True, exist_ok=True)
    # pages are made beside the old ones, so that relative links hold, and take their place at once
    with (
        open_evidence(studies) as (evidence, unread),
        TemporaryDirectory(prefix=f".{out.name}-", dir=place) as made,
    ):
        folder = Path(made)
        left_out = {f"study {name}": reason for name, reason in unread.items()}
        answers: dict[str, Answer] = {}
        for question in QUESTIONS:
            found = question.answer(evidence, folder)
            if found is None:
                left_out[f"{question.stem}.md"] = f"no study has {question.needs}"
            else:
                answers[question.stem] = found
                page = _page(question, found, out)
                (folder / f"{question.stem}.md").write_text(page, encoding="utf-8")
        index = _index(answers, out, _spent(evidence))
        (folder / INDEX_FILE).write_text(index, encoding="utf-8")
        with filled(out, ANSWERS, whole=True) as target:
            shutil.copytree(folder, target, dirs_exist_ok=True)
    return [out / INDEX_FILE, *(out / f"{stem}.md" for stem in answers)], left_out


def _page(question: Question, answer: Answer, out: Path) -> str:
    sentences = "".join(f"- {sentence}\n" for sentence in answer.sentences)
    return (
        f"# {question.title}\n\n{question.scope}\n\n**In short:** {answer.headline}\n\n"
        f"{answer.details.rstrip()}\n\n## In words\n\n{sentences}\n"
        f"## Limits\n\n{limits(answer.evidence, out)}\n{CAVEATS}\n\n"
        "`swarmdata study-pages` writes this page from the episodes of these studies.\n"
    )


def _other(path: Path) -> str:
    """The index's line of a page that another command wrote: its title and first sentence."""
    lines = path.read_text(encoding="utf-8").splitlines()
    sentence = next(line for line in lines if line.startswith("- "))
    return f"- [{lines[0].removeprefix('# ')}]({path.name}) {sentence.removeprefix('- ')}\n"


def _spent(evidence: Sequence[Evidence]) -> str:
    """How many cells the studies have, and what they took; those that studies share count once."""
    seconds = {
        cell.key: each.found.costs[cell.name].cpu_seconds
        for each in evidence
        for cell in each.found.cells
    }
    hours = sum(seconds.values()) / 3600
    return (
        f"The studies have {len(seconds):,} different cells, each an algorithm with all its seeds "
        f"on a dataset, which took {hours:.1f} hours of processor time. Evaluations in other "
        "conditions and unfinished cells are not counted."
    )


def _index(answers: Mapping[str, Answer], out: Path, spent: str) -> str:
    asked = {question.stem: question for question in QUESTIONS}
    known = "".join(
        f"- [{asked[stem].title}]({stem}.md) {answer.headline}\n"
        for stem, answer in answers.items()
    )
    known += "".join(_other(out / name) for name in OTHER_PAGES if (out / name).exists())
    open_questions = [
        f"- {question.title} No study with {question.needs} is finished.\n"
        for stem, question in asked.items()
        if stem not in answers
    ]
    rest = f"\nNot answered yet:\n\n{''.join(open_questions)}" if open_questions else ""
    return (
        "# Results\n\nOne page for each question, computed from the studies in "
        "[cards/studies](../../cards/studies) or by a command that the page names. `swarmdata "
        "study-pages` writes those of studies again.\n\n"
        f"{known}\n{spent}\n{rest}"
    )
