"""Command `wind`: thresholds and flux of one's own sand, simulated beside published formulas."""

import json
from math import inf
from pathlib import Path
from typing import Annotated, Literal

import typer
from typer import Option

from taichi_erosion.cli import output
from taichi_erosion.cli.options import SIMULATE, AsJson, File, Force, Text, command_help, flag, value
from taichi_erosion.cli.progress import announce, progress_report
from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.files import write_atomic

app = typer.Typer()
Precise = Literal["fluid_threshold", "impact_threshold", "threshold_ratio", "threshold_ratio_linear"]


@app.command("wind", **command_help("wind", SIMULATE))
def survey_wind(
    sand: Annotated[str, value("DIAMETER", "Diameter of the grains, such as 0.18mm.")],
    wind: Annotated[
        Text, value("U*,...", "Friction velocities in m/s; default: of the table, or three.")
    ] = None,
    moisture: Annotated[str, Option(help="Mass of water over that of solid, such as 1%.")] = "0%",
    density: Annotated[str, Option(help="Density of the grains.")] = "2650kg/m3",
    table: Annotated[File, value("FILE", "Measured fluxes by u*.", exists=True)] = None,
    beds: Annotated[int, Option(min=1, max=1000, help="Beds, each packed anew.")] = 3,
    precision: Annotated[Text, value("SHARE", "Add beds until --of is known to 5%.")] = None,
    of: Annotated[Precise, Option(help="What is to be known; its 95 % interval counts.")] = "fluid_threshold",
    out: Annotated[File, value("FOLDER", "Default: wind-DIAMETER.")] = None,
    formulas: Annotated[bool, flag("--formulas", "Print the formulas; simulate nothing.")] = False,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Simulate both thresholds and the flux of your own sand, beside the formulas and your measurements."""
    from taichi_erosion.core.setup import usable_cores
    from taichi_erosion.measures.wind_formulas import Sand
    from taichi_erosion.tables.cell_numbers import stated_number
    from taichi_erosion.wind import survey as surveys
    from taichi_erosion.wind import words

    diameter = stated_number(sand, "m", "--sand", "0.18mm")
    grains = Sand(diameter, stated_number(density, "kg/m3", "--density", "2650kg/m3"))
    water = stated_number(moisture, "1", "--moisture", "1%")
    rows = surveys.flux_by_wind(table) if table else ()
    share = stated_number(precision, "1", "--precision", "5%") if precision else inf
    if precision and not 0.0 < share < 1.0:
        raise BadInput(f"--precision {precision}: write a share below 100 %, such as 5%")
    survey = surveys.Survey(grains, surveys.survey_winds(wind, grains, rows), water, beds, rows, share, of)
    folder, runs = out or Path(f"wind-{1e3 * diameter:g}mm"), {}
    files = [] if formulas else [folder / "wind.json", folder / "wind.png"]
    if files:
        announce(f"{beds} beds, {len(survey.winds)} winds: {words.survey_cost_text(survey, usable_cores())}")
        announce(words.formula_line(surveys.survey_document(survey, {}, ())))
        with progress_report("wind") as progress:
            for name, document in surveys.run_survey(survey, folder, force, progress):
                runs[name] = document
                announce(f"{words.run_result_line(name, document)} after {document['wall_s']:.0f} s")
    answer = surveys.survey_document(survey, runs, files)
    if files:
        from taichi_erosion.measures.result import json_value, nan_to_none
        from taichi_erosion.report.pictures import survey_picture

        write_atomic(files[0], json.dumps(nan_to_none(answer), indent=1, default=json_value).encode() + b"\n")
        write_atomic(files[1], survey_picture(answer))
    output.print_result(answer, as_json, print_survey)


def print_survey(document: output.Record) -> None:
    """Print thresholds and fluxes, comparisons, warnings and the files."""
    from taichi_erosion.wind import words

    for table in (words.threshold_table(document), words.flux_table(document)):
        output.print_table(table.title, table.columns, table.rows)
    output.print_lines(words.survey_notes(document))
    output.print_lines(document["written"], "written: ")
