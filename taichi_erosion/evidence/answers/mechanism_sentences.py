"""Mechanisms in words: what acts like what, the law of its dose, what cannot be told apart."""

from collections.abc import Sequence
from math import isnan

from taichi_erosion.evidence.data.mechanism_findings import (
    INSTRUMENT,
    OF,
    BeyondList,
    DoseLaw,
    MechanismFinding,
    StrengthTrend,
    told_members,
)
from taichi_erosion.evidence.inference.verdict_levels import p_text

MOST_TOLD = 3  # members of a group, and mechanisms that explain it worse
LEAST_ODDS, MOST_ODDS = 1.5, 1e6  # written as about equal, and as "more than"


def mechanism_sentences(found: BeyondList) -> tuple[str, ...]:
    """What acts, by which law, what else would do, what does not."""
    best = found.mechanisms[0]
    if found.named and not found.withdrawn:
        return beside_name(found)
    if found.verdict == "none":
        return none_sentences(found)
    group = titles([each for each in found.mechanisms if each.name in found.group])
    told = [withdrawn_sentence(found, best)] if found.withdrawn else []
    told.append(lead_sentence(best, group[0], alone=len(group) == 1))
    if found.law is not None:
        told.append(law_sentence(found.law))
    if len(group) > 1:
        names = " or ".join(group[1 : MOST_TOLD + 1])
        more = f" ({len(group) - 1} in all)" if len(group) > MOST_TOLD + 1 else ""
        told.append(f"Not distinguished from it by these measurements: {names}{more}.")
    worse = [each for each in found.mechanisms if each.name not in found.group][:MOST_TOLD]
    told += [worse_sentence(each) for each in worse[:1]]
    return tuple(told)


def titles(group: Sequence[MechanismFinding]) -> list[str]:
    """Members of a group in words; gain and offset of one instrument are one member."""
    own = {each.name: each.title for each in group}
    told = []
    for name in told_members(tuple(own)):
        kind, _, observable = name.partition(OF)
        told.append(
            f"a gain or an offset of the instrument of {observable}" if kind == INSTRUMENT else own[name]
        )
    return told


def trend_sentences(trend: StrengthTrend | None) -> list[str]:
    """A listed effect whose law has another power of a condition than the list."""
    if trend is None:
        return []
    along, chance = trend.condition, p_text(trend.p)
    if trend.exponent is None:
        how = f"varies along {along}"
    else:
        e = trend.exponent
        how = f"varies as {along}^{e.value:.2g} ({e.low:.2g} to {e.high:.2g})"
    share = "" if isnan(trend.share) else f", which takes {trend.share:.0%} of the rest away"
    return [
        f"{trend.effect} explains the measurements only if its strength {how}{share} (one strength for all: "
        f"{chance}): its law of {along} is then another than that of the list."
    ]


def withdrawn_sentence(found: BeyondList, best: MechanismFinding) -> str:
    """Why listed effects are no longer named."""
    names, odds = " and ".join(found.named), min(found.named_odds, MOST_ODDS)
    return (
        f"Of the list {names} comes closest, but {best.title} with a law of its own explains the measured "
        f"values better (odds {odds:.2g} : 1), so {names} is not named."
    )


def beside_name(found: BeyondList) -> tuple[str, ...]:
    """Mechanisms that explain as much as the listed effects that are named."""
    names = " and ".join(found.named)
    if found.verdict == "none":
        return (f"No mechanism with a law of its own explains the measurements better than {names}.",)
    members = [each for each in found.mechanisms if each.name in found.group]
    group = titles(members)
    acts = " or ".join(group[:MOST_TOLD])
    more = f" ({len(group)} in all)" if len(group) > MOST_TOLD else ""
    told = [f"Not distinguished from {names} by these measurements: something that acts like {acts}{more}."]
    if found.law is not None:
        told.append(f"With {members[0].title}: {law_sentence(found.law)}")
    return tuple(told)


def lead_sentence(best: MechanismFinding, title: str, alone: bool) -> str:
    """The mechanism or instrument by its title, and what the mechanism has been tested on."""
    where = f"along {best.axis}" if best.axis else "along the conditions"
    observables = (
        f"only {best.moves[0]} tells of it"
        if isnan(best.p_one_dose)
        else f"the same dose serves {', '.join(best.moves)} ({p_text(best.p_one_dose)})"
    )
    lead = "The misfit is consistent with something that acts like" if alone else "Something that acts like"
    end = "" if alone else " would explain the misfit"
    left = f"left misfit {p_text(best.p_left)}"
    return f"{lead} {title}{end}: its dose varies {where}, {observables}; {left}."


def law_sentence(law: DoseLaw) -> str:
    """The law of the dose with its exponents and how well it predicts."""
    told = f"Its dose follows {law.expression}"
    if law.exponents:
        powers = [f"{name}^{e.value:.2g} ({e.low:.2g} to {e.high:.2g})" for name, e in law.exponents.items()]
        told += f", growing as {' '.join(powers)}" if law.form != "onset" else f", exponent {powers[0]}"
    if not isnan(law.held_out_share):
        told += f"; it explains {max(law.held_out_share, 0.0):.0%} of the misfit of left-out groups"
    return told + "."


def worse_sentence(other: MechanismFinding) -> str:
    """A mechanism that explains the misfit worse, and why."""
    if other.odds > MOST_ODDS:
        odds = f"odds less than 1 : {MOST_ODDS:.0e}"
    else:
        odds = (
            f"odds 1 : {other.odds:.2g}"
            if other.odds > LEAST_ODDS
            else "about as likely, but it fails a test"
        )
    return f"{other.title.capitalize()} explains it worse ({odds}; left misfit {p_text(other.p_left)})."


def none_sentences(found: BeyondList) -> tuple[str, ...]:
    """No mechanism explains all observables."""
    best = found.mechanisms[0]
    told = "No single mechanism explains the misfit of all observables with one dose"
    return (f"{told}; {best.title} comes closest (left misfit {p_text(best.p_left)}).",)
