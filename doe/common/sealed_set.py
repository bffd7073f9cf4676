"""A sealed set of cases: where problems, truths, answers and tables lie, and truths checked by digests."""

import json
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import Any

NOWHERE = Path("/nonexistent")  # folder of truths for a step that must not read them


@dataclass(frozen=True)
class SealedSet:
    """A named set of cases and where its parts lie."""

    name: str
    secret: Path  # folder of truths, that the solver is not given
    work: Path  # of problems and answers
    tables: Path  # of digests and results
    digits: int  # of a case in the names of files

    def problem(self, number: int) -> Path:
        return self.work / self.name / "problems" / f"{number:0{self.digits}d}.pickle"

    def answer(self, number: int, method: str = "answers") -> Path:
        return self.work / self.name / method / f"{number:0{self.digits}d}.json"

    def truth(self, number: int) -> Path:
        return self.secret / self.name / f"{number:0{self.digits}d}.json"

    def seals(self) -> Path:
        """Digests of all truths, to be committed before the first answer."""
        return self.tables / "seals" / f"{self.name}.csv"

    def results(self) -> Path:
        return self.tables / "results" / f"{self.name}.csv"

    def refuse_sealed(self) -> None:
        """Raise FileExistsError where the set is drawn already: a set is drawn once."""
        if self.seals().exists():
            raise FileExistsError(f"{self.seals()}: this set is sealed already")

    def opened_truth(self, number: int, digest: str) -> dict[str, Any]:
        """Truth of a case; raises ValueError where it is not the one that was sealed."""
        text = self.truth(number).read_text(encoding="utf-8")
        if sha256(text.encode()).hexdigest() != digest:
            raise ValueError(f"{self.name}, case {number}: the truth is not the one that was sealed")
        return json.loads(text)
