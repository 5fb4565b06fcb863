"""Puts this folder on the path, for the helpers that several kinds of tests share, and keeps the user's data out."""

import os
import tempfile
from collections.abc import Iterator

import pytest


@pytest.fixture(scope="session", autouse=True)
def nothing_of_the_user() -> Iterator[None]:
    """`live` keeps a history in the user's data folder, rules come from the settings folder: here others."""
    names = ("XDG_DATA_HOME", "XDG_CONFIG_HOME")
    before = {name: os.environ.get(name) for name in names}
    with tempfile.TemporaryDirectory() as place:
        os.environ.update(dict.fromkeys(names, place))
        yield
    for name, value in before.items():
        if value is None:
            del os.environ[name]
        else:
            os.environ[name] = value
