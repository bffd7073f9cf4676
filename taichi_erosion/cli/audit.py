"""`audit`: what is wrong with a published table of runs."""

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import typer

from taichi_erosion.cli import output
from taichi_erosion.cli.output import AsJson

TablePath = Annotated[Path, typer.Argument(metavar="TABLE", help="Table of runs (CSV).")]
Response = Annotated[
    str | None, typer.Option(metavar="NAME", help="Column of the results; the last one if left out.")
]
ClaimsFile = Annotated[
    Path | None,
    typer.Option(
        "--claims",
        metavar="FILE",
        help="What is printed about the table (TOML); TABLE.claims.toml beside it if left out.",
    ),
]


def audit(
    table: TablePath, response: Response = None, claims: ClaimsFile = None, as_json: AsJson = False
) -> None:
    """Check a published design: orthogonality, the cell that restores it, sums of squares, target."""
    from taichi_erosion.experiments.audit.examine import as_document
    from taichi_erosion.experiments.audit.examine import audit as examine

    document = as_document(examine(table, response, claims))
    if as_json:
        output.print_json(document)
    else:
        print_audit(document)


def print_audit(document: Mapping[str, Any]) -> None:
    """The design in one line, then every finding."""
    design = document["design"] or "no named design"
    sound = {True: "yes", False: "NO"}
    typer.echo(f"{document['table']}: {document['runs']} runs, {len(document['factors'])} factors, {design}")
    typer.echo(f"balanced: {sound[document['balanced']]}, orthogonal: {sound[document['orthogonal']]}")
    if document["set_aside"]:
        typer.echo(f"set aside: {', '.join(document['set_aside'])}")
    printed = document["printed_numbers"]
    if printed["compared"]:
        typer.echo(f"printed numbers that come out: {printed['agree']} of {printed['compared']}")
        if document["cell"] is not None:
            typer.echo(f"with the cell as printed: {printed['agree_as_printed']}")
    table = output.empty_table("findings", "kind", "row", "column", "what")
    for finding in document["findings"]:
        table.add_row(finding["kind"], str(finding["row"] or ""), finding["column"], finding["sentence"])
    if document["findings"]:
        output.print_table(table)
    else:
        typer.echo("nothing found that is wrong")
