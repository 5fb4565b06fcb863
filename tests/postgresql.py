"""A real PostgreSQL server of the tests' own, where one is installed."""

import os
import pwd
import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest


def _binaries() -> Path | None:
    found = shutil.which("initdb")
    if found:
        return Path(found).resolve().parent
    return next(
        (p.parent for p in sorted(Path("/usr/lib/postgresql").glob("*/bin/initdb"), reverse=True)), None
    )


@contextmanager
def server() -> Iterator[str]:
    """Start a server that nobody else can reach; yield its URL. It refuses to run as root: then as another user."""
    binaries = _binaries()
    if binaries is None:
        pytest.skip("PostgreSQL is not installed (apt-get install postgresql)")
    user = None
    if os.geteuid() == 0:
        names = {entry.pw_name for entry in pwd.getpwall()}
        user = next(name for name in ("postgres", "nobody") if name in names)
    place = Path(tempfile.mkdtemp(prefix="pg"))  # a short path: sockets allow no long one
    data = place / "data"
    try:
        if user:
            shutil.chown(place, user)

        def call(*command: str) -> None:
            subprocess.run(
                command,
                user=user,
                cwd=place,
                check=True,
                timeout=60,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                env={"PATH": os.environ["PATH"], "LC_ALL": "C"},
            )

        call(f"{binaries}/initdb", "-D", str(data), "-U", "tests", "-A", "trust", "-E", "UTF8", "--no-sync")
        options = f"-c listen_addresses='' -c fsync=off -k {place}"
        call(f"{binaries}/pg_ctl", "-D", str(data), "-w", "-o", options, "-l", str(place / "log"), "start")
        try:
            yield f"postgresql://tests@/postgres?host={place}"
        finally:
            call(f"{binaries}/pg_ctl", "-D", str(data), "-m", "immediate", "stop")
    finally:
        shutil.rmtree(place)
