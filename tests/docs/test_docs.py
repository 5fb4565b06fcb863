"""The documentation builds without a warning, and what it tells to type can be typed."""

import re
import shlex
import subprocess
import sys
from pathlib import Path

import duckdb
import pytest

from gcs_health.cli import _parser, main

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
# pages whose blocks of `sh` (and `python`) are run whole, in order, in a folder of their own
RUN = (
    "tutorial/first_flight.md",
    "howto/logs.md",
    "howto/report.md",
    "howto/fleet.md",
    "reference/python.md",
)
FENCE = re.compile(r"^```(\w*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
FINDINGS = (0, 3)


def blocks(page: Path, kind: str) -> list[str]:
    return [body for language, body in FENCE.findall(page.read_text(encoding="utf-8")) if language == kind]


def commands() -> list[tuple[str, str]]:
    """Every line that calls gcs-health, in the README and all pages."""
    found = []
    for page in (ROOT / "README.md", *sorted(DOCS.rglob("*.md"))):
        for language, body in FENCE.findall(page.read_text(encoding="utf-8")):
            if language in ("sh", "console", ""):
                lines = [re.sub(r"\s+#.*", "", line).strip() for line in body.splitlines()]
                found += [(page.name, line) for line in lines if line.startswith("gcs-health ")]
    return found


def test_the_site_builds_without_a_warning(tmp_path: Path) -> None:
    done = subprocess.run(
        [
            sys.executable,
            "-m",
            "mkdocs",
            "build",
            "--strict",
            "--site-dir",
            str(tmp_path / "site"),
        ],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    # not --quiet: it hides the warnings from --strict too
    assert "WARNING" not in done.stderr
    results = (tmp_path / "site" / "results.html").read_text(encoding="utf-8")
    assert "benchmarks/fleet.py" in results
    assert "--8&lt;--" not in results
    outside = re.findall(r'<(?:script|link|img)[^>]+(?:src|href)="https?://[^"]+', results)
    assert [link for link in outside if 'rel="canonical"' not in link] == []


def test_every_results_table_is_on_the_page() -> None:
    page = (DOCS / "results.md").read_text(encoding="utf-8")
    assert [
        p.name for p in sorted((ROOT / "benchmarks").glob("*.md")) if f'"benchmarks/{p.name}"' not in page
    ] == []


@pytest.mark.parametrize(("page", "line"), commands())
def test_every_command_told_can_be_parsed(page: str, line: str) -> None:
    line = re.split(r"\s(?:&&|\||>)\s", line)[0]
    _parser().parse_args(shlex.split(line)[1:])


@pytest.mark.parametrize("page", RUN)
def test_the_commands_of_a_page_run(page: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "replay").symlink_to(ROOT / "replay")
    monkeypatch.chdir(tmp_path)
    for line in (line for body in blocks(DOCS / page, "sh") for line in body.splitlines()):
        if line.startswith("gcs-health "):  # in this process: what it imports is there already
            code = main(shlex.split(line)[1:])
        else:
            code = subprocess.run(["bash", "-c", line], timeout=60, check=False).returncode
        assert code in FINDINGS, line
    for body in blocks(DOCS / page, "python"):
        exec(compile(body, page, "exec"), {})
    if page == "howto/fleet.md":
        ask_the_five_questions(tmp_path)


def ask_the_five_questions(place: Path) -> None:
    queries = blocks(DOCS / "howto/fleet.md", "sql")
    assert len(queries) == 5
    ask = duckdb.connect()
    ask.execute(f"set file_search_path = '{place}'")
    first, _, third, *_ = (ask.execute(query).fetchall() for query in queries)
    assert first == [("bebop", 3, "ROTOR_FAILED", 1)]
    assert {row[0] for row in third} == {"bebop"}
