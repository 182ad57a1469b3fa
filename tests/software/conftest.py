"""What a test of somebody's software loads, or consents to, is not there in the next one."""

import plugin_tables
import pytest

from shefex_nav import plugins


@pytest.fixture(autouse=True)
def forgotten(monkeypatch, tmp_path):
    """Consent and tables as before."""
    (tmp_path / "config").mkdir()
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    monkeypatch.setenv(plugins.CONSENT, "")
    with plugin_tables.restored():
        yield
