"""What acts, in words: headline, statuses of the candidates, laws.

Headline, table and last line take the same names from `acting`, so that they cannot contradict each other.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from math import isnan

from taichi_erosion.evidence.data.number_words import counted, plain
from taichi_erosion.evidence.race.priors import SURE
from taichi_erosion.evidence.race.record import Decided, EffectPart, LawPart, Record
from taichi_erosion.evidence.words import vocabulary as say
from taichi_erosion.evidence.words.vocabulary import Vocabulary

ONE_LESS = " minus one"  # of what a dose counts
COLUMNS = ("effect", "status", "strength (90 %)", "probability", "ln Bayes factor")


@dataclass(frozen=True)
class Acting:
    """What is said to act."""

    sure: tuple[str, ...]
    either: tuple[str, ...]  # of which one does

    @property
    def names(self) -> str:
        """`a and b`, `c or d`; empty where nothing is said to act."""
        return say.joined(filter(None, (*self.sure, say.joined(self.either, "or"))))


def acting(decided: Decided) -> Acting:
    """What a decision says to act: of several mechanisms one does; nothing where new runs change the answer."""
    if decided.verdict == "unstable":
        return Acting((), ())
    sure, either = (decided.mechanisms, ()) if len(decided.mechanisms) == 1 else ((), decided.mechanisms)
    return Acting((*decided.named, *sure), (*decided.group, *either))


def headline(record: Record, voc: Vocabulary) -> str:
    """The answer of `discover` in one sentence."""
    decided, said = record.decided, acting(record.decided)
    if said.names:
        sure, either = (
            [acting_text(name, record, voc) for name in part] for part in (said.sure, said.either)
        )
        open_ = "; these measurements do not tell which" if either else ""
        words = say.joined([*sure, *([f"either {say.joined(either, 'or')}"] if either else [])])
        listed = {0: "", 1: " It is not in the list of effects."}.get(len(decided.mechanisms))
        return (
            f"Missing: {words}{open_}.{' They are not in the list of effects.' if listed is None else listed}"
        )
    if decided.verdict == "outside_library":
        sure = say.probability(decided.probabilities["outside_library"])
        return f"Missing: something not in the list; no listed effect explains the data (probability {sure})."
    return silence(record, voc)


def acting_text(name: str, record: Record, voc: Vocabulary) -> str:
    """An effect or mechanism with its law, or its strength."""
    law, part, title = record.law, record.effects.get(name), voc.titled(name)
    if law is not None and law.mechanism == name:
        return f"{title} with the law {law_text(law, voc)}"
    if part is None or name not in record.decided.named:
        return title
    varies = f"a strength that varies along {part.varies_along}"
    return f"{title} with {varies if part.varies_along else f'strength {strength_text(part)}'}"


def strength_text(part: EffectPart) -> str:
    """Strength with its interval; that it reaches the end of the list."""
    limit = f", at the limit of the list, {plain(part.most, 2)}" if part.strength.high >= part.most else ""
    return f"{say.interval(part.strength)}{limit}"


def law_text(law: LawPart, voc: Vocabulary) -> str:
    """`factor = 1 + 0.8 (moisture / 5 %)^1.2`, in the units of the table."""
    written = {name: plain(number.value, 2) for name, number in law.numbers.items()}
    written |= {name: voc.units.size_text(*size) for name, size in law.sizes.items()}
    text = (law.template or law.expression).format(**written)
    counts = voc.doses.get(law.mechanism.partition(":")[0], "strength")
    if counts.endswith(ONE_LESS):
        return (
            f"{counts.removesuffix(ONE_LESS)} = 1 {'- ' + text[1:] if text.startswith('-') else '+ ' + text}"
        )
    return f"{counts} = {text}"


def law_line(law: LawPart | None) -> str:
    """How well a law is known."""
    if law is None:
        return ""
    free = [f"the exponent of {name} is {say.interval(power)}; " for name, power in law.exponents.items()]
    return f"Law: {''.join(free)}it explains {law.held_out_share:.0%} of the misfit at conditions left out of its fit."


def testable(record: Record) -> bool:
    """Whether these measurements can test any effect."""
    return record.decided.verdict != "not_testable" and not isnan(record.fit.p_before)


def silence(record: Record, voc: Vocabulary) -> str:
    """The answer where nothing is named."""
    decided, fit = record.decided, record.fit
    if decided.verdict == "unstable":
        names = say.joined(map(voc.titled, (*decided.named, *decided.group)), "or")
        return f"No effect is named: new runs of the scene change the answer. Candidates: {names}."
    if isnan(fit.p_before):
        return "No effect is named: the scatter is unknown. Add a column sd, or repeats, to the table."
    if not testable(record):
        few = f"{counted(fit.n, 'row')} cannot test one where {counted(len(record.numbers), 'number')} are calibrated"
        return f"No effect is named: {few}. Measure under more conditions."
    likely, share = max(decided.probabilities.items(), key=lambda item: item[1])
    state = f"the model {'fails' if say.fails(fit.p_before) else 'agrees'} with {rows_text(record)}"
    state = f"{state.replace('fails with', 'fails on')} ({say.chance(fit.p_before)})"
    if likely == "none" and share >= SURE and not say.fails(fit.p_before):
        return f"No missing effect is seen: {state}."
    why = f"a name needs {SURE:g}"
    if share >= SURE:
        why = f"among so many candidates one looks as good by chance with {say.chance(decided.familywise)}"
    best = f"the likeliest, {voc.explanation(likely)}, has probability {say.probability(share)}; {why}"
    return f"No effect is named: {state}. Of all explanations {best}."


def rows_text(record: Record) -> str:
    """The rows that count: all but those to be checked."""
    return "the other rows" if record.repeats else f"all {counted(record.fit.n, 'row')}"


def status(name: str, record: Record) -> str:
    """What these measurements say of one candidate."""
    said, part = acting(record.decided), record.effects.get(name)
    if name in said.sure:
        return "present"
    if name in said.either:
        others = say.joined((each for each in said.either if each != name), "or")
        return f"not told apart from {others}; one of them acts"
    if part is None or part.status == "excluded":
        return f"excluded above {plain(part.limit, 2)}" if part else "could act unseen"
    words = f"could act unseen below {plain(part.unseen_below, 2)}"
    if part.status == "better_but_not_sufficient":
        words = "better than nothing but not sufficient"
    elif part.probability > 0.5:  # likelier than not
        words = "likely, but not sure"
    elif part.status == "untestable" or not part.unseen_below < part.most:
        words = "could act unseen at any strength of the list"
    return f"{words}; not told apart from {say.joined(part.alike, 'or')}" if part.alike else words


def effect_rows(record: Record) -> Iterator[tuple[str, ...]]:
    """Candidates and mechanisms: what acts first, then by probability."""
    decided, said = record.decided, acting(record.decided)
    chances = {name: part.probability for name, part in record.effects.items()}
    chances |= {name: decided.probabilities.get(name, 0.0) for name in decided.mechanisms}
    acts = {*said.sure, *said.either}
    for name in sorted(chances, key=lambda name: (name not in acts, -chances[name])):
        part, strength, bayes = record.effects.get(name), "-", "-"
        if part is not None:
            bayes = plain(part.log_bayes_factor, 2)
            hidden = part.varies_along or (part.status == "excluded" and name not in acts)
            strength = "-" if hidden else strength_text(part)
        yield name, status(name, record), strength, say.probability(chances[name]), bayes
