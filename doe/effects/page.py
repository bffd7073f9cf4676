"""The page of effects: what the literature says of each, what came out, and what was kept."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite, nan
from pathlib import Path

from doe.common.cases import MEASURED
from doe.common.pages import RESULTS, write_pages
from doe.common.tables import lines_of, read_table
from doe.effects.answers import Answer, bed_law
from taichi_erosion.tables.number_words import markdown_table

TOLD = 2.0  # standard errors from nought at which a shift counts [1]
NEAR = 0.02  # of its answer within which a simple scene must lie [1]
SHARED = 0.1  # of a law of whole beds within which a simple scene shares it [1]
Shifts = Sequence[dict[str, str]]


@dataclass(frozen=True)
class Saying:
    """A sentence of the literature about an effect, and where it was tried."""

    effect: str
    says: str
    source: str
    table: str  # answers, shifts or beds; empty where it was not tried
    quantity: str
    label: str
    place: float  # on the axis of the answers, or of the law of a bed; NaN: all places, or no law
    low: float  # of the range that the literature gives; NaN where it gives none
    high: float
    sign: int  # which way the quantity should go; 0: either


@dataclass(frozen=True)
class Verdict:
    """What came out, in words, and whether the sentence was kept."""

    came: str
    kept: str


Verdicts = Sequence[tuple[Saying, Verdict]]
FLOWING = "sliding_angle"  # observable: slope at which a bed without wind flows
NOT_MEASURED = "Not measured yet.\n"
NOT_RUN = Verdict("not simulated", "open")


def judged(saying: Saying, answers: Sequence[Answer], shifts: Shifts, beds: Shifts) -> Verdict:
    """What became of a sentence."""
    if saying.table == "answers":
        rows = [a for a in answers if (a.effect, a.quantity) == (saying.effect, saying.quantity)]
        rows = [a for a in rows if not isfinite(saying.place) or a.place == saying.place]
        return judged_answers(saying, rows) if rows else NOT_RUN
    for row in beds if saying.table == "beds" else shifts if saying.table == "shifts" else ():
        if (row["effect"], row["observable"], row["label"]) == (saying.effect, saying.quantity, saying.label):
            if isfinite(saying.place):
                slopes = (float(each["bare"]) for each in beds if each["observable"] == FLOWING)
                return judged_by_law(saying, row, next(slopes, nan))
            return judged_shift(saying, row)
    return NOT_RUN


def judged_answers(saying: Saying, rows: Sequence[Answer]) -> Verdict:
    """A sentence beside answers that are known: right way, near the closed form, near the law of beds."""
    ends = [rows[0], rows[-1]] if len(rows) > 1 else list(rows)
    parts = [value_words(a) + f" at {a.axis.partition(' [')[0]} {a.place:g}" * bool(a.axis) for a in ends]
    known = [abs(row.value / row.expected - 1.0) for row in rows if isfinite(row.expected)]
    laws = [row.value / row.law - 1.0 for row in rows if isfinite(row.law)]
    if known:
        parts.append(f"at most {100.0 * max(known):.1g} % from its answer")
    ranged = isfinite(saying.low)
    if laws and not ranged:
        parts.append(f"up to {max(laws, key=abs):+.0%} from the law of beds")
    if not all(goes(row.value - reference(row), saying.sign) for row in rows) or not all(
        gap < NEAR for gap in known
    ):
        return Verdict("; ".join(parts), "no")
    meets = all(saying.low <= row.value <= saying.high for row in rows) if ranged else shares(laws)
    return Verdict("; ".join(parts), "yes" if meets else "in sign" if saying.sign else "no")


def shares(gaps: Sequence[float]) -> bool:
    """Whether a simple scene is near the law of whole beds; without a law nothing is missed."""
    return all(abs(gap) < SHARED for gap in gaps)


def reference(row: Answer) -> float:
    """What the value is without the effect."""
    return 1.0 if "over bare" in row.quantity else row.bare


def goes(shift: float, sign: int) -> bool:
    """Whether a shift goes the way it should."""
    return sign == 0 or shift * sign > 0.0


def value_words(row: Answer) -> str:
    """A value with its error."""
    error = f" ± {row.error:.2g}" if row.n > 1 else ""
    before = "" if "over bare" in row.quantity else f"{row.bare:.3g} → "
    return f"{before}{row.value:.3g}{error}"


def judged_shift(saying: Saying, row: dict[str, str]) -> Verdict:
    """A sentence beside a measured shift."""
    shift, error = float(row["shift"]), float(row["standard_error"])
    if not isfinite(shift):
        return Verdict(row["note"].rpartition("effects: ")[2], "open")
    unit = "" if row["unit"] == "1" else f" {row['unit']}"
    came = f"{float(row['bare']):.3g}{unit}: {shift:+.2g} ± {error:.1g}"
    if abs(shift) <= TOLD * error:
        return Verdict(came, "not significant")
    return Verdict(came, "yes" if shift * saying.sign > 0.0 else "no")


def judged_by_law(saying: Saying, row: dict[str, str], flowing: float) -> Verdict:
    """A ratio of thresholds of small beds beside the law of whole beds, within its standard error."""
    bare, law = float(row["bare"]), bed_law(saying.effect, saying.place, flowing)
    ratio, error = 1.0 + float(row["shift"]) / bare, float(row["standard_error"]) / bare
    if not isfinite(ratio):
        return judged_shift(saying, row)
    came = f"{ratio:.3f} ± {error:.1g} times {bare:.3g} {row['unit']}; the law says {law:.3f}"
    if abs(ratio - 1.0) <= TOLD * error:
        return Verdict(came, "not significant")
    if (ratio - 1.0) * (law - 1.0) < 0.0:
        return Verdict(came, "no")
    return Verdict(came, "yes" if abs(ratio - law) <= TOLD * error else "in sign")


def verdict_table(verdicts: Verdicts) -> str:
    """One row a sentence."""
    header = ("effect", "the literature says", "what came out", "kept")
    lines = []
    for saying, verdict in verdicts:
        case = f" ({saying.label})" if saying.label else ""
        what = f"{saying.quantity}{case}: " if saying.table else ""
        says = f"{saying.says}; {saying.source}"
        lines.append((f"`{saying.effect}`", says, f"{what}{verdict.came}", verdict.kept))
    return markdown_table(header, lines)


def effect_table(verdicts: Verdicts) -> str:
    """How many sentences of the literature come out, and of which effects those are that do not."""
    rows = []
    for outcome in ("yes", "in sign", "not significant", "no", "open"):
        names = [f"`{saying.effect}`" for saying, verdict in verdicts if verdict.kept == outcome]
        words = f"{len(set(names))} effects" if outcome == "yes" else ", ".join(dict.fromkeys(names))
        rows.append((outcome, str(len(names)), words))
    return markdown_table(("outcome", "sentences", "effects"), rows)


def shift_table(shifts: Shifts) -> str:
    """What every effect moves."""
    if not shifts:
        return NOT_MEASURED
    header = ("effect", "case", "observable", "bare", "shift", "standard errors", "pairs")
    lines = []
    for row in shifts:
        shift, error = float(row["shift"]), float(row["standard_error"])
        size = f"{shift / error:+.1f}" if isfinite(shift) and error > 0.0 else ""
        moved = f"{shift:+.3g} ± {error:.1g}" if isfinite(shift) else "no value"
        name = f"{row['observable']} [{row['unit']}]"
        lines.append(
            (f"`{row['effect']}`", row["label"], name, f"{float(row['bare']):.4g}", moved, size, row["n"])
        )
    return markdown_table(header, lines)


def tables(doe: Path) -> dict[str, str]:
    """Tables of the page by name."""
    answers = read_table(MEASURED / "answers.csv", Answer)
    shifts, beds = (lines_of(MEASURED / f"{name}.csv") for name in ("signatures", "beds"))
    sayings = read_table(doe / "effects" / "literature.csv", Saying)
    verdicts = [(saying, judged(saying, answers, shifts, beds)) for saying in sayings]
    heaps = [row for row in shifts if row["observable"] in ("angle_of_repose", "pile_height")]
    return {
        "by effect": effect_table(verdicts),
        "verdicts": verdict_table(verdicts),
        "beds": shift_table(beds),
        "heaps": shift_table(heaps),
    }


def publish(doe: Path, docs: Path) -> None:
    """Fill the tables of the page."""
    write_pages((docs / RESULTS, doe / "effects" / "README.md"), tables(doe))
