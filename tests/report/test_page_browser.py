"""The page in a real browser: nothing is asked of the network, nothing is complained about, all is seen."""

import browser
import pytest
import synthetic_run
from made_up import gathered

from shefex_nav.report import page

pytestmark = pytest.mark.skipif(browser.executable() is None, reason="no Chromium on this machine")
QUESTIONS = {
    "pictures": "document.images.length",
    "seen": "Promise.all([...document.images].map(i => i.decode().then(() => i.naturalWidth > 0)))"
    ".then(all => all.every(Boolean))",
    "width": "document.documentElement.scrollWidth",
    "scripts": "document.scripts.length",
    "smallest_px": "Math.min(...[...document.querySelectorAll('main *')].map("
    "e => parseFloat(getComputedStyle(e).fontSize)))",
    "cut": "[...document.querySelectorAll('figure')].every(f => getComputedStyle(f).breakInside == 'avoid')",
}


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    path = tmp_path_factory.mktemp("page") / "report.html"
    page.write(path, gathered(synthetic_run.Options(start_s=230.0, end_s=245.0, frame_pixels=False)))
    return path


def test_the_page_asks_for_nothing_and_complains_of_nothing(written, tmp_path):
    seen = browser.visit(written, tmp_path, QUESTIONS)
    assert seen.requests == []
    assert seen.complaints == []
    facts = seen.facts
    assert facts["pictures"] >= 12 and facts["seen"] is True
    assert facts["width"] <= 1280 and facts["scripts"] == 0
    assert facts["smallest_px"] >= 12.0
    assert facts["cut"] is True


def test_a_page_that_asks_and_fails_is_noticed(tmp_path):
    bad = tmp_path / "bad.html"
    bad.write_text('<html><img src="http://127.0.0.1:9/x.png"><script>nothing.here()</script></html>')
    seen = browser.visit(bad, tmp_path / "profile", {})
    assert seen.requests == ["http://127.0.0.1:9/x.png"]
    assert len(seen.complaints) >= 1
