"""The discovery in sentences. "Consistent with" and "not distinguished from" are said; "caused by" never."""

from collections.abc import Mapping

from taichi_erosion.evidence.data.findings import EffectFinding, MisfitPlace, ResidualTrend
from taichi_erosion.evidence.inference.goodness_of_fit import (
    misfit_p,
    noise_table,
    probability_text,
    residuals_of,
)
from taichi_erosion.evidence.inference.levels import TOLD_CLOSEST, TOLD_RIVAL, fails
from taichi_erosion.evidence.inference.pipeline import Analysis, too_few_rows
from taichi_erosion.evidence.inference.posterior import NONE, OUTSIDE
from taichi_erosion.evidence.inference.refit import explained_share


def summary(
    found: Analysis,
    effects: Mapping[str, EffectFinding],
    where: tuple[MisfitPlace, ...],
    clues: tuple[ResidualTrend, ...],
) -> tuple[str, ...]:
    """Verdict first, then where the model fails, then what would change the conclusion."""
    sentences = [verdict_words(found, effects)]
    if found.final.names and fails(found.p_misfit_after):
        sentences.append(left_words(found))
    if found.decision.verdict == "outside_library":
        sentences += closest_words(found)
    sentences += [place.sentence for place in where if fails(place.p)]
    sentences += [clue.sentence for clue in clues]
    sentences += noise_table(found.prepared, None).sentences
    if found.seen.decoy_rank == 1 and found.decision.named:
        sentences.append(
            "Red flag: a made-up effect explains the misfit better than any named one in the screen."
        )
    sentences.append(change_words(found, effects))
    return tuple(sentences)


def left_words(found: Analysis) -> str:
    """What is named does not describe the measurements yet."""
    names, chance = " and ".join(found.final.names), probability_text(found.p_misfit_after)
    return (
        f"Even with {names} the model fails ({chance}): its law may be another than ours, or something else "
        "acts too that these candidates do not describe."
    )


def closest_words(found: Analysis) -> list[str]:
    """The explanation of the list that comes closest to what is not in it, where it comes close."""
    tried = [item for item in found.judged if item.scored.likelihoods]
    shares = [explained_share(found.prepared, found.base, item) for item in tried]
    if not shares or max(shares) < TOLD_CLOSEST:
        return []
    closest = tried[shares.index(max(shares))]
    chance = probability_text(misfit_p(residuals_of(found.prepared, closest.scored.expansion)))
    return [
        f"Of the list, {' and '.join(closest.names)} comes closest: it takes away {max(shares):.0%} of the "
        f"misfit beyond chance ({chance} of what it leaves)."
    ]


def verdict_words(found: Analysis, effects: Mapping[str, EffectFinding]) -> str:
    """One sentence for the verdict."""
    decision, probability = found.decision, found.believed.probability
    if too_few_rows(found.prepared):
        rows, numbers = found.prepared.rows.size, len(found.prepared.axes)
        return (
            f"{rows} rows of known scatter cannot decide where {numbers} numbers are calibrated; nothing is "
            f"named. Could be hiding: {', '.join(effects)}."
        )
    if decision.verdict in ("none_detected", "not_testable"):
        return silence_words(effects)
    if decision.verdict == "outside_library":
        sure = f"probability {probability[OUTSIDE]:.2g}"
        chance = f"{probability_text(found.p_misfit)} of the misfit, {found.seen.p:.2g} of the best candidate"
        return f"Something is missing and it is not in the list ({sure}; {chance})."
    if decision.verdict == "unstable":
        return "The answer changes with the seeds of the model: no name is given; more seeds are needed."
    if decision.verdict == "group":
        named = f"{' and '.join(decision.named)} is missing, and one of " if decision.named else "One of "
        group = ", ".join(name for name in decision.group if name not in decision.named)
        return f"{named}{group} is missing; these measurements do not distinguish them."
    details = "; ".join(effects[name].sentence for name in decision.named)
    return f"The misfit is consistent with a missing effect (family-wise p = {found.seen.p:.2g}): {details}."


def silence_words(effects: Mapping[str, EffectFinding]) -> str:
    """Never a bare "nothing is missing"."""
    excluded = [f"{n} above {e.strength_high:.2g}" for n, e in effects.items() if e.status == "excluded"]
    hiding = [name for name, effect in effects.items() if effect.status == "not_testable"]
    words = "No detectable effect."
    if excluded:
        words += f" Excluded: {', '.join(excluded)}."
    if hiding:
        words += f" Could be hiding, because these measurements cannot test them: {', '.join(hiding)}."
    return words


def change_words(found: Analysis, effects: Mapping[str, EffectFinding]) -> str:
    """What would change the conclusion."""
    ranked = sorted(found.believed.probability.items(), key=lambda item: -item[1])
    accepted = {*found.decision.named, *found.decision.group}
    if found.decision.verdict in ("none_detected", "not_testable"):
        accepted.add(NONE)
    if found.decision.verdict == "outside_library":
        accepted.add(OUTSIDE)
    rival = next((item for item in ranked if not accepted & set(item[0].split("+"))), None)
    if rival is None or rival[1] < TOLD_RIVAL:
        return "No other explanation is left with a probability worth naming."
    called = {NONE: "that nothing is missing", OUTSIDE: "an effect outside the library"}.get(
        rival[0], rival[0]
    )
    weak = sum(effect.status == "not_testable" for effect in effects.values())
    return (
        f"The next best explanation is {called} (probability {rival[1]:.2g}); {weak} of {len(effects)} "
        "candidates are not testable with these measurements, and data that test them could change the "
        "conclusion."
    )
