"""Puts this folder on the path, for the helpers that several kinds of tests share, and keeps the user's data out."""

import os
import tempfile
from collections.abc import Iterator

import pytest


@pytest.fixture(scope="session", autouse=True)
def no_data_of_the_user() -> Iterator[None]:
    """`live` keeps a history in the user's data folder by default: here in one of its own."""
    before = os.environ.get("XDG_DATA_HOME")
    with tempfile.TemporaryDirectory() as place:
        os.environ["XDG_DATA_HOME"] = place
        yield
    if before is None:
        del os.environ["XDG_DATA_HOME"]
    else:
        os.environ["XDG_DATA_HOME"] = before
