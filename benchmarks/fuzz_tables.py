"""Winds, studies and models of other programs with wrong values in their text, for `fuzz`."""

import json
import re

NUMBER = re.compile(r"-?\d+(?:\.\d+)?")
ODD = (
    "0", "-1", "1e300", "-1e300", "1e400", "nan", "inf", "1_0", "0x10", "１２", "x", "", "'", "900", "1e9",
    "99999999999999999999", "true", "null", "[]", "{}", "\x00", "é",
)  # fmt: skip
LIST = """02185 Lulea Observations at 12Z 22 Feb 2011

-----------------------------------------------------------------------------
   PRES   HGHT   TEMP   DWPT   RELH   MIXR   DRCT   SKNT   THTA   THTE   THTV
    hPa     m      C      C      %    g/kg    deg   knot     K      K      K
-----------------------------------------------------------------------------
 1013.0     34  -20.1  -22.8     79   0.55    320      4  252.1  253.6  252.2
  925.0    713  -15.9  -18.4     81   0.88    350     10  263.1  265.6  263.2
  500.0   5180  -38.1  -45.1     48   0.12    285     32  286.5  287.0  286.5
   10.0  30480  -60.0  -90.0      1   0.01    270     60  795.0  795.0  795.0

Station latitude: 65.54
Station longitude: 22.11
"""
CSV = """longitude,latitude,pressure_hPa,geopotential height_m,temp_C,wind direction_deg,wind speed_m/s
22.1,65.5,1013.0,34,-20.1,320,2.0
22.1,65.5,1003.0,110,-20.0,321,2.1
22.3,65.6,500.0,5180,-38.1,285,16.0
"""
TABLE = "height_m,speed_m_s,from_deg\n0,3,320\n500,5,330\n5000,16,285\n30000,40,270\n"
MODEL = """<DAVEfunc><variableDef varID="x" units="deg" minValue="-5" maxValue="90"/>
<variableDef varID="y" units="ft" initialValue="3.5"><calculation><math><apply><times/><cn>2.5</cn>
<apply><plus/><ci>x</ci><cn>1</cn></apply></apply></math></calculation></variableDef>
<variableDef varID="z"/><breakpointDef bpID="b"><bpVals>0, 10, 20</bpVals></breakpointDef>
<griddedTableDef gtID="g"><breakpointRefs><bpRef bpID="b"/></breakpointRefs>
<dataTable>1.5, 2.5, 4.5</dataTable>
</griddedTableDef><function name="f"><independentVarRef varID="x"/><dependentVarRef varID="z"/><functionDefn>
<griddedTableRef gtID="g"/></functionDefn></function></DAVEfunc>
"""
CASE = "time,altitudeMsl_ft,mach\n0.0,1000.5,0.0\n0.1,1001.0,0.1\n0.2,1003.0,\n0.3,1006.0,0.3\n"
FORECAST = {"latitude": 65.5, "longitude": 22.1, "utc_offset_seconds": 0, "hourly_units": {}, "hourly": {}}
UNITS = {"wind_speed": "km/h", "wind_direction": "°", "geopotential_height": "m"}


def forecast():
    """An answer of Open-Meteo, as text."""
    found = json.loads(json.dumps(FORECAST))
    found["hourly"]["time"] = ["2011-02-22T12:00", "2011-02-22T13:00"]
    for level, *values in ((1000, 18, 250, 110), (850, 40, 260, 1450), (500, 72, 270, 5400)):
        for (name, unit), value in zip(UNITS.items(), values, strict=True):
            found["hourly"][f"{name}_{level}hPa"] = [value, value + 1]
            found["hourly_units"][f"{name}_{level}hPa"] = unit
    return json.dumps(found)


def spoilt(rng, text):
    """A text with one or two numbers replaced, a row doubled, left out, moved or cut, or the end cut off."""
    for _ in range(1 + rng.integers(2)):
        lines, way = text.splitlines(keepends=True), rng.integers(8)
        at = int(rng.integers(len(lines))) if lines else 0
        if way <= 3 and (found := list(NUMBER.finditer(text))):
            one = found[rng.integers(len(found))]
            text = text[: one.start()] + ODD[rng.integers(len(ODD))] + text[one.end() :]
        elif way == 4 and lines:
            text = "".join([*lines[: at + 1], *lines[at:]])
        elif way == 5 and lines:
            text = "".join(lines[:at] + lines[at + 1 :])
        elif way == 6 and lines:
            other = int(rng.integers(len(lines)))
            lines[at], lines[other] = lines[other], lines[at]
            text = "".join(lines)
        elif lines:
            lines[at] = lines[at][: rng.integers(len(lines[at]) + 1)] + "\n" * int(rng.integers(2))
            text = "".join(lines)
    return text
