"""Page of a calibration: README.md with figures in the study's folder, the same as HTML, and a recording."""

import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from jinja2 import Environment, PackageLoader, StrictUndefined
from markdown_it import MarkdownIt
from matplotlib import pyplot as plt
from matplotlib.figure import Figure

from taichi_erosion import __version__
from taichi_erosion.campaign.calibration import PAGE, PICTURES, Calibration
from taichi_erosion.campaign.calibration_steps import STAGES
from taichi_erosion.campaign.study_file import CalibrationStudy, read_calibration_study
from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.files import ListedFolder, marked_html, refuse_foreign, write_atomic
from taichi_erosion.experiments.confirm import SIGNIFICANCE
from taichi_erosion.recording.study_recording import RecordedRun, StudyPage, record_study
from taichi_erosion.report import design_figures as figures
from taichi_erosion.report.html import address_of, made, render
from taichi_erosion.report.markdown import markdown_table, with_scatter_of, with_spread

Row = Mapping[str, Any]
Cells = tuple[Sequence[str], Sequence[Sequence[str]]]  # header and rows of a table

PAGE_TEMPLATE, TEMPLATE = "calibration.md", "calibration.html"
RECORDING = "study.rrd"
LEAST_POWER = 0.5  # of a yes: below it a test more often misses a difference that matters than sees it [1]
OPTIMA = 5  # listed on the page
VARIANCE = ("sum_of_squares", "df", "mean_square", "f", "p")
PICTURE = re.compile(r'<img src="([^":]+)"')
HEADING = re.compile("<h2>(.+?)</h2>")
VERDICT = re.compile(r"<p><strong>(Yes\.|No\.|Not known\.)</strong>")
RESOLUTION = 130  # of pictures [dots per inch]
MOST_RUNS = 9  # recorded runs side by side


def publish(found: Calibration) -> Path:
    """Write page and pictures into the folder of a completed study."""
    draw(found)
    pages = Environment(loader=PackageLoader("taichi_erosion.report"), undefined=StrictUndefined)
    document, targets = found.document, found.file.study.targets
    text = pages.get_template(PAGE_TEMPLATE).render(
        file=found.file,
        study=found.file.study,
        document=document,
        leading=next(iter(targets)),
        design=surface_design_words(found),
        verdicts={
            name: verdict(document["confirm"]["tests"][name], name, targets[name].unit) for name in targets
        },
        scenes=[Path(path).name for path in document.get("calibrated_scenes", [])],
        scatter=with_scatter_of,
        symbols=symbols(found),
        kept=", ".join(found.file.labels[path] for path in document["analyse"]["kept"]),
        effects={name: markdown_table(*effect_table(found, name)) for name in targets},
        climb=markdown_table(*climb_table(found)),
        variance={name: markdown_table(*variance_table(found, name)) for name in targets},
        equations={name: equation(found, name) for name in targets},
        optima=markdown_table(*optimum_table(found)),
        samples={name: samples(document["confirm"]["tests"][name]) for name in targets},
    )
    return ListedFolder(found.file.folder).write(PAGE, (text.rstrip() + "\n").encode())


def draw(found: Calibration) -> None:
    """Write all figures of the page."""
    assert found.climb is not None
    targets = found.file.study.targets
    for name in targets:
        for kind, figure in response_figures(found, name).items():
            save(found, figure, f"{kind}_{name}.png")
    name, target = next(iter(targets.items()))
    curve = figures.climb_curve(found.climb.design, name, found.climb.best, target)
    save(found, curve, f"climb_{name}.png")


def save(found: Calibration, figure: Figure, name: str) -> None:
    """Write one figure, and list it."""
    path = found.file.folder / PICTURES / name
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=RESOLUTION, metadata={"Software": None})  # equal figures give equal bytes
    plt.close(figure)
    ListedFolder(found.file.folder).record(f"{PICTURES}/{name}")


def response_figures(found: Calibration, name: str) -> dict[str, Figure]:
    """Figures of one response, by kind."""
    assert found.surface is not None
    document, names, target = found.document, found.file.labels, found.file.study.targets[name]
    analysed, fit = document["analyse"], found.surface.fits[name]
    best, values = document["optimise"]["optima"][0], document["confirm"]["values"][name]
    at = np.array([(best["settings"][f.path] - f.centre) / f.half for f in fit.factors])
    return {
        "effects": figures.effect_bars(analysed["responses"][name], analysed["kept"], target.unit),
        "surface": figures.contours(fit, names, target.unit, at, target.value),
        "hills": figures.response_surfaces(fit, names, target.unit, at),
        "perturbation": figures.perturbation(fit, names, target.unit, at),
        "fit": figures.predicted_against_actual(fit, target.unit),
        "residuals": figures.residuals(fit, found.surface.design.run_order),
        "confirm": figures.confirmation_runs(values, name, target, best["predicted"][name]),
    }


def effect_table(found: Calibration, name: str) -> Cells:
    """Effects, largest first, with the published values where the study has any."""
    rows, target = [], found.file.study.targets[name]
    screened = found.document["analyse"]["responses"][name]
    published = any(entry.published for entry in found.file.study.parameters.values())
    for effect in screened["effects"]:
        entry = found.file.study.parameters[effect["name"]]
        label = f"{effect['label']} {entry.symbol}".strip()
        limits = f"{entry.low:g} to {entry.high:g} {'' if entry.unit == '1' else entry.unit}".rstrip()
        value = with_scatter_of(
            effect["value"], standard_error(effect, screened["quality"]["sd"]), signed=True
        )
        rows.append((label, limits, value, f"{effect['p']:.2g}", *([entry.published] if published else [])))
    header = ("parameter", "range", f"effect [{target.unit}]", "p", *(["published"] if published else []))
    return header, rows


def standard_error(effect: Mapping[str, float], scatter: float) -> float:
    """Standard error of an effect; the scatter of single runs where the screening has no t."""
    t = effect["t"]
    return abs(effect["value"] / t) if t == t and t != 0.0 else scatter


def surface_design_words(found: Calibration) -> str:
    """`Box-Behnken design of 17 runs, 5 of them at the centre`."""
    assert found.surface is not None
    design, sizes = found.surface.design, found.file.study.design
    name = {
        "box_behnken": "Box-Behnken design",
        "central_composite": f"Central composite design ({sizes.surface_axial})",
        "latin_hypercube": "Latin hypercube",
    }[sizes.surface]
    return f"{name} of {len(design)} runs, {design.kinds.count('centre')} of them at the centre"


def verdict(test: Mapping[str, Any], name: str, unit: str) -> str:
    """Yes or no to the question whether the calibrated scene reproduces the measurement, with the power."""
    scatter = test["runs"]["sd"]
    difference, seen = (with_scatter_of(test[key], scatter) for key in ("difference", "detectable"))
    if test["p"] != test["p"]:
        return f"**Not known.** The confirmation runs of {name} do not scatter, so no test is possible."
    power = f"The test sees a difference of {seen} {unit} with a power of 0.8, and one of "
    power += f"{with_scatter_of(test['resolve'], scatter)} {unit} with a power of {test['power']:.2f}."
    if test["p"] < SIGNIFICANCE:
        words = f"{name} differs by {difference} {unit} from the measurement (p = {test['p']:.2g})"
        remedy = (
            "Another range of the surface (surface_half in [design]), then the same command, may come nearer."
        )
        return f"**No.** In the calibrated scene {words}. {power} {remedy}"
    if test["power"] < LEAST_POWER:
        words = f"no difference of {name} from the measurement is told ({difference} {unit}, "
        words += f"p = {test['p']:.2g}), but the test would more often miss one than see it"
        return f"**Not refuted.** In the calibrated scene {words}. {power} More confirmation runs would tell."
    words = f"{name} agrees with the measurement (difference {difference} {unit}, p = {test['p']:.2g})"
    return f"**Yes.** In the calibrated scene {words}. {power}"


def climb_table(found: Calibration) -> Cells:
    """Path of steepest ascent, step by step."""
    document = found.document["climb"]
    paths, names = (list(document["rows"][0][key]) for key in ("settings", "responses"))
    rows = []
    for step, row in enumerate(document["rows"]):
        mark = " (nearest)" if step == document["best"] - 1 else ""
        values = [row["settings"][path] for path in paths] + [row["responses"][name] for name in names]
        rows.append((f"{step}{mark}", *(number(value) for value in values)))
    return ("step", *(found.file.labels[path] for path in paths), *names), rows


def number(value: float) -> str:
    """Number in four digits; "none" for NaN."""
    return "none" if value != value else f"{value:.4g}"


def variance_table(found: Calibration, name: str) -> Cells:
    """Analysis of variance."""
    anova = found.document["surface"]["responses"][name]["anova"]
    rows = [(row["label"], *(number(row[key]) for key in VARIANCE)) for row in anova]
    return ("source", "sum of squares", "df", "mean square", "F", "p"), rows


def equation(found: Calibration, name: str) -> str:
    """Equation in natural units, with the publication's symbols where the study names them."""
    text = found.document["surface"]["responses"][name]["natural_reduced"]
    for path, symbol in sorted(symbols(found).items(), key=lambda each: -len(each[0])):
        text = text.replace(path, symbol)
    return text.replace("*", " \N{MIDDLE DOT} ").replace("^2", "\N{SUPERSCRIPT TWO}")


def symbols(found: Calibration) -> dict[str, str]:
    """Letters of the parameters in the equations; those of a publication, else x1, x2, ..."""
    assert found.surface is not None
    paths = [factor.path for factor in found.surface.design.factors]
    parameters = found.file.study.parameters
    return {path: parameters[path].symbol or f"x{place}" for place, path in enumerate(paths, 1)}


def optimum_table(found: Calibration) -> Cells:
    """Settings that reach the target, the narrowest prediction interval first."""
    optima, targets = found.document["optimise"]["optima"][:OPTIMA], list(found.file.study.targets)
    paths = list(optima[0]["settings"])
    rows = []
    for one in optima:
        predicted = (one["predicted"][name] for name in targets)
        intervals = (interval_words(each) for each in predicted)
        rows.append((*(number(one["settings"][path]) for path in paths), *intervals))
    header = (*(found.file.labels[path] for path in paths), *(f"{name}, predicted" for name in targets))
    return header, rows


def interval_words(predicted: Mapping[str, float]) -> str:
    """`33.5 (32.4 to 34.7)`, with as many digits as the width of the interval deserves."""
    half = 0.5 * (predicted["high"] - predicted["low"])
    value, low, high = (with_scatter_of(predicted[key], half) for key in ("value", "low", "high"))
    return f"{value} ({low} to {high})"


def samples(test: Mapping[str, Any]) -> dict[str, str]:
    """Mean, standard deviation and number of the confirmation runs and of the measurement."""
    return {
        kind: with_spread(test[kind]["mean"], test[kind]["sd"], int(test[kind]["n"]))
        for kind in ("runs", "wanted")
    }


def finished(study: Path) -> CalibrationStudy:
    """Study whose page and table of runs exist. Raises BadInput where the calibration is not finished."""
    file = read_calibration_study(study)
    if not (file.folder / PAGE).is_file() or not (file.folder / "runs.csv").is_file():
        raise BadInput(f"{study}: not calibrated yet; run doe calibrate on it first")
    return file


def write_report(study: Path, to: Path | None = None, force: bool = False) -> Path:
    """Write the HTML page of a calibration. Raises BadInput where the calibration is not finished."""
    file = finished(study)
    to = to or file.folder / f"{study.stem}.report.html"
    refuse_foreign(to, study, force)
    title, _, text = (file.folder / PAGE).read_text(encoding="utf-8").partition("\n")
    html = MarkdownIt("commonmark", {"html": False}).enable("table").render(text)
    body = PICTURE.sub(lambda found: f'<img src="{address_of(file.folder / found[1])}"', html)
    body = body.replace("<table>", '<div class="scroll"><table>').replace("</table>", "</table></div>")
    body = VERDICT.sub(r'<p class="verdict"><strong>\1</strong>', body)
    sections = [(f"part{place}", title) for place, title in enumerate(HEADING.findall(body))]
    for name, heading in sections:
        body = body.replace(f"<h2>{heading}</h2>", f'<h2 id="{name}">{heading}</h2>', 1)
    about = f"{study}, calibrated by designed experiments"
    when = made({"taichi_erosion": __version__}, f"first seed {file.study.study.seed}")
    fields = {"title": title.removeprefix("# "), "about": about, "made": when}
    page = render(TEMPLATE, fields | {"body": body, "sections": sections})
    return write_atomic(to, marked_html(to, study, page))


def write_recording(study: Path) -> Path:
    """Write the recording of a calibration. Raises BadInput where the calibration is not finished."""
    file = finished(study)
    table = pd.read_csv(file.folder / "runs.csv", dtype={"failure": str}).fillna({"failure": ""})
    rows = [{str(name): cell for name, cell in row.items()} for row in table.to_dict("records")]
    pictures = {path.stem.replace("_", " "): path for path in sorted((file.folder / PICTURES).glob("*.png"))}
    lines = (file.folder / PAGE).read_text(encoding="utf-8").splitlines()
    page = StudyPage(
        title=file.study.study.title or study.stem,
        summary="\n".join(line for line in lines if not line.startswith("![")),
        table=run_table(file, rows),
        figures={name: path.read_bytes() for name, path in pictures.items()},
        runs=list(recorded_runs(file, rows))[:MOST_RUNS],
        properties={f"target_{name}": target.value for name, target in file.study.targets.items()},
        columns={re.sub(r"[.-]", "_", str(name)): column.to_list() for name, column in table.items()},
    )
    return record_study(file.folder / RECORDING, page)


def run_table(file: CalibrationStudy, rows: Sequence[Row]) -> str:
    """Settings and responses of every run."""
    keys = (*file.study.parameters, *map(file.measure, file.study.targets))
    cells = [
        [run_name(row), *("" if row[key] != row[key] else f"{row[key]}" for key in keys)] for row in rows
    ]
    return markdown_table(["run", *file.labels.values(), *file.study.targets], cells)


def run_name(row: Row) -> str:
    """`surface-3`."""
    return f"{row['stage']}-{row['row']}"


def recorded_runs(file: CalibrationStudy, rows: Sequence[Row]) -> Iterator[RecordedRun]:
    """Runs with an existing recording, those of the last stage first."""
    for row in sorted(rows, key=lambda row: -STAGES.index(row["stage"])):
        recording = file.folder / "recordings" / f"{run_name(row)}-{row['seed']}.rrd"
        if recording.is_file():
            found = {name: row[file.measure(name)] for name in file.study.targets}
            responses = {name: value for name, value in found.items() if value == value}
            texts = (f"{name} {y:.3g} {file.study.targets[name].unit}" for name, y in responses.items())
            settings = {re.sub(r"[.-]", "_", path): row[path] for path in file.study.parameters}
            caption = f"{run_name(row)}: {', '.join(texts)}"
            yield RecordedRun(run_name(row), caption, recording, settings | responses)
