"""The JSON schema of studies is current, and every shipped study has its form."""

import json
import tomllib
from pathlib import Path

import jsonschema
import pytest

from taichi_erosion.campaign.study_schema import study_schema, study_schema_text

ROOT = Path(__file__).parents[2]
STUDIES = sorted((ROOT / "doe").glob("*.toml"))


def test_the_schema_beside_the_studies_is_fresh():
    assert (ROOT / "doe" / "study.schema.json").read_text("utf-8") == study_schema_text(), (
        "./erosion schema --study writes it"
    )


@pytest.mark.parametrize("study", STUDIES, ids=lambda path: path.stem)
def test_a_shipped_study_has_the_form_of_the_schema(study):
    jsonschema.validate(json.loads(json.dumps(tomllib.loads(study.read_text("utf-8")))), study_schema())


@pytest.mark.parametrize(
    ("section", "entry"),
    [("vault", {"fraktion": 0.3}), ("budget", {"runs": "many"}), ("candidates", {"effects": 3})],
)
def test_a_slip_in_a_study_is_seen_by_the_schema(section, entry):
    study = tomllib.loads((ROOT / "doe" / "my_lab.toml").read_text("utf-8")) | {section: entry}
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate(study, study_schema())
