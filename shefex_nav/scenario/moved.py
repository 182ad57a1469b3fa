"""Keys that scenarios of earlier versions have: where they are now."""

_NOW = {  # path: what to write instead of a value, and of null
    ("requirements", "attitude_at_entry"): (
        "requirements.attitude: {{limit: {value}, at_entry: true}}",
        "requirements.attitude: {at_entry: false}",
    ),
    ("requirements", "protection_at_entry"): (
        "requirements.attitude: {{limit: {value}, protection_at_entry: true}}",
        "requirements.attitude: {protection_at_entry: false}",
    ),
    ("requirements", "position_at_entry"): (
        "requirements.position: {{limit: {value}, at_entry: true}}",
        "requirements.position: {at_entry: false}",
    ),
    ("requirements", "velocity_at_entry"): (
        "requirements.velocity: {{limit: {value}, at_entry: true}}",
        "requirements.velocity: {at_entry: false}",
    ),
    ("navigation", "integrity", "risk"): (
        "requirements.integrity_risk: 1e-5 /h",  # per hour of use; the old one was per independent error
        "requirements.integrity_risk: 1e-5 /h",
    ),
    ("principal_point",): (
        "star_camera: {{optics: {{principal_point: {value}}}}}",
        "star_camera: {optics: {principal_point: null}}",
    ),
    ("distortion",): (
        "star_camera: {{optics: {{distortion: {value}}}}}",
        "star_camera: {optics: {distortion: null}}",
    ),
    ("navigation", "integrity", "attitude"): (
        "requirements.attitude: {{limit: {value}}}",
        "requirements.attitude: {limit: null}",
    ),
}


def words(path, value=None):
    """What is said of a key that has moved; "" of any other.

    path : tuple of keys;  value : as it was given, None for null
    """
    if path not in _NOW:
        return ""
    given, taken = _NOW[path]
    return f"has moved; write '{taken if value is None else given.format(value=value)}'"
