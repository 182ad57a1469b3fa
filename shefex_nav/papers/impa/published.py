"""Figures of the paper on rolling-shutter compensation and Improved Multi-Poles (2019), units in the keys.

Columns of its tables are the rates, 0 or 1 to 5 deg/s; rows of `success_percent_by_images` are the images.
"""

IMPA = {
    "camera": {
        "width_px": 1024,
        "height_px": 1024,
        "pixel_um": 18.0,
        "focal_length_mm": 52.0,
        "fov_deg": [20.0, 20.0],
        "exposure_s": 0.2,
        "simulated_mag": 6.5,
        "catalogue_mag": 5.5,
        "catalogue_stars": 3349,
        "zero_mag_electrons_s": 7300000.0,
        "tau_pre_electrons": 500,
        "fusion_distance_px": 2,
        "psf_diameter_px": 3,
    },
    "noise": {
        "dark_mean_e": 100,
        "dark_std_e": 5,
        "stray_light_e": 6000,
        "read_std_e": 50,
        "shot": "poisson",
    },
    "protocol": {
        "attitudes": 200,
        "directions": 26,
        "rates_deg_s": [1, 2, 3, 4, 5],
        "max_images": 60,
        "min_images": 2,
        "tolerance_arcsec": 100,
        "accept_stars": 5,
        "success_arcsec": 360,
        "false_objects_worst_case": 50,
    },
    "centroid_error_std_px": {
        "global_shutter": {
            "horizontal": [0.165, 0.213, 0.26, 0.297, 0.328],
            "vertical": [0.176, 0.213, 0.254, 0.288, 0.323],
        },
        "rolling_compensated": {
            "horizontal": [0.377, 0.429, 0.441, 0.458, 0.461],
            "vertical": [0.344, 0.385, 0.404, 0.429, 0.44],
        },
        "rolling_uncompensated": {
            "horizontal": [1.52, 2.61, 3.39, 4.11, 4.87],
            "vertical": [1.54, 2.71, 3.61, 4.41, 5.25],
        },
    },
    "attitude_error_std_arcsec": {
        "best_case": {
            "global_shutter": {
                "roll": [13.44, 42.93, 70.97, 80.52, 94.11, 108.99],
                "pitch": [2.03, 5.5, 8.14, 9.78, 11.53, 13.41],
                "yaw": [1.83, 5.27, 8.38, 9.65, 12.13, 13.29],
            },
            "rolling_shutter": {
                "roll": [15.13, 153.35, 176.36, 172.27, 169.35, 184.89],
                "pitch": [2.04, 15.27, 17.98, 17.66, 18.75, 20.3],
                "yaw": [1.87, 12.67, 19.37, 21.29, 23.1, 24.3],
            },
        },
        "worst_case": {
            "global_shutter": {
                "roll": [16.37, 58.44, 58.58, 62.11, 75.08, 102.27],
                "pitch": [1.88, 6.48, 7.4, 7.6, 8.82, 11.27],
                "yaw": [2.08, 6.81, 7.04, 7.71, 9.2, 12.6],
            },
            "rolling_shutter": {
                "roll": [22.63, 171.52, 188.98, 168.0, 166.59, 173.88],
                "pitch": [2.31, 15.53, 18.94, 17.44, 17.56, 18.46],
                "yaw": [2.13, 13.64, 21.15, 21.84, 22.05, 22.82],
            },
        },
    },
    "success_percent_by_images": {
        "best_case": {
            "global_shutter": {
                2: [99.5, 97.69, 67.38, 38.67, 25.71, 17.79],
                10: [100.0, 99.56, 84.13, 56.75, 37.9, 27.77],
                20: [100.0, 99.79, 89.6, 67.35, 48.54, 36.29],
                30: [100.0, 99.88, 92.85, 73.65, 56.46, 44.13],
                40: [100.0, 100.0, 94.67, 79.02, 64.23, 51.71],
                50: [100.0, 100.0, 96.1, 83.63, 70.79, 58.46],
                60: [100.0, 100.0, 97.27, 87.29, 75.87, 64.1],
            },
            "rolling_shutter": {
                2: [98.5, 98.23, 63.96, 34.85, 22.58, 16.12],
                10: [100.0, 99.73, 82.29, 52.75, 34.0, 25.02],
                20: [100.0, 99.88, 88.58, 62.77, 43.17, 33.23],
                30: [100.0, 99.94, 91.94, 69.67, 52.12, 39.79],
                40: [100.0, 100.0, 93.96, 75.27, 58.63, 46.46],
                50: [100.0, 100.0, 95.58, 80.02, 65.4, 53.1],
                60: [100.0, 100.0, 96.71, 84.73, 70.33, 58.58],
            },
        },
        "worst_case": {
            "global_shutter": {
                2: [91.0, 79.44, 23.79, 14.73, 10.67, 9.06],
                10: [97.5, 92.62, 35.23, 21.0, 16.4, 13.23],
                20: [98.0, 94.98, 40.35, 24.96, 19.87, 16.27],
                30: [98.5, 96.13, 44.63, 28.5, 24.04, 19.37],
                40: [98.5, 96.87, 48.56, 31.73, 27.02, 22.4],
                50: [98.5, 97.42, 52.02, 34.71, 30.12, 25.54],
                60: [98.5, 98.13, 55.52, 37.42, 32.6, 28.62],
            },
            "rolling_shutter": {
                2: [91.5, 77.46, 23.12, 13.08, 10.21, 8.25],
                10: [97.5, 92.27, 32.98, 20.17, 14.69, 12.21],
                20: [97.5, 94.94, 37.77, 23.54, 17.71, 14.87],
                30: [97.5, 96.1, 41.58, 27.35, 21.44, 17.69],
                40: [98.0, 96.88, 45.65, 30.54, 24.46, 20.35],
                50: [98.0, 97.5, 48.79, 33.58, 26.94, 22.94],
                60: [98.0, 97.92, 51.85, 36.77, 29.54, 25.9],
            },
        },
    },
}

# Pearson's kurtosis of the centroid errors (3: normal), rates 1 to 5 deg/s; tables 3 to 5 as printed. The
# skewness printed beside it is below 0.11 and the mean below 0.017 px everywhere.
IMPA_KURTOSIS = {
    "global_shutter": {
        "horizontal": [5.83, 6.56, 7.85, 8.83, 9.15],
        "vertical": [5.22, 5.86, 6.78, 7.38, 7.84],
    },
    "rolling_compensated": {
        "horizontal": [4.25, 3.57, 3.83, 4.39, 4.51],
        "vertical": [4.15, 3.82, 3.91, 4.30, 4.34],
    },
    "rolling_uncompensated": {
        "horizontal": [3.04, 3.66, 4.26, 4.85, 5.05],
        "vertical": [2.99, 3.54, 4.16, 4.71, 4.93],
    },
}
