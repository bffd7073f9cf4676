"""Workflows and templates of issues have the form of their schemas, and run what the README says."""

import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.docs

GITHUB = Path(__file__).parents[2] / ".github"
SCHEMAS = {path: "vendor.github-workflows" for path in (GITHUB / "workflows").glob("*.yml")} | {
    path: "vendor.github-issue-config" if path.stem == "config" else "vendor.github-issue-forms"
    for path in (GITHUB / "ISSUE_TEMPLATE").glob("*.yml")
}


@pytest.mark.parametrize(("path", "schema"), SCHEMAS.items(), ids=lambda part: getattr(part, "name", part))
def test_a_file_has_the_form_of_its_schema(path, schema):
    command = [sys.executable, "-m", "check_jsonschema", "--builtin-schema", schema, str(path)]
    ended = subprocess.run(command, capture_output=True, text=True, check=False)
    assert ended.returncode == 0, ended.stdout


def test_every_workflow_runs_the_gates_of_the_readme():
    workflows = list((GITHUB / "workflows").glob("*.yml"))
    assert {path.stem for path in workflows} == {"release", "tests"}
    assert all("run: bash .ci/run" in path.read_text(encoding="utf-8") for path in workflows)
