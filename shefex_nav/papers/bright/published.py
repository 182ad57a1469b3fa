"""Figures of the brightness reference paper (star identification, 2014), units in the keys."""

BRIGHT = {
    "camera": {
        "width_px": 1024,
        "height_px": 1024,
        "pixel_um": 15.0,
        "focal_length_mm": 43.3,
        "fov_deg": [20.0, 20.0],
        "centroid_error_arcsec_3sigma": 5.0,
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
