"""The page of a trial: a target that is missed stands in the table with its figure."""

import csv
import json
from dataclasses import asdict

from doe.sealed.laboratory import Truth
from doe.sealed.oracle import Difficulty
from doe.sealed.solve import Outcome
from doe.sealed.trial import COLUMNS
from doe.t0.page import publish

PAGE = "".join(f"<!-- table: {name} -->\n<!-- end -->\n" for name in ("cases", "metrics", "calibration"))
NOTHING = (float("nan"),) * 3


def row(number: int, named: tuple[str, ...]) -> dict[str, str]:
    """A null of which the answer says that some effects act."""
    shares = {"none": 0.8} if not named else {named[0]: 0.9, "none": 0.1}
    verdict = "present" if named else "none_detected"
    outcome = Outcome(number, verdict, named, (), shares, 0.5, {}, {}, NOTHING, 100, 0.2)
    parts = {
        "truth": Truth("null", {}, {}, 1.0, False, ""),
        "difficulty": Difficulty(0.0, 9.0),
        "answer": outcome,
    }
    return {"number": str(number), "sha256": "0"} | {
        key: json.dumps(asdict(part)) for key, part in parts.items()
    }


def test_false_alarms_are_counted_and_a_missed_target_is_marked(tmp_path):
    table, page = tmp_path / "results.csv", tmp_path / "README.md"
    with table.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, list(COLUMNS))
        writer.writeheader()
        writer.writerows([row(0, ()), row(1, ()), row(2, ()), row(3, ("gusts",))])
    page.write_text(PAGE, encoding="utf-8")
    publish(tmp_path)
    lines = page.read_text("utf-8").splitlines()
    (alarms,) = [line for line in lines if line.startswith("| nulls, sd as stated: any name")]
    assert "| 0.250 |" in alarms
    assert "**no**" in alarms
    assert "| null | 4 |  |  |" in lines
    assert "| 0.80 | 1.00 | 3 |" in lines
