"""Pieces of a page: where a narrow screen may break a text of a table."""

from shefex_nav.report import html


def test_a_key_may_be_broken_after_its_dots_and_a_number_may_not():
    """A key of 36 characters pushed the column beside it off a screen of 400 px."""
    made = html.table("", ("", ""), [("vehicle.stages.S40.motor", "7.5 to .134 deg. End <b> e.g.")]).html
    assert "vehicle.<wbr>stages.<wbr>S40.<wbr>motor" in made
    assert "7.5 to .134 deg. End &lt;b&gt;" in made


def test_what_is_html_already_stays():
    assert html.breakable(html.Safe("a.b")) == html.Safe("a.b")
