"""Words on fresh runs: whether new simulations confirm an answer, and what to do where they do not."""

from math import exp, inf

from taichi_erosion.evidence.data.fresh_findings import EmulatorGap, FreshCheck, FreshSetting
from taichi_erosion.evidence.data.number_words import counted
from taichi_erosion.evidence.data.table_units import TableUnits
from taichi_erosion.evidence.emulator.design import PLAN_SIZES
from taichi_erosion.evidence.emulator.training_runs import LARGEST
from taichi_erosion.evidence.inference import verdict_levels as levels

MOST_ODDS = 1e6  # told; beyond, "more than"


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
