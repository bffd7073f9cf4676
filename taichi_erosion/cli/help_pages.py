"""What `--help` says beside the options: the place of a command in the list, and lines to type."""

from dataclasses import dataclass
from typing import Any

PLAY, EXPLAIN, CHECK = "Simulate and look", "Calibrate and explain", "Check"


@dataclass(frozen=True)
class Page:
    """Place of a command in the list of commands, and its examples."""

    panel: str
    examples: tuple[str, ...]


PAGES = {
    "run": Page(
        PLAY,
        (
            "run scenes/funnel_repose.toml",
            "run scenes/funnel_repose.toml --set contact.soil-soil.friction_rolling=0.3 --replicas 5",
            "run scenes/funnel_repose.toml --check",
            "run scenes/rotating_drum.toml --checkpoint drum.npz --every 0.5",
        ),
    ),
    "live": Page(
        PLAY,
        (
            "live scenes/column_collapse.toml",
            "live scenes/column_collapse.toml --set grains.count=300 --web",
            "live scenes/column_collapse.toml < ORDERS",
        ),
    ),
    "view": Page(PLAY, ("view recordings/sample.rrd", "view recordings/sample.rrd --web", "view STUDY")),
    "snapshot": Page(
        PLAY,
        (
            "snapshot recordings/sample.rrd -o heap.png",
            "snapshot recordings/sample.rrd --time 0.5 --view Grains -o heap.png",
        ),
    ),
    "export": Page(PLAY, ("export recordings/sample.rrd --vtk paraview",)),
    "measure repose": Page(
        "", ("measure repose IMAGE", "measure repose IMAGE --crop 100,50,900,600 --background light")
    ),
    "doe design": Page("", ("doe design doe/first_calibration.toml",)),
    "doe run": Page("", ("doe run doe/first_calibration.toml --workers 2",)),
    "doe analyse": Page("", ("doe analyse doe/first_calibration.toml",)),
    "doe climb": Page("", ("doe climb doe/first_calibration.toml",)),
    "doe surface": Page("", ("doe surface doe/first_calibration.toml",)),
    "doe optimise": Page("", ("doe optimise doe/first_calibration.toml",)),
    "doe confirm": Page("", ("doe confirm doe/first_calibration.toml",)),
    "doe calibrate": Page(
        "",
        ("doe calibrate doe/first_calibration.toml", "doe calibrate STUDY --scheduler tcp://127.0.0.1:8786"),
    ),
    "audit": Page(CHECK, ("audit doe/hao2022/table_4.csv", "audit TABLE --response angle --json")),
    "compare": Page(EXPLAIN, ("compare doe/impact_threshold_reduced.toml",)),
    "discover": Page(
        EXPLAIN, ("discover doe/impact_threshold_reduced.toml", "discover STUDY --budget quick")
    ),
    "adopt": Page(EXPLAIN, ("adopt doe/impact_threshold_reduced.toml dry_cohesion",)),
    "next": Page(EXPLAIN, ("next doe/impact_threshold_reduced.toml",)),
    "report": Page(
        EXPLAIN,
        (
            "report doe/impact_threshold_reduced.toml",
            "report doe/funnel_soil.toml -o funnel.html",
            "report recordings/FILE.rrd",
        ),
    ),
    "effects": Page(
        EXPLAIN,
        ("effects", "effects liquid_bridge", "effects new my_pull", "effects my_pull --effect my_pull.py"),
    ),
    "verify": Page(CHECK, ("verify V02 V05", "verify --json")),
    "bench": Page(CHECK, ("bench", "bench --json")),
    "schema": Page(CHECK, ("schema", "schema -o my_scenes/scene.schema.json")),
}


def help_of(command: str) -> dict[str, Any]:
    """Keywords with which a command is registered."""
    page = PAGES[command]
    lines = "\n".join(f"  ./erosion {example}" for example in page.examples)
    words = {"epilog": f"Examples\n\n{lines}"}
    return words | {"rich_help_panel": page.panel} if page.panel else words
