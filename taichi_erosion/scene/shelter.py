"""How much of the wind's stress reaches the ground between obstacles.

    u*_ground / u* = ((1 - m s L) (1 + m b L))^(-1/2), at most 1

with L the frontal area of the obstacles over the area of the ground [1], s their basal over their frontal
area [1], b the drag coefficient of an obstacle over that of the ground [1], m the share of the mean stress
that counts for the windiest spot [1]. Holds for m s L < 1.

Reference: Raupach, Gillette & Leys (1993), J. Geophys. Res. 98, 3023, eq. (14).
"""

from taichi_erosion.core.errors import BadInput


def sheltered_share(density: float, basal_ratio: float, drag_ratio: float, worst_spot: float) -> float:
    """Share of u* that the ground feels [1]; raises BadInput where obstacles cover all of it."""
    open_share = 1.0 - worst_spot * basal_ratio * density
    if open_share <= 0.0:
        raise BadInput(
            f"obstacles with a frontal area of {density:g} over that of the ground cover all of it"
        )
    return min((open_share * (1.0 + worst_spot * drag_ratio * density)) ** -0.5, 1.0)
