"""A folder of frames: pictures, their truth, the camera.

PICTURES frame_000001.png or .fits, in the order of their numbers; `truth.csv`; `camera.yaml`, the camera as
the flight software knows it; `camera_true.yaml`, as it is in this run.
"""

from shefex_nav.files import put
from shefex_nav.frames import camera_file, header, picture_files, truth

TRUTH, TOLD, TRUE = "truth.csv", "camera.yaml", "camera_true.yaml"


def write(folder, flight, shots, kind="png"):
    """Write Shots of a Flight into a folder, which is there, one after the other.

    kind : of picture_files.FORMATS

    Yields
    ------
    Shot, each when its file is written; truth and cameras are written at the end, of an early end too
    """
    scenario, mission = flight.scenario, flight.scenario.mission
    camera, rows = camera_file.true_lens(scenario, flight.world), []
    try:
        for shot in shots:
            if not rows:
                _take_away(folder)
            name = f"frame_{shot.frame.number:06d}.{kind}"
            told = header.keywords(shot, mission, flight.seed) | header.angles(shot.truth.q_ic, camera)
            if kind == "fits":
                told |= header.wcs(shot.truth.q_ic, camera)
            picture_files.write(folder / name, shot.frame.image_dn, told)
            rows.append(truth.row(name, shot, mission.epoch))
            yield shot
    finally:  # of an export that ends early, what there is has its truth
        if rows:
            truth.write(folder / TRUTH, rows)
            for name, true in ((TOLD, False), (TRUE, True)):
                text = camera_file.written(scenario, flight.world, true=true)
                put(folder / name, text)


def _take_away(folder):
    """Frames of an earlier export: those of another flight would have no truth."""
    for ending in picture_files.FORMATS:
        for name in folder.glob(f"frame_*.{ending}"):
            name.unlink()
