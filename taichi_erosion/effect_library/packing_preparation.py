"""Packing preparation: a tapped bed is denser than one that was poured.

    taps: strength V sqrt(g d) upwards for a time T sqrt(d / g), then back; a rest of n T sqrt(d / g) follows

with V the speed of all walls over that of a fall through half a diameter, T the duration of the stroke over
the time of such a fall and n the length of the rest in strokes [1]; d is the nominal diameter [m], g
gravity [m s-2]. The taps come between the first stage and the second, where most scenes have settled their
grains and not yet begun the test. Strength multiplies the speed: at 1 a tap throws the grains about half a
diameter, as laboratories do. Walls return to their places. Holds for taps of up to a few diameters.

Reference: Knight, Fandrich, Lau, Jaeger & Nagel (1995), Phys. Rev. E 51, 3957 (compaction by taps); Rumpf
(1990), Particle Technology, ch. 2 (packing and strength).
"""

from dataclasses import dataclass

from taichi_erosion.core.effect import Check, Checks, Conditions, Probe, effect_of, quantity
from taichi_erosion.scene import Scene
from taichi_erosion.scene.change import sample_scene
from taichi_erosion.scene.preparation.sizes import nominal_diameter
from taichi_erosion.scene.schema.scene import Movement, Stage


@dataclass(frozen=True)
class Params:
    taps: float = quantity(5.0, "1", "number of taps, rounded", low=1.0, high=1000.0)
    speed: float = quantity(1.0, "1", "of the walls over sqrt(g d)", low=0.0, high=10.0)
    stroke: float = quantity(0.5, "1", "duration of a stroke over sqrt(d / g)", low=0.05, high=10.0)
    rest: float = quantity(10.0, "1", "rest after a tap, in strokes", low=0.0, high=1000.0)


def change(params: Params, strength: float, conditions: Conditions, scene: Scene) -> Scene:
    """The scene with taps after its first stage."""
    diameter = nominal_diameter(scene.grains)
    gravity = scene.gravity.magnitude
    speed = strength * params.speed * (gravity * diameter) ** 0.5
    if speed == 0.0:
        return scene
    stroke = params.stroke * (diameter / gravity) ** 0.5
    standing = [name for name in scene.geometry if name not in scene.stages[0].remove]

    def moving_stage(name: str, velocity: float, duration: float) -> Stage:
        orders = {wall: Movement(velocity=(0.0, 0.0, velocity)) for wall in standing}
        return Stage(name=name, until="time", duration_max=duration, remove=(), move=orders)

    taps: list[Stage] = []
    for k in range(round(params.taps)):
        taps += [moving_stage(f"tap{k}_up", speed, stroke), moving_stage(f"tap{k}_down", -speed, stroke)]
        taps.append(moving_stage(f"tap{k}_rest", 0.0, max(params.rest * stroke, stroke)))
    return scene.model_copy(update={"stages": (scene.stages[0], *taps, *scene.stages[1:])})


def checks(probe: Probe) -> Checks:
    tapping = Params(taps=20.0, speed=0.5, stroke=2.0, rest=4.0)
    scene = sample_scene(gravity={"magnitude": 10.0})  # sqrt(g d) = 0.1 m/s, sqrt(d / g) = 0.01 s
    stages = probe(tapping, {}, scene=scene, strength=2.0).stages
    first, back, rest = stages[1:4]
    yield Check("twenty taps of three stages each", len(stages), 2 + 3 * 20)
    yield Check("walls rise at strength V sqrt(g d)", first.move["plate"].velocity[2], 0.1)
    yield Check("and come back", back.move["tube"].velocity[2], -0.1)
    yield Check("a stroke lasts T sqrt(d / g)", first.duration_max, 0.02)
    yield Check("a rest n strokes", rest.duration_max, 0.08)
    yield Check("during which nothing moves", rest.move["plate"].velocity[2], 0.0)


EFFECT = effect_of(
    __name__, "tapped instead of poured packing", "scene", change, expected={"repose_angle": 1}
)
