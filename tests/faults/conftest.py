"""Faults at full number: `pytest -m faults`. A share of each kind is among the tests of its part."""

from pathlib import Path

import pytest


def pytest_collection_modifyitems(items):
    for item in items:
        if Path(__file__).parent in item.path.parents:
            item.add_marker(pytest.mark.faults)


@pytest.fixture(autouse=True)
def no_figure(monkeypatch):
    """Drawing takes longer than these runs."""
    monkeypatch.setattr("discsim.output.figure.last_state_figure", lambda snapshot, figure: figure.touch())
