"""What acts, in words: headline, statuses of the candidates, laws.

Headline, table and last line take the same names from `acting`, so that they cannot contradict each other.
"""

from collections.abc import Iterator

from taichi_erosion.evidence.data.number_words import plain
from taichi_erosion.evidence.race.priors import SURE
from taichi_erosion.evidence.race.record import Decided, EffectPart, LawPart, Record
from taichi_erosion.evidence.words import data_words
from taichi_erosion.evidence.words import vocabulary as say

ONE_LESS = " minus one"  # of what a dose counts
LIKELY = 0.5  # probability above which an effect acts rather than not


def acting(decided: Decided) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """What acts for sure, and of what one does; nothing where new runs of the scene change the answer."""
    if decided.verdict == "unstable":
        return (), ()
    sure, either = (decided.mechanisms, ()) if len(decided.mechanisms) == 1 else ((), decided.mechanisms)
    return (*decided.named, *sure), (*decided.group, *either)


def headline(record: Record, voc: say.Vocabulary) -> str:
    """The answer of `discover` in one sentence."""
    decided = record.decided
    sure, either = ([acting_text(name, record, voc) for name in names] for names in acting(decided))
    if sure or either:
        words = say.joined([*sure, f"either {say.joined(either, 'or')}"] if either else sure)
        open_ = "; these measurements do not tell which" if either else ""
        return f"Missing: {words}{open_}.{' Not in the list of effects.' if decided.mechanisms else ''}"
    if decided.verdict == "outside_library":
        chance = say.probability(decided.probabilities["outside_library"])
        return (
            f"Missing: something not in the list; no listed effect explains the data (probability {chance})."
        )
    return silence(record, voc)


def acting_text(name: str, record: Record, voc: say.Vocabulary) -> str:
    """An effect or mechanism with its law, or its strength."""
    law, part, title = record.law, record.effects.get(name), voc.titled(name)
    if law is not None and law.mechanism == name:
        return f"{title} with the law {law_text(law, voc)}"
    if part is not None and part.varies_along:
        return f"{title} with a strength that varies along {part.varies_along}"
    if part is None or name not in record.decided.named:
        return title
    return f"{title} with strength {strength_text(part)}"


def strength_text(part: EffectPart) -> str:
    """Strength with its interval; that it reaches the end of the list."""
    limit = f", at the limit of the list, {plain(part.most, 2)}" if part.strength.high >= part.most else ""
    return f"{say.interval(part.strength)}{limit}"


def law_text(law: LawPart, voc: say.Vocabulary) -> str:
    """`factor = 1 + 0.8 (moisture / 5 %)^1.2`, in the units of the table."""
    written = {name: plain(number.value, 2) for name, number in law.numbers.items()}
    written |= {name: voc.units.size_text(*size) for name, size in law.sizes.items()}
    text = (law.template or law.expression).format(**written)
    counts = voc.doses.get(law.mechanism.partition(":")[0], "strength")
    if counts.endswith(ONE_LESS):
        counts, text = counts.removesuffix(ONE_LESS), f"1 + {text}".replace("+ -", "- ")
    return f"{counts} = {text}"


def law_line(record: Record) -> str:
    """How well the law of what acts is known."""
    law, (sure, either) = record.law, acting(record.decided)
    if law is None or law.mechanism not in (*sure, *either):
        return ""
    free = [f"the exponent of {name} is {say.interval(power)}; " for name, power in law.exponents.items()]
    share = f"{100.0 * law.held_out_share:.0f} % of the misfit at conditions left out of its fit"
    return f"Law: {''.join(free)}it explains {share}."


def silence(record: Record, voc: say.Vocabulary) -> str:
    """The answer where nothing is named."""
    decided, fit = record.decided, record.fit
    if decided.verdict == "unstable":
        names = say.joined(map(voc.titled, (*decided.named, *decided.group)), "or")
        return f"No effect is named: new runs of the scene change the answer. Candidates: {names}."
    if not data_words.testable(record):
        return "No effect is named before the errors above are mended."
    likely, share = max(decided.probabilities.items(), key=lambda item: item[1])
    failing = fit.p_before < say.ADEQUATE
    rows, chance = data_words.rows_text(record), say.chance(fit.p_before)
    state = f"the model {'fails on' if failing else 'agrees with'} {rows} ({chance})"
    if likely == "none" and (not failing or share >= SURE):
        common = " by errors of measurement" * failing
        none = f"probability that none acts: {say.probability(share)}"
        return f"No missing effect is seen: {state}{common}; {none}."
    why = f"a name needs {SURE:g}"
    if share >= SURE:
        why = f"among so many candidates one looks as good by chance with {say.chance(decided.familywise)}"
    best = f"the likeliest, {voc.explanation(likely)} alone, has probability {say.probability(share)}; {why}"
    return f"No effect is named: {state}. Of all explanations {best}."


def status(name: str, record: Record) -> str:
    """What these measurements say of one candidate."""
    sure, either = acting(record.decided)
    if name in sure:
        return "present"
    if name in either:
        return f"not told apart from {say.joined((n for n in either if n != name), 'or')}; one of them acts"
    part = record.effects[name]
    if part.status == "excluded":
        return f"excluded above {plain(part.limit, 2)}"
    words = f"could act unseen below {plain(part.unseen_below, 2)}"
    if part.status == "better_but_not_sufficient":
        words = "better than nothing but not sufficient"
    elif part.probability > LIKELY:
        words = "likely, but not sure"
    elif part.status == "untestable" or not part.unseen_below < part.most:
        words = "these measurements cannot see it"
    return f"{words}; not told apart from {say.joined(part.alike, 'or')}" if part.alike else words


def effect_rows(record: Record) -> Iterator[tuple[str, ...]]:
    """Candidates and mechanisms: what acts first, then by probability; a strength where it likely acts."""
    acts = [name for names in acting(record.decided) for name in names]
    chances = {name: record.decided.probabilities.get(name, 0.0) for name in acts}
    chances |= {name: part.probability for name, part in record.effects.items()}
    for name in sorted(chances, key=lambda name: (name not in acts, -chances[name])):
        part = record.effects.get(name)
        hidden = part is None or part.varies_along or (name not in acts and part.probability < LIKELY)
        strength = "-" if hidden or part is None else strength_text(part)
        yield name, status(name, record), strength, say.probability(chances[name])
