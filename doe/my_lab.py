"""A simulator of one's own, as small as can be: the angle of a heap (docs/own_simulator.md)."""

import numpy as np

FRICTION_SHARE = 0.9  # of the tangent of the friction angle that shows as angle of repose [1]
COHESION_LENGTH = 5e-4  # diameter below which cohesion steepens a heap by more than LEAN [m]
LEAN = 4.0  # deg, by textbook cohesion at that diameter
SCATTER = 0.4  # deg, from one heap to the next


def predict(observable, conditions, parameters, effects, seeds):
    """Angles of repose [deg], one row a seed, one column a row of the table."""
    diameter = conditions["diameter"]
    angle = np.degrees(np.arctan(FRICTION_SHARE * parameters["friction"])) * np.ones_like(diameter)
    angle = angle + LEAN * effects.get("cohesion", 0.0) * COHESION_LENGTH / diameter
    angle = angle + 0.5 * effects.get("side_walls", 0.0)
    noise = [np.random.default_rng(int(seed)).normal(size=len(diameter)) for seed in seeds]
    return angle + SCATTER * np.array(noise)
