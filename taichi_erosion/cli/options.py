"""Options of several commands, and panels and examples of `--help`."""

from pathlib import Path
from typing import Annotated, Any, Literal

from typer import Option


def flag(name: str, meaning: str) -> Any:
    """An option without a value; its default is False."""
    return Option(name, help=meaning)


def value(kind: str, meaning: str, *names: str, **limits: Any) -> Any:
    """An option with a value, whose kind stands in the help; without names it is called as its parameter."""
    return Option(*names, metavar=kind, help=meaning, **limits)


File, Text, Whole = Path | None, str | None, int | None  # None where nothing is typed
AsJson = Annotated[bool, flag("--json", "Print one JSON document and nothing else.")]
EffectFiles = Annotated[
    list[Path] | None, value("FILE", "Python file with an effect of your own; may be repeated.", "--effect")
]
MeasureFiles = Annotated[
    list[Path] | None, value("FILE", "Python file with a measure of your own; may be repeated.", "--measure")
]
Force = Annotated[bool, flag("--force", "Replace files of this name that this command did not write.")]
Verbose = Annotated[bool, flag("--verbose", "Print notes, numbers and cost too.")]
Arch = Annotated[
    Literal["auto", "cpu", "cuda"] | None,
    Option(help="Device; default: cpu. auto: a graphics processor for large runs, if there is one."),
]
Decomposition = Annotated[
    Literal["partitions", "grains"] | None,
    Option(help="What one thread advances; default: partitions on cpu, grains elsewhere."),
]

SIMULATE, EXPLAIN, CHECK = "Simulate and view", "Calibrate and explain", "Check"
EXAMPLES = """
run scenes/funnel_repose.toml
run scenes/funnel_repose.toml --set contact.soil-soil.friction_rolling=0.3 --replicas 5
run scenes/funnel_repose.toml --check
run scenes/rotating_drum.toml --checkpoint drum.npz --every 0.5
sweep scenes/funnel_repose.toml --over contact.soil-soil.friction_rolling=0.1,0.3,0.5
live scenes/column_collapse.toml
live scenes/column_collapse.toml --set grains.count=300 --web
live scenes/column_collapse.toml < SCRIPT
wind --sand 0.18mm --wind 0.3,0.4,0.5
wind --sand 0.24mm --formulas
wind --sand 0.25mm --moisture 1% --table TABLE --precision 5% --out my_sand
view recordings/sample.rrd
view recordings/sample.rrd --web
view STUDY
snapshot recordings/sample.rrd -o heap.png
snapshot recordings/sample.rrd --time 0.5 --view Grains -o heap.png
export recordings/sample.rrd --vtk paraview
export RECORDING --netcdf tables --chains chains.png --time 0.5
measure repose IMAGE
measure repose IMAGE --crop 100,50,900,600 --background light
measure profile TABLE --place x --height z --diameter 2mm
doe design doe/first_calibration.toml
doe run doe/first_calibration.toml --workers 2
doe analyse doe/first_calibration.toml
doe climb doe/first_calibration.toml
doe surface doe/first_calibration.toml
doe optimise doe/first_calibration.toml
doe confirm doe/first_calibration.toml
doe calibrate doe/first_calibration.toml
doe calibrate STUDY --scheduler tcp://127.0.0.1:8786
audit doe/hao2022/table_4.csv
study new TABLE
study new TABLE --yes --closed-form --out my_study
study new TABLE --observable "Winkel=repose_angle" --condition "w=conditions.moisture"
study new TABLE --scene my_scene.toml --condition "pore volume=cm3/g" --effect pores.py
study check doe/impact_threshold_reduced.toml
compare doe/impact_threshold_reduced.toml
discover doe/impact_threshold_reduced.toml
discover STUDY --budget quick
discover STUDY --effect my_pull.py
adopt doe/impact_threshold_reduced.toml dry_cohesion
adopt STUDY my_pull --effect my_pull.py
next doe/impact_threshold_reduced.toml
predict doe/impact_threshold_reduced.toml --at doe/prediction/grains_to_come.csv
predict STUDY --at TABLE --out predicted.csv
report doe/impact_threshold_reduced.toml
report doe/funnel_soil.toml -o funnel.html
effects
effects liquid_bridge
effects new my_pull
effects new my_push --place grain
effects new my_law --from-discovery STUDY
effects my_pull --effect my_pull.py
verify V02 V05
bench
schema
schema --entry grains.clump
schema --study
"""


def command_examples(command: str) -> tuple[str, ...]:
    return tuple(line for line in EXAMPLES.split("\n") if f"{line} ".startswith(f"{command} "))


def command_help(command: str, panel: str | None = None) -> dict[str, Any]:
    """Keyword arguments of a command's registration: its examples, and its panel in the list of commands."""
    lines = "\n".join(f"  ./erosion {example}" for example in command_examples(command))
    return {"epilog": f"Examples\n\n{lines}", "rich_help_panel": panel}
