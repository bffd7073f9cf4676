"""The page of a study in words: the lines of its commands in one order, labels, captions, and the method."""

from collections.abc import Iterable, Iterator, Mapping

from taichi_erosion.evidence.race.priors import KEEP, SURE
from taichi_erosion.evidence.record import Record
from taichi_erosion.evidence.words import answer_lines as lines
from taichi_erosion.evidence.words.part_words import sure_and_group
from taichi_erosion.evidence.words.vocabulary import join_words, probability_text
from taichi_erosion.tables.number_words import count_noun

LEADING = ("discover", "adopt", "compare")  # commands whose answer can lead the page
SECTIONS = ("What is missing", "Does it hold", "What next", "Methods")
PREDICTIONS = "Predictions"
MEASURED, BARE = "measured", "the model as it is"
RESIDUAL = "measured less predicted"
CAPTIONS = {
    "rows": "The {observable} along the {axis}: values, with 90 % intervals of those measured; residuals.",
    "limits": " Arrow: a limit; bar with ends: the value lies between them.",
    "posterior": "Probability of every explanation after the measurements.",
    "strengths": "Strength of every candidate. Dot: it acts or likely does; 90 % interval. Bar: it could act "
    "unseen; where the bar is closed, more is excluded. Dotted: 1, the textbook value.",
    "numbers": "Calibrated numbers with 90 % intervals, each on its own axis. Dotted: where it started.",
    "doses": "Dose of {mechanism} along {axis}: its law at the measured conditions, with 90 % intervals. At "
    "0 nothing is missing.",
    "curves": "What something not in the list does to the {observable} along {axis}; 90 % band.",
    "ladder": "Misfit per row. Filled: fitted rows; open: held-out rows. Dotted: 1, what chance alone gives.",
}
CLOSED_FORM = "taichi_erosion.evidence.models.reduced"  # start of the name of the program's own formulas
FORMULAS = {
    "threshold_u_star": "u*t = A sqrt((rho_p / rho - 1) g d)",
    "flux": "Q = C (rho / g) u*t (u*^2 - u*t^2), 0 below the threshold",
    "repose_angle": "angle of repose = arctan(mu_s) + 15 deg mu_r",
}
METHODS = (
    "Every explanation (nothing, up to four listed effects, one mechanism, something not in the list) is the "
    "model, linearised about its own best fit: y measured less predicted in standard errors of a row, J its "
    "slopes along calibrated numbers and strengths t, F u an error that rows have in common (level, source, "
    "preparation, group, smooth discrepancy, dose) of an unknown size \N{GREEK SMALL LETTER TAU}, e scatter, "
    "f times as large as stated.",
    "Its probability is its share before the measurements times their density under it, over all t, u, sizes "
    "and f; an effect acts if the explanations that hold it have {sure:g} of the probability together, "
    "chance alone rarely makes a candidate look as good, and the rows do not refute the fit.",
    "In the table of candidates strength is the median with a 90 % interval over these explanations, and "
    "probability is that the effect acts.",
    "Misfit per row is the mean squared residual in standard errors, less levels, sources and groups, p the "
    "chance of as much; this answer took {settings} of the model, {runs}, seed {seed}.",
)


def page_lines(answers: Mapping[str, lines.Answer], lead: str) -> tuple[tuple[str, ...], ...]:
    """The lead, what is missing, does it hold, what next; a line that several commands tell stands once."""
    answer = next(answers[name] for name in ("discover", lead) if name in answers)
    test, proposed = answers.get("adopt", answer), answers["next"].lines if "next" in answers else ()
    unseen = test.missing if test is not answer else ()
    parts = answers[lead].missing[:1], answer.missing, (*unseen, *test.holds), (*test.following, *proposed)
    earlier: set[str] = set()
    return tuple(tuple(line for line in part if not (line in earlier or earlier.add(line))) for part in parts)


def omissions(commands: Iterable[str]) -> str:
    """Answers that rest on another table than the present one; empty where there are none."""
    names = join_words(f"`{name}`" for name in commands)
    return f"Left out, for they rest on another version of the table: answers of {names}." if names else ""


def added_effects_text(record: Record) -> str:
    """What the model of the answer has beside the model as it is; empty where nothing is told."""
    firm, either = sure_and_group(record)
    if firm or either:
        return f"with {join_words([*firm, *([f'the likeliest of {join_words(either)}'] if either else [])])}"
    return "with something not in the list" if record.verdict == "outside_library" else ""


def explanations_by_probability(record: Record) -> Iterator[tuple[str, float, str]]:
    """Explanations with their probabilities, the likeliest first; small ones together."""
    ranked = sorted(record.probabilities.items(), key=lambda item: -item[1])
    small = [p for _, p in ranked if p < KEEP]
    main = [(lines.explanation_name(key), p) for key, p in ranked if p >= KEEP]
    rest = [(count_noun(len(small), "other explanation"), sum(small))] if small else []
    yield from ((label, p, probability_text(p)) for label, p in (*main, *rest))


def model_description(model: str, record: Record) -> str:
    """What answers in place of the soil: formulas, a function of the user, or simulated scenes."""
    name, observables = model.partition(" ")[0], dict.fromkeys(record.rows.observable)
    if name.startswith(CLOSED_FORM):
        formulas = "; ".join(FORMULAS[each] for each in observables if each in FORMULAS)
        return f"The model is a formula, times the shifts of the effects: {formulas}."
    if ":" in name:
        return f"The model is the function {name}."
    return "The model simulates every grain; an emulator of its runs answers between them."


def methods_text(record: Record, model: str = "") -> tuple[str, ...]:
    """The model, and how the answer was found."""
    settings, runs = count_noun(record.settings, "setting"), count_noun(record.runs, "run")
    sentences = (each.format(sure=SURE, seed=record.seed, settings=settings, runs=runs) for each in METHODS)
    return *([model_description(model, record)] if model else []), *sentences
