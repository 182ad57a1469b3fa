"""`star_tracker.detection.saturation: automatic`: the largest grey value of the camera's detector.

So a scenario takes a camera of 8 bits or of 12, whichever it is given; a value is for a detector that
saturates below its largest grey value.
"""

from shefex_nav.scenario.block import AUTOMATIC
from shefex_nav.settings import declared
from shefex_nav.world.camera_settings import Detector

DETECTION, DETECTOR = ("star_tracker", "detection"), ("star_camera", "detector")
KEY, BITS = "saturation", "bits"


def filled(tree):
    """A tree with the value, which is the same tree if that is given or the detector is not known."""
    detection, detector = (_section(tree, path) for path in (DETECTION, DETECTOR))
    if detection is None or detector is None or detection.get(KEY, AUTOMATIC) != AUTOMATIC:
        return tree
    setting = declared(Detector)[BITS][1]
    bits, limits = str(detector.get(BITS, setting.default)), dict(setting.limits)
    if not bits.isdecimal() or not limits["at_least"] <= int(bits) <= limits["at_most"]:
        return tree  # what is wrong with it is told elsewhere
    tracker, inner = DETECTION
    with_value = {**detection, KEY: f"{2 ** int(bits) - 1} DN"}
    return {**tree, tracker: {**tree[tracker], inner: with_value}}


def _section(tree, path):
    """The section at a path of a tree, None if there is none."""
    for key in path:
        tree = tree.get(key) if isinstance(tree, dict) else None
    return tree if isinstance(tree, dict) else None
