"""Losses of GPS: short ones are common, of a lasting one the table tells."""

LASTING_S = 30.0  # [E] in all; antennas that turn away and ignitions cost a receiver some seconds
LOST = ("no fix", "no ranges")  # begins of reasons


def is_loss(entry):
    """Whether an entry of `trust.noticed` is a receiver without a solution."""
    return entry["reason"].startswith(LOST)


def loss_rows(noticed):
    """(source, words) of each receiver that was long without a solution. noticed : as of `trust.noticed`"""
    by_source = {}
    for entry in noticed:
        if is_loss(entry):
            by_source.setdefault(entry["source"], []).append(entry)
    for source, lost in by_source.items():
        lasting = [one for one in lost if one["until_s"] is None or _seconds(one) >= LASTING_S]
        for one in lasting:
            end = "the end" if one["until_s"] is None else f"T{one['until_s']:+.1f} s"
            yield source.replace("_", " "), f"T{one['from_s']:+.1f} s to {end}: {one['reason']}"


def _seconds(entry):
    return entry["until_s"] - entry["from_s"]
