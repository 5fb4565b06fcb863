"""From a template to one HTML file that needs no network, and to paper where chromium is there."""

import os
import shutil
import subprocess
from pathlib import Path
from typing import Any

from gcs_health.errors import ConfigError

NEEDS = "a report needs {}: pip install 'gcs-health[report]'"
BROWSERS = ("chromium", "chromium-browser", "google-chrome", "chrome")
PDF_TIMEOUT = 120.0  # s


def render(template: str, context: dict[str, Any]) -> str:
    """Return a template of this package filled in; every value is escaped unless it says that it is markup.

    Raises
    ------
    ConfigError : jinja2 or plotly is not installed.
    """
    try:
        import jinja2
        from plotly.offline import get_plotlyjs
    except ModuleNotFoundError as error:
        raise ConfigError(NEEDS.format(error.name)) from None
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(Path(__file__).parent / "templates"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    from markupsafe import Markup

    return environment.get_template(template).render(plotly_js=Markup(get_plotlyjs()), **context)


def write(path: Path, text: str) -> None:
    """Write a page.

    Raises
    ------
    ConfigError : it cannot be written.
    """
    try:
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise ConfigError(f"{path}: cannot write: {error.strerror}") from None


def print_to_pdf(page: Path, pdf: Path) -> None:
    """Print a page by a headless chromium.

    Raises
    ------
    ConfigError : there is none, or it fails.
    """
    browser = next(filter(None, map(shutil.which, BROWSERS)), None)
    if browser is None:
        raise ConfigError(f"{pdf}: a PDF needs one of {', '.join(BROWSERS)} on the path; {page} is written")
    command = [
        browser,
        "--headless",
        "--disable-gpu",
        "--no-pdf-header-footer",
        "--virtual-time-budget=10000",
    ]
    if hasattr(os, "geteuid") and os.geteuid() == 0:
        command.append("--no-sandbox")  # chromium refuses to run as root otherwise
    command += [f"--print-to-pdf={pdf}", page.resolve().as_uri()]
    try:
        done = subprocess.run(command, capture_output=True, timeout=PDF_TIMEOUT, check=False)
    except (OSError, subprocess.TimeoutExpired) as error:
        raise ConfigError(f"{pdf}: {browser}: {error}") from None
    if done.returncode or not pdf.exists():
        said = done.stderr.decode("utf-8", "replace").strip().splitlines()
        raise ConfigError(f"{pdf}: {browser} failed: {said[-1] if said else done.returncode}")
