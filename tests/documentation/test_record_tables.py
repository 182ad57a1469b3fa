"""The tables of records for own software have the fields that the records have."""

import re
from pathlib import Path

import numpy as np
import pytest

from shefex_nav import records
from shefex_nav.geometry import frames, rotation, wgs84

PAGE = (Path(__file__).parents[2] / "docs" / "reference" / "records.md").read_text(encoding="utf-8")
MODULES = {"frames": frames, "rotation": rotation, "wgs84": wgs84}


@pytest.mark.parametrize(
    "record",
    [records.ImuBlock, records.GpsFix, records.StarFix, records.Alignment],
    ids=lambda one: one.__name__,
)
def test_a_table_names_each_field_once_and_in_order(record):
    (table,) = re.findall(rf"^\| `{record.__name__}` \|.*\n\|[-|]+\n((?:\|.*\n)+)", PAGE, re.M)
    told = [name for row in table.splitlines() for name in re.findall(r"`(\w+)`", row.split("|")[1])]
    assert told == sorted(record._fields, key=told.index) and len(set(told)) == len(record._fields)


def test_the_functions_that_are_named_exist_with_these_arguments():
    (table,) = re.findall(r"^\| function \|.*\n\|[-|]+\n((?:\|.*\n)+)", PAGE, re.M)
    named = re.findall(r"`(frames|rotation|wgs84)\.(\w+)(?:\(([^)]*)\))?`", table)
    assert len(named) >= 10
    for module, name, arguments in named:
        function = getattr(MODULES[module], name)
        if arguments:
            taken = function.__code__.co_argcount if hasattr(function, "__code__") else None
            taken = function.py_func.__code__.co_argcount if taken is None else taken
            assert taken == len(arguments.split(",")), name


def test_the_position_of_the_imu_is_computed_as_the_page_says():
    """The position of the IMU is that of the antenna less its arm, both in inertial axes."""
    block = next(one for one in re.findall(r"```python\n(.*?)```", PAGE, re.S) if "imu_position_i" in one)
    names = {}
    exec(block, names)
    q = rotation.quat_from_rotvec(np.array([0.3, -1.2, 0.4]))
    earth = frames.EarthRotation(np.eye(3), np.eye(3), 0.7, 7.292115e-5)
    arm, r_i = np.array([0.5, -0.2, 0.1]), np.array([6.4e6, 1.0e6, 2.0e6])
    antenna_i = r_i + rotation.dcm_from_quat(q) @ arm
    r_e = frames.dcm_ie(earth, 20.0).T @ antenna_i

    class Given:
        t_valid_s, r_ea_e = 20.0, r_e
        l_ba_b = arm

    Given.earth = earth
    assert names["imu_position_i"](Given, q, Given) == pytest.approx(r_i, abs=1e-6)
