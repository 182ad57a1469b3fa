"""Lines of the closing table about the start of a replay: alignment and clocks."""


def alignment(found):
    """(name, text) of the object that `replay.said.alignment` makes."""
    angles = ", ".join(f"{angle:.1f}" for angle in found["roll_pitch_heading_deg"])
    sigmas = ", ".join(f"{sigma:.2g}" for sigma in found["sigma_north_east_down_deg"])
    yield found["method"], f"roll, pitch, heading {angles} deg at T{found['t_s']:+.1f} s"
    yield "1 sigma", f"{sigmas} deg about north, east, down"
    if found["searched_from_s"] is not None:
        since = f"not known at T{found['searched_from_s']:+.1f} s"
        yield "found in motion", f"{since}; the navigation begins where it was found"
    if found["gyro_bias_deg_s"]:
        bias = ", ".join(f"{rate:.3g}" for rate in found["gyro_bias_deg_s"])
        yield "gyro bias", f"{bias} deg/s, 1 sigma {found['sigma_gyro_bias_deg_s']:.2g} deg/s"


def clocks(found):
    """(name, text) of the object that `replay.said.clocks` makes; nothing where nothing is known."""
    if found["found_s"] is not None:
        seen = f"{1e3 * found['found_s']:+.1f} ms, 1 sigma {1e3 * found['sigma_s']:.1f} ms"
        yield "fixes are stamped", f"{seen}, later than the IMU has them, by comparing their motions"
    if found["applied_s"]:
        yield "corrected by", f"{1e3 * found['applied_s']:+.1f} ms, taken from the times of GNSS"
    if found["gps_latency_s"] is not None:
        seen = f"{1e3 * found['gps_latency_s']:+.1f} ms, 1 sigma {1e3 * found['sigma_gps_latency_s']:.1f} ms"
        yield "by the filter", f"fixes are {seen}, older than their times"


def barometer(found):
    """(name, text) of the object that `replay.air.highest` makes."""
    words = f"{found['pressure_altitude_m']:.0f} m above the start at T{found['t_s']:+.1f} s"
    yield "pressure altitude", f"{words}, by the standard atmosphere"
    yield (
        "height there",
        f"{found['height_m']:.0f} m above the start, 1 sigma {found['sigma_height_m']:.0f} m",
    )
    if found["warmer_by"] is not None:
        share = f"{100.0 * found['warmer_by']:+.1f} %, 1 sigma {100.0 * found['sigma_warmer_by']:.1f} %"
        yield "air below", f"warmer than the standard by {share}"
