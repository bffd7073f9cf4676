"""Words on sets of effects: members that are not needed, and what sets that were not fitted could hold."""

from taichi_erosion.evidence.data.findings import NAMING, Discovery, MemberFinding
from taichi_erosion.evidence.inference import verdict_levels as levels


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
