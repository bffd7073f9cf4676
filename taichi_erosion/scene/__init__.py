"""Scene files: schema, validation, and the setup of each replica."""

from taichi_erosion.scene.load import load_scene, parse_scene, scene_hash
from taichi_erosion.scene.paths import scene_schema, write_schema
from taichi_erosion.scene.preparation.limits import step_report
from taichi_erosion.scene.preparation.setup import laws, replica_setup
from taichi_erosion.scene.schema.fields import resolve
from taichi_erosion.scene.schema.scene import Scene
