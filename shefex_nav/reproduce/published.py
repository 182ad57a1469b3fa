"""Figures published in the papers, as data; units are in the names of the keys.

SHEFEX: the SHEFEX-2 star tracker and hybrid navigation system (DLR, 2011). BRIGHT: star identification with a
brightness reference (2014).
"""

SHEFEX = {
    "camera": {
        "width_px": 659,
        "height_px": 493,
        "pixel_um": 9.9,
        "focal_length_mm": 25.0,
        "calibrated_focal_length_mm": 24.95,
        "fov_x_deg": 14.87,
        "fov_y_deg": 11.15,
        "fov_diag_deg": 18.57,
        "bits": 8,
        "max_frame_rate_hz": 90,
        "exposure_limits_s": [1e-05, 10.0],
    },
    "requirements": {
        "attitude_error_deg": 0.1,
        "max_rate_deg_s": 2.0,
        "total_processing_ms": 100,
        "rate_hz": 10,
        "shutter_ms": 50,
        "sun_exclusion_deg": 90,
        "earth_exclusion_deg": 45,
        "baffle_half_angle_deg": 50,
        "mission_attitude_deg": 0.17,
    },
    "exposure_control": {
        "step_ms": 2,
        "max_ms": 50,
        "min_stars": 4,
        "saturated_objects": 4,
        "saturated_pixels_per_object_more_than": 1,
        "good_range_ms": [35, 50],
        "smear_limit_px": 4.5,
    },
    "scan_ms_on_650MHz": {"maximum_search": 110.0, "sequential": 9.9},
    "catalogue": {"stars": 2023, "pairs": 54804, "keep_all_to_mag": 4.5},
    "identification": {
        "random_attitudes": 1000,
        "max_centroids": 15,
        "cos_error": 5.5e-05,
        "cos_error_range": [5e-05, 6e-05],
        "expected_centroid_error_px": [0.1, 0.2],
        "centroid_error_at_0p1deg_yaw_px": 0.45,
        "success_simulated": 0.97,
        "success_night_sky": 0.9,
        "identified_up_to_deg_s": 2.0,
        "rarely_above_deg_s": 4.0,
    },
}

BRIGHT = {
    "camera": {
        "width_px": 1024,
        "height_px": 1024,
        "pixel_um": 15.0,
        "focal_length_mm": 43.3,
        "fov_deg": [20.0, 20.0],
        "centroid_error_arcsec_3sigma": 5.0,
        "detection_mag": 6.5,
        "catalogue_mag": 5.0,
    },
    "catalogue_counts": {"<3": 165, "3-4": 315, "4-5": 991, "5-6": 3088, "6-7": 9381},
    "protocol": {
        "orientations": 10000,
        "brightest_used": 10,
        "magnitude_sigma": 0.2,
        "reference_star_mag": 3.0,
    },
    "brightest_star": {"mean_difference_to_third_dimmest_mag": 2.16, "within_magnitude_accuracy": 0.9752},
    "table3": {
        "no_false_star": {
            "brightness_referenced": {"success": 0.9982, "ms": 0.77, "failed": 18, "wrong": 0},
            "pyramid": {"success": 0.9991, "ms": 3.93, "failed": 9, "wrong": 0},
            "geometric_voting": {"success": 0.9872, "ms": 28.87, "failed": 106, "wrong": 22},
        },
        "one_false_star_at_least_4_stars": {
            "brightness_referenced": {"success": 0.9876, "ms": 5.12, "failed": 118, "wrong": 6},
            "pyramid": {"success": 0.9925, "ms": 10.65, "failed": 0, "wrong": 75},
            "geometric_voting": {"success": 0.9787, "ms": 43.38, "failed": 175, "wrong": 38},
        },
        "one_false_star_at_least_5_stars": {
            "brightness_referenced": {"success": 0.997, "ms": 4.78, "failed": 14, "wrong": 16},
            "pyramid": {"success": 1.0, "ms": 10.36, "failed": 0, "wrong": 0},
            "geometric_voting": {"success": 0.9914, "ms": 44.27, "failed": 84, "wrong": 2},
        },
    },
    "table4": {
        "brightness_referenced": {"success": 1.0, "ms": 4.0, "failed": 0, "wrong": 0},
        "pyramid": {"success": 1.0, "ms": 13.49, "failed": 0, "wrong": 0},
        "geometric_voting": {"success": 0.992, "ms": 35.18, "failed": 0, "wrong": 8},
    },
}
