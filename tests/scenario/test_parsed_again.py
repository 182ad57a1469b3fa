"""A text that is parsed again gives trees of its own."""

from shefex_nav.scenario import document


def test_what_is_done_to_a_tree_is_not_seen_by_the_next():
    text = "a: {b: [1, {c: 2}]}\nd: null\n"
    first = document.parse(text, "file.yaml")
    first.tree["a"]["b"][1]["c"] = 3
    first.tree["a"]["b"].append(4)
    first.keys.clear()
    first.values.clear()
    first.removed.clear()
    second = document.parse(text, "file.yaml")
    assert second.tree == {"a": {"b": [1, {"c": 2}]}}
    assert second.removed == [("d",)] and ("a", "b") in second.keys
    assert document.parse(text, "other.yaml").keys[("a",)].file == "other.yaml"
