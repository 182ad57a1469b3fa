"""A column of a CSV is one quantity."""

import pytest
from pydantic import ValidationError

from shefex_nav.replay.schema_data import GnssColumns, ImuColumns

IMU = {"file": "a.csv", "rate": "200 Hz", "time": "t", "gyro": ["x", "y", "z"], "gyro_unit": "deg/s",
       "accelerometer": ["u", "v", "w"], "accelerometer_unit": "m/s2"}  # fmt: skip


@pytest.mark.parametrize(("more", "words"), [
    ({"gyro": ["x", "x", "z"]}, "column 'x' is given for gyro.0 and for gyro.1"),
    ({"accelerometer": ["u", "z", "w"]}, "column 'z' is given for gyro.2 and for accelerometer.1"),
    ({"time": "x"}, "column 'x' is given for time and for gyro.0"),
])  # fmt: skip
def test_one_column_for_two_quantities_is_refused(more, words):
    ImuColumns.model_validate(IMU)
    with pytest.raises(ValidationError, match=words):
        ImuColumns.model_validate(IMU | more)


def test_one_sigma_may_be_of_two_axes():
    """And the number of satellites may say whether there is a fix."""
    GnssColumns.model_validate({
        "file": "g.csv", "time": "t", "position": ["a", "b", "c"], "position_sigma": ["s", "s", "h"],
        "valid": "n", "satellites": "n",
    })  # fmt: skip
