"""Page of a calibration: README.md with figures in the study's folder, the same as HTML, and a recording."""

import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from jinja2 import Environment, PackageLoader, StrictUndefined
from markdown_it import MarkdownIt
from matplotlib.figure import Figure

from taichi_erosion.campaign.calibration import PAGE, PICTURES, Calibration
from taichi_erosion.campaign.calibration_steps import STAGES
from taichi_erosion.campaign.study_file import CalibrationStudy, read_calibration_study
from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.files import ListedFolder
from taichi_erosion.experiments.confirm import SIGNIFICANCE
from taichi_erosion.recording.study_recording import RecordedRun, StudyPage, record_study
from taichi_erosion.report import design_figures as figures
from taichi_erosion.report.figure_style import as_png
from taichi_erosion.report.html import origin_line, picture_address, write_page
from taichi_erosion.tables.number_words import markdown_table, round_to_scatter, value_and_sd_text

Row = Mapping[str, Any]
Cells = tuple[Sequence[str], Sequence[Sequence[str]]]  # header and rows of a table

PAGE_TEMPLATE, TEMPLATE = "calibration.md", "calibration.html"
RECORDING = "study.rrd"
LEAST_POWER = 0.5  # of a yes: below it a test more often misses a difference that matters than sees it [1]
OPTIMA = 5  # listed on the page
VARIANCE = ("sum_of_squares", "df", "mean_square", "f", "p")
POWER = (
    "The test sees a difference of {seen} {unit} with a power of 0.8, and one of {resolved} {unit} with a "
    "power of {power:.2f}."
)
VERDICTS = {
    "Yes.": "In the calibrated scene {name} agrees with the measurement (difference {far}). {power}",
    "No.": "In the calibrated scene {name} differs from the measurement (by {far}). {power} Another range of "
    "the surface (surface_half in [design]), then the same command, may come nearer; where none does, "
    "another number or an effect is missing.",
    "Not refuted.": "In the calibrated scene no difference of {name} from the measurement is told ({far}), "
    "but the test would more often miss one than see it. {power} More confirmation runs would tell.",
    "Not known.": "The confirmation runs of {name} do not scatter, so no test is possible.",
}
PICTURE = re.compile(r'<img src="([^":]+)"')
HEADING = re.compile("<h2>(.+?)</h2>")
VERDICT = re.compile(r"<p><strong>(Yes|No|Not \w+)\.</strong>")
RESOLUTION = 130  # of pictures [dots per inch]
MOST_RUNS = 9  # recorded runs side by side


def write_page_and_pictures(calibration: Calibration) -> Path:
    """Write page and pictures into the folder of a completed study."""
    folder = ListedFolder(calibration.file.folder)
    for name, figure in page_figures(calibration):
        folder.write_file(f"{PICTURES}/{name}.png", as_png(figure, RESOLUTION))
    pages = Environment(loader=PackageLoader("taichi_erosion.report"), undefined=StrictUndefined)
    assert calibration.surface is not None
    document, study, runs = calibration.document, calibration.file.study, calibration.surface.design
    targets, tests = study.targets, document["confirm"]["tests"]
    names = {"box_behnken": "Box-Behnken design", "latin_hypercube": "Latin hypercube"}
    design = names.get(study.design.surface, f"Central composite design ({study.design.surface_axial})")
    text = pages.get_template(PAGE_TEMPLATE).render(
        file=calibration.file,
        study=study,
        document=document,
        leading=next(iter(targets)),
        design=f"{design} of {len(runs)} runs, {runs.kinds.count('centre')} of them at the centre",
        verdicts={name: agreement_text(tests[name], name, target.unit) for name, target in targets.items()},
        scenes=[Path(path).name for path in document.get("calibrated_scenes", [])],
        scatter=round_to_scatter,
        symbols=parameter_symbols(calibration),
        kept=", ".join(calibration.file.labels[path] for path in document["analyse"]["kept"]),
        effects={name: markdown_table(*effect_table(calibration, name)) for name in targets},
        climb=markdown_table(*climb_table(calibration)),
        variance={name: markdown_table(*variance_table(calibration, name)) for name in targets},
        equations={name: natural_equation(calibration, name) for name in targets},
        optima=markdown_table(*optimum_table(calibration)),
        samples={name: confirmation_mean_sd_texts(tests[name]) for name in targets},
    )
    return folder.write_file(PAGE, (text.rstrip() + "\n").encode())


def page_figures(calibration: Calibration) -> Iterator[tuple[str, Figure]]:
    assert calibration.climb is not None
    assert calibration.surface is not None
    document, names, targets = calibration.document, calibration.file.labels, calibration.file.study.targets
    analysed, best = document["analyse"], document["optimise"]["optima"][0]
    for name, target in targets.items():
        fit, unit = calibration.surface.fits[name], target.unit
        at = np.array([(best["settings"][f.path] - f.centre) / f.half_range for f in fit.factors])
        yield f"effects_{name}", figures.effect_figure(analysed["responses"][name], analysed["kept"], unit)
        yield f"surface_{name}", figures.contour_figure(fit, names, unit, at, target.value)
        yield f"residuals_{name}", figures.residual_figure(fit, calibration.surface.design.run_order)
        values, predicted = document["confirm"]["values"][name], best["predicted"][name]
        yield f"confirm_{name}", figures.confirmation_figure(values, name, target, predicted)
    name, target = next(iter(targets.items()))
    yield f"climb_{name}", figures.climb_curve(calibration.climb.design, name, calibration.climb.best, target)


def effect_table(calibration: Calibration, name: str) -> Cells:
    """Effects, largest first, with the published values where the study has any."""
    parameters = calibration.file.study.parameters
    screened = calibration.document["analyse"]["responses"][name]
    rows = []
    for effect in screened["effects"]:
        entry, t = parameters[effect["name"]], effect["t"]
        # the scatter of single runs where the screening has no t
        error = abs(effect["value"] / t) if t == t and t != 0.0 else screened["quality"]["sd"]
        limits = f"{entry.low:g} to {entry.high:g} {'' if entry.unit == '1' else entry.unit}".rstrip()
        value = round_to_scatter(effect["value"], error, with_sign=True)
        label = f"{effect['label']} {entry.symbol}".strip()
        rows.append((label, limits, value, f"{effect['p']:.2g}", entry.published))
    unit = calibration.file.study.targets[name].unit
    header = ("parameter", "range", f"effect [{unit}]", "p", "published")
    count = len(header) if any(entry.published for entry in parameters.values()) else len(header) - 1
    return header[:count], [row[:count] for row in rows]


def agreement_text(test: Mapping[str, Any], name: str, unit: str) -> str:
    """Yes or no to the question whether the calibrated scene reproduces the measurement, with the power."""
    answer = "Yes."
    if test["p"] != test["p"]:
        answer = "Not known."
    elif test["p"] < SIGNIFICANCE:
        answer = "No."
    elif test["power"] < LEAST_POWER:
        answer = "Not refuted."
    keys = ("difference", "detectable", "resolve")
    difference, detectable, resolved = (round_to_scatter(test[key], test["runs"]["sd"]) for key in keys)
    power = POWER.format(seen=detectable, resolved=resolved, unit=unit, power=test["power"])
    far = f"{difference} {unit}, p = {test['p']:.2g}"
    return f"**{answer}** {VERDICTS[answer].format(name=name, far=far, power=power)}"


def climb_table(calibration: Calibration) -> Cells:
    document = calibration.document["climb"]
    paths, names = (list(document["rows"][0][key]) for key in ("settings", "responses"))
    rows = []
    for step, row in enumerate(document["rows"]):
        mark = " (nearest)" if step == document["best"] - 1 else ""
        values = [row["settings"][path] for path in paths] + [row["responses"][name] for name in names]
        rows.append((f"{step}{mark}", *(four_digit_text(value) for value in values)))
    return ("step", *(calibration.file.labels[path] for path in paths), *names), rows


def four_digit_text(value: float) -> str:
    """Number in four digits; "none" for NaN."""
    return "none" if value != value else f"{value:.4g}"


def variance_table(calibration: Calibration, name: str) -> Cells:
    anova = calibration.document["surface"]["responses"][name]["anova"]
    rows = [(row["label"], *(four_digit_text(row[key]) for key in VARIANCE)) for row in anova]
    return ("source", "sum of squares", "df", "mean square", "F", "p"), rows


def natural_equation(calibration: Calibration, name: str) -> str:
    """Equation in natural units, with the publication's symbols where the study names them."""
    text = calibration.document["surface"]["responses"][name]["natural_reduced"]
    for path, symbol in sorted(parameter_symbols(calibration).items(), key=lambda each: -len(each[0])):
        text = text.replace(path, symbol)
    return text.replace("*", " \N{MIDDLE DOT} ").replace("^2", "\N{SUPERSCRIPT TWO}")


def parameter_symbols(calibration: Calibration) -> dict[str, str]:
    """Letters of the parameters in the equations; those of a publication, else x1, x2, ..."""
    assert calibration.surface is not None
    paths = [factor.path for factor in calibration.surface.design.factors]
    parameters = calibration.file.study.parameters
    return {path: parameters[path].symbol or f"x{place}" for place, path in enumerate(paths, 1)}


def optimum_table(calibration: Calibration) -> Cells:
    """Settings that reach the target, the narrowest prediction interval first."""
    optima = calibration.document["optimise"]["optima"][:OPTIMA]
    targets = list(calibration.file.study.targets)
    paths = list(optima[0]["settings"])
    rows = []
    for one in optima:
        row = [four_digit_text(one["settings"][path]) for path in paths]
        for predicted in (one["predicted"][name] for name in targets):
            half = 0.5 * (predicted["high"] - predicted["low"])  # as many digits as the interval deserves
            value, low, high = (round_to_scatter(predicted[key], half) for key in ("value", "low", "high"))
            row.append(f"{value} ({low} to {high})")
        rows.append(row)
    header = (*(calibration.file.labels[path] for path in paths), *(f"{name}, predicted" for name in targets))
    return header, rows


def confirmation_mean_sd_texts(test: Mapping[str, Any]) -> dict[str, str]:
    """Mean, standard deviation and number of the confirmation runs and of the measurement."""
    samples = {kind: test[kind] for kind in ("runs", "wanted")}
    return {k: value_and_sd_text(s["mean"], s["sd"], int(s["n"])) for k, s in samples.items()}


def read_finished_calibration(study: Path) -> CalibrationStudy:
    """Study whose page and table of runs exist. Raises BadInput where the calibration is not finished."""
    file = read_calibration_study(study)
    if not (file.folder / PAGE).is_file() or not (file.folder / "runs.csv").is_file():
        raise BadInput(f"{study}: not calibrated yet; run doe calibrate on it first")
    return file


def write_report(study: Path, to: Path | None = None, force: bool = False) -> Path:
    """Write the HTML page of a calibration. Raises BadInput where the calibration is not finished."""
    file = read_finished_calibration(study)
    title, _, text = (file.folder / PAGE).read_text(encoding="utf-8").partition("\n")
    body = MarkdownIt("commonmark", {"html": False}).enable("table").render(text)
    body = PICTURE.sub(lambda match: f'<img src="{picture_address(file.folder / match[1])}"', body)
    body = body.replace("<table>", '<div class="scroll"><table>').replace("</table>", "</table></div>")
    body = VERDICT.sub(r'<p class="verdict"><strong>\1.</strong>', body)
    sections = [(f"part{place}", heading) for place, heading in enumerate(HEADING.findall(body))]
    for name, heading in sections:
        body = body.replace(f"<h2>{heading}</h2>", f'<h2 id="{name}">{heading}</h2>', 1)
    fields = {
        "title": title.removeprefix("# "),
        "about": f"{study}, calibrated by designed experiments",
        "made": origin_line(f"first seed {file.study.study.seed}"),
        "body": body,
        "sections": sections,
    }
    return write_page(to or file.folder / f"{study.stem}.report.html", study, force, TEMPLATE, fields)


def write_recording(study: Path) -> Path:
    """Write the recording of a calibration. Raises BadInput where the calibration is not finished."""
    file = read_finished_calibration(study)
    table = pd.read_csv(file.folder / "runs.csv", dtype={"failure": str}).fillna({"failure": ""})
    rows = [{str(name): cell for name, cell in row.items()} for row in table.to_dict("records")]
    pictures = {path.stem.replace("_", " "): path for path in sorted((file.folder / PICTURES).glob("*.png"))}
    lines = (file.folder / PAGE).read_text(encoding="utf-8").splitlines()
    keys = (*file.study.parameters, *map(file.measure, file.study.targets))
    cells = [[design_run_name(row), *("" if row[k] != row[k] else f"{row[k]}" for k in keys)] for row in rows]
    runs = []  # with an existing recording, those of the last stage first
    for row in sorted(rows, key=lambda row: -STAGES.index(row["stage"])):
        recording = file.folder / "recordings" / f"{design_run_name(row)}-{row['seed']}.rrd"
        if recording.is_file():
            measures = {name: row[file.measure(name)] for name in file.study.targets}
            responses = {name: value for name, value in measures.items() if value == value}
            texts = (f"{name} {y:.3g} {file.study.targets[name].unit}" for name, y in responses.items())
            settings = {re.sub(r"[.-]", "_", path): row[path] for path in file.study.parameters}
            caption = f"{design_run_name(row)}: {', '.join(texts)}"
            runs.append(RecordedRun(design_run_name(row), caption, recording, settings | responses))
    page = StudyPage(
        title=file.study.study.title or study.stem,
        summary="\n".join(line for line in lines if not line.startswith("![")),
        table=markdown_table(["run", *file.labels.values(), *file.study.targets], cells),
        figures={name: path.read_bytes() for name, path in pictures.items()},
        runs=runs[:MOST_RUNS],
        properties={f"target_{name}": target.value for name, target in file.study.targets.items()},
        columns={re.sub(r"[.-]", "_", str(name)): column.to_list() for name, column in table.items()},
    )
    return record_study(file.folder / RECORDING, page)


def design_run_name(row: Row) -> str:
    """`surface-3`."""
    return f"{row['stage']}-{row['row']}"
