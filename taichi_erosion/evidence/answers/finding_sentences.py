"""Sentences on findings: effect sets, mechanisms, fresh runs, experiments that tell explanations apart."""

from collections.abc import Mapping, Sequence
from math import exp, inf, isnan

from taichi_erosion.evidence.data.findings import NAMING, OUTSIDE, Discovery, MemberFinding
from taichi_erosion.evidence.data.fresh_findings import EmulatorGap, FreshCheck, FreshSetting
from taichi_erosion.evidence.data.mechanism_findings import (
    INSTRUMENT,
    OF,
    BeyondList,
    DoseLaw,
    MechanismFinding,
    StrengthTrend,
    told_members,
)
from taichi_erosion.evidence.data.number_words import counted
from taichi_erosion.evidence.data.table_units import TableUnits
from taichi_erosion.evidence.emulator.design import PLAN_SIZES
from taichi_erosion.evidence.emulator.training_runs import LARGEST
from taichi_erosion.evidence.inference import verdict_levels as levels
from taichi_erosion.evidence.inference.posterior import label
from taichi_erosion.evidence.inference.verdict_levels import p_text

MOST_TOLD = 3  # members of a group, and mechanisms that explain it worse
LEAST_ODDS, MOST_ODDS = 1.5, 1e6  # written as about equal, and as "more than"
UNPREDICTED = (
    "Something outside the list is likelier than any rival; it predicts nothing, so that no experiment "
    "can be planned against it."
)
REMEDIES = "wider ranges, another observable, or a separate measurement of a calibrated number would."


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


def set_sentences(found: Discovery) -> list[str]:
    """Members that the measurements do not need, and the probability of sets that were not fitted."""
    kept = {*found.named, *found.group}
    told = [member_sentence(each) for each in found.members if not each.needed and each.name not in kept]
    if found.probability_unvisited >= levels.UNVISITED and found.verdict in NAMING:
        told.append(
            "Sets of effects that were not fitted hold an estimated probability of "
            f"{found.probability_unvisited:.2g}; the probabilities told leave them out."
        )
    return told


def member_sentence(member: MemberFinding) -> str:
    """Why a member of a set is not told as sure."""
    return (
        f"{member.name} beside {', '.join(member.beside)} is not needed: if these lack nothing, the best of "
        f"all other effects gains as much by chance ({levels.p_text(member.p)}, family-wise)."
    )


def separation_sentence(leader: str, chances: Mapping[str, float], separated: Sequence[str]) -> str:
    """Which rivals the experiments tell from the leader, and which no measurement does."""
    alike = [spoken(name) for name in chances if name not in separated]
    words = ""
    if separated:
        each = ", ".join(f"{spoken(name)} ({chances[name]:.0%})" for name in separated)
        words = (
            f"To tell {spoken(leader)} from {each}; in brackets, the chance that all of them together decide."
        )
    if alike:
        words += f" Nothing that can be measured within the stated ranges tells {spoken(leader)} from "
        words += f"{', '.join(alike)}: {REMEDIES}"
    return words.strip()


def scatter_sentence(leader: str, rivals: Sequence[str]) -> str:
    """Rivals that predict what the leader predicts, with another uncertainty."""
    if not rivals:
        return ""
    others = ", ".join(map(spoken, rivals))
    verbs = ("predicts", "differs") if len(rivals) == 1 else ("predict", "differ")
    words = (
        f"Beside {spoken(leader)}, {others} {verbs[0]} the same values and {verbs[1]} in uncertainty alone"
    )
    return f"{words}: no measurement is proposed for that."


def spoken(name: str) -> str:
    """An explanation as a sentence names it."""
    return "nothing missing" if name == label(()) else name.replace("+", " with ")


def alone_sentence(weights: Mapping[str, float], found: Discovery) -> str:
    """Sentence where fewer than two explanations are left."""
    outside = found.probabilities.get(OUTSIDE, 0.0)
    if not weights or outside > max(weights.values()):
        return UNPREDICTED
    (name,) = weights
    words = f"One explanation is left: {spoken(name)} (probability {found.probabilities.get(name, 1.0):.2g})."
    return f"{words} There is nothing to tell it from."


def fresh_words(check: FreshCheck, units: TableUnits) -> str:
    """What fresh runs say about an answer."""
    if check.outcome == "not_made":
        return (
            f"The answer was not tested by new simulations: its {check.needed} runs are more than the budget "
            "of the study has left; raise `runs` under [budget]."
        )
    head = (
        f"Tested by {counted(check.runs, 'new simulation')} at the fitted numbers, {check.seeds} for each "
        f"set of conditions, which no fit has used: {misfits(check.settings)}."
    )
    if check.outcome == "contradicted":
        return f"{head} {against(check, units)}"
    if check.outcome == "confirmed":
        return f"{head} They bear the answer out ({odds_words(check.settings)})."
    if check.failed > 0.5 * check.runs:
        return f"{head} {check.failed} of them have no value, so they decide nothing."
    more = " `--budget full` makes more." if check.seeds < PLAN_SIZES[LARGEST].fresh else ""
    return f"{head} They are too few, or scatter too much, to bear the answer out or to contradict it.{more}"


def misfits(settings: tuple[FreshSetting, ...]) -> str:
    """Misfit per row of every explanation, simulated and as the emulator has it."""
    told = [
        f"{chi(each.chi2_per_row_simulated)} {name_of(each)} (emulator {chi(each.chi2_per_row_emulated)})"
        for each in settings
    ]
    return f"the misfit per row is {', '.join(told)}"


def chi(value: float) -> str:
    """A misfit per row."""
    return f"{value:.2g}" if value < 100.0 else f"{value:.0f}"


def name_of(setting: FreshSetting) -> str:
    """An explanation beside others."""
    if setting.role == "bare":
        return "with nothing added"
    names = " and ".join(setting.effects)
    return f"with {names}" if setting.role == "told" else f"with {names} instead"


def odds_words(settings: tuple[FreshSetting, ...]) -> str:
    """Odds of what is told over the others by these simulations alone."""
    told = []
    for each in settings:
        if each.role != "told":
            odds = exp(each.log_odds_simulated) if each.log_odds_simulated < 700.0 else inf
            told.append(f"{odds_text(odds)} over {over(each)}")
    return f"odds {', '.join(told)}"


def odds_text(odds: float) -> str:
    """Odds as people write them."""
    return f"more than {MOST_ODDS:.0e} to 1".replace("e+0", "e") if odds > MOST_ODDS else f"{odds:.2g} to 1"


def over(setting: FreshSetting) -> str:
    """An explanation that another one beats."""
    return "the model with nothing added" if setting.role == "bare" else " and ".join(setting.effects)


def against(check: FreshCheck, units: TableUnits) -> str:
    """Why fresh runs contradict an answer."""
    told = []
    for each in check.settings:
        if each.gap is not None and each.gap.p < levels.EMULATOR_LEVEL:
            told.append(gap_words(each, each.gap, units))
    for each in check.settings:
        if each.role != "told" and each.log_odds_simulated < 0.0 < each.log_odds_emulated:
            told.append(
                f"Simulated, {over(each)} explains the measurements better than "
                f"{' and '.join(check.settings[0].effects)}."
            )
        elif each.role != "told" and lost(each):
            told.append(
                f"Simulated, the odds of {' and '.join(check.settings[0].effects)} over {over(each)} are "
                f"only {odds_text(exp(each.log_odds_simulated))}."
            )
    return " ".join(told)


def lost(setting: FreshSetting) -> bool:
    """Whether simulated odds fall below those of a name that the emulator, and a fair test, had reached."""
    needed = levels.least_odds(setting.role == "bare")
    ends = (setting.log_odds_emulated, setting.log_odds_expected)
    return exp(min(setting.log_odds_simulated, 700.0)) < needed <= exp(min(*ends, 700.0))


def gap_words(setting: FreshSetting, gap: EmulatorGap, units: TableUnits) -> str:
    """Where the emulator lies off, in the units of the table."""
    at = units.setting_text(gap.conditions)
    name = "with nothing added" if setting.role == "bare" else f"with {' and '.join(setting.effects)}"
    simulated, emulated = (
        f"{units.value_text(gap.observable, value)} (sd {units.value_text(gap.observable, sd, 2)})"
        for value, sd in ((gap.simulated, gap.simulated_sd), (gap.emulated, gap.emulated_sd))
    )
    return (
        f"The emulator is off {name} by more than it states: {gap.observable}{f' at {at}' if at else ''} is "
        f"simulated {simulated}, emulated {emulated} ({levels.p_text(gap.p)})."
    )


def unstable_words(check: FreshCheck | None) -> str:
    """The verdict where an answer changes with the runs of the model."""
    if check is None or check.outcome != "contradicted":
        return "The answer changes with the seeds of the model: no name is given; more seeds are needed."
    names = " and ".join(check.settings[0].effects)
    words = (
        f"An emulator of the training runs named {names}; new simulations contradict it: no name is given."
    )
    if check.more_runs:
        return f"{words} `discover` again makes {check.more_runs} more runs about these explanations first."
    return f"{words} More runs are needed: raise `runs` under [budget], then `discover` again."
