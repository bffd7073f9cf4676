"""Predictions from Python."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from taichi_erosion.api.notebook import frame, html
from taichi_erosion.api.wording import python_words

if TYPE_CHECKING:
    import pandas as pd

    from taichi_erosion.evidence.answers.predictions import PredictionReply


@dataclass(frozen=True, repr=False)
class PredictionResult:
    """What the calibrated, adopted model says at new conditions."""

    study: Path
    reply: "PredictionReply"

    @property
    def document(self) -> dict[str, Any]:
        """What `--json` prints."""
        return self.reply.document

    @property
    def sentences(self) -> list[str]:
        """What the predictions rest on, in plain sentences."""
        return [python_words(each) for each in (*self.reply.about["set_up"], *self.reply.answer().lines)]

    @property
    def table(self) -> "pd.DataFrame":
        """Predictions in the units of the observables, one row each, conditions as the table had them.

        `low` and `high` are the 90 % interval of what many repeats give on average, `measured_low` and
        `measured_high` that of one measurement; `model` is the calibrated model alone.
        """
        from taichi_erosion.evidence.words.prediction_words import outside_text

        keys = ("model", "value", "low", "high", "measured_low", "measured_high", "unit")
        return frame(
            {"observable": row.observable, **row.conditions, **{key: getattr(row, key) for key in keys}}
            | {"outside": outside_text(row)}
            for row in self.reply.record.rows
        )

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.study}: {self.sentences[0]})"

    def _repr_html_(self) -> str:
        return html(self.document["title"] or str(self.study), self.sentences, [self.table])
