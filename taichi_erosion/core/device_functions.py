"""Functions of device code: the nearest image in a periodic box."""

from taichi_erosion.core.ti import ti


@ti.func
def nearest_image(difference, period):
    """Shortest vector between two positions of a periodic box [m]."""
    nearest = difference
    for k in ti.static(range(3)):
        if period[k] > 0.0:
            nearest[k] -= period[k] * ti.round(difference[k] / period[k])
    return nearest
