"""Figures of the SHEFEX-2 paper (star tracker, hybrid navigation system, DLR, 2011), units in the keys."""

SHEFEX = {
    "camera": {
        "width_px": 659,
        "height_px": 493,
        "pixel_um": 9.9,
        "focal_length_mm": 25.0,
        "calibrated_focal_length_mm": 24.95,
        "fov_diag_deg": 18.57,
    },
    "requirements": {
        "attitude_error_deg": 0.1,
    },
    "exposure_control": {
        "good_range_ms": [35, 50],
    },
    "scan_ms_on_650MHz": {"maximum_search": 110.0, "sequential": 9.9},
    "catalogue": {"stars": 2023, "pairs": 54804, "keep_all_to_mag": 4.5},
    "identification": {
        "random_attitudes": 1000,
        "max_centroids": 15,
        "cos_error": 5.5e-05,
        "centroid_error_at_0p1deg_yaw_px": 0.45,
        "success_simulated": 0.97,
        "success_night_sky": 0.9,
        "identified_up_to_deg_s": 2.0,
        "rarely_above_deg_s": 4.0,
    },
}
