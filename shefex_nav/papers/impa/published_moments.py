"""Means and skewness of the IMPA paper: centroids (tables 3 to 5) and attitudes (tables 6, 7, 10, 11).

Columns are the rates: 1 to 5 deg/s of the centroids, 0 to 5 of the attitudes.
"""

CENTROID_MEAN_PX = {
    "global_shutter": {
        "horizontal": [-0.000134, -0.00161, -0.000288, 0.00158, -0.0013],
        "vertical": [0.00039, 0.00122, -0.000498, 0.000598, 0.00287],
    },
    "rolling_compensated": {
        "horizontal": [0.000173, 0.00144, -0.00093, -0.000213, -0.000733],
        "vertical": [-0.00114, 0.000161, -0.00084, -0.00299, 0.00285],
    },
    "rolling_uncompensated": {
        "horizontal": [0.000607, 0.00401, -0.00397, 0.0157, -0.0125],
        "vertical": [0.00138, 0.0143, 0.00119, -0.00785, -0.0168],
    },
}
CENTROID_SKEWNESS = {
    "global_shutter": {
        "horizontal": [0.000313, -0.0297, -0.0128, 0.0323, -0.0431],
        "vertical": [0.00715, 0.0334, -0.0563, -0.00536, 0.106],
    },
    "rolling_compensated": {
        "horizontal": [0.00438, 0.00549, -0.00836, 0.0038, -0.0197],
        "vertical": [-0.00364, -0.00174, 0.00219, -0.0142, 0.00219],
    },
    "rolling_uncompensated": {
        "horizontal": [-0.000257, -0.00226, 0.00486, 0.000266, -0.00101],
        "vertical": [-7.48e-05, 0.00773, -0.00285, 0.0113, -0.015],
    },
}
ATTITUDE_MEAN_ARCSEC = {
    "best_case": {
        "global_shutter": {
            "roll": [0.5, 0.79, 2.5, 0.31, 1.4, -0.11],
            "pitch": [0.27, -0.01, -0.05, 0.0, -0.15, 0.21],
            "yaw": [0.1, -0.04, -0.02, 0.11, 0.09, 0.09],
        },
        "rolling_shutter": {
            "roll": [0.6, 3.99, -5.5, 4.96, -1.64, -1.1],
            "pitch": [0.23, -0.38, 1.37, 3.06, 4.03, 4.62],
            "yaw": [-0.07, 0.1, -0.14, -0.22, 0.24, -0.02],
        },
    },
    "worst_case": {
        "global_shutter": {
            "roll": [-0.24, -1.78, 1.65, -0.87, 0.97, -2.96],
            "pitch": [0.09, 0.03, -0.08, 0.1, 0.26, 0.45],
            "yaw": [0.19, 0.01, -0.12, 0.14, -0.37, -0.31],
        },
        "rolling_shutter": {
            "roll": [0.86, 1.94, -2.0, 1.56, -4.44, 0.5],
            "pitch": [0.3, -0.09, 2.53, 3.86, 3.22, 4.71],
            "yaw": [0.07, 0.03, 0.62, 0.19, -0.41, 0.21],
        },
    },
}
