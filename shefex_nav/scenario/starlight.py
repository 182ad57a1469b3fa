"""`star_camera.optics.zero_magnitude_flux` of a camera whose lens and detector are given in its place.

A file gives the flux, or `optics.f_number` (or `aperture`), `optics.transmission` and
`detector.quantum_efficiency`, from which it is computed (`environment.starlight`). One of the two that comes
on top of the other (extends, `use`, `--set`) takes its place; both in one file contradict each other.
"""

from typing import Annotated, NamedTuple

from pydantic import TypeAdapter, ValidationError

from shefex_nav.environment import starlight
from shefex_nav.scenario.document import REMOVED, dotted
from shefex_nav.scenario.of_settings import section
from shefex_nav.world import camera_settings

CAMERA = "star_camera"
FLUX = ("optics", "zero_magnitude_flux")
PUPIL = (("optics", "f_number"), ("optics", "aperture"))
REST = (("optics", "transmission"), ("detector", "quantum_efficiency"))
LENS = (*PUPIL, *REST)
FOCAL_LENGTH = ("optics", "focal_length")
SECTIONS = {"optics": camera_settings.Optics, "detector": camera_settings.Detector}
OF_LENS = {name: {key for inner, key in LENS if inner == name} for name in SECTIONS}  # keys by section
NEEDED = "f_number (or aperture) and transmission, and detector.quantum_efficiency"


class Light(NamedTuple):
    """From what the flux follows."""

    flux: float  # electron/s
    band: str  # silicon, V
    aperture: float  # m, diameter of the pupil
    transmission: float
    quantum_efficiency: float

    def words(self):
        """The product in words."""
        factors = [f"{1e-4 * starlight.photons_in_v():.3g} photon/s/cm2 of V"]
        if self.band != "V":
            factors.append(f"{starlight.factor(self.band):.2f} (bare silicon)")
        factors.append(f"pupil of {1e3 * self.aperture:.3g} mm")
        factors += [f"{100.0 * one:.3g} %" for one in (self.transmission, self.quantum_efficiency)]
        return f"{self.flux:.3g} electron/s = {' x '.join(factors)}"


def give_way(tree, updates, kept=()):
    """Take out of the camera of `tree` what `updates` on top of it give in another way, in place.

    kept : paths of the scenario that are to stay
    """
    old, new = (one.get(CAMERA) for one in (tree, updates))
    if not isinstance(old, dict) or not isinstance(new, dict):
        return
    flux, lens = given(new, FLUX), any(given(new, path) for path in LENS)
    gone = () if flux == lens else LENS if flux else (FLUX,)
    if flux != lens and not flux and not given(old, FLUX):
        gone = _other_pupil(new)
    for inner, key in gone:
        if given(old, (inner, key)) and (CAMERA, inner, key) not in kept:
            del old[inner][key]


def _other_pupil(new):
    """The path of the pupil that the other one takes the place of."""
    said = [path for path in PUPIL if given(new, path)]
    return tuple(path for path in PUPIL if path not in said) if len(said) == 1 else ()


def set_one(tree, path, value):
    """The same of a single value that is set at a path of the scenario."""
    if len(path) != 3 or path[0] != CAMERA or path[1:] not in (FLUX, *LENS) or value is REMOVED:
        return
    give_way(tree, {CAMERA: {path[1]: {path[2]: value}}})


def set_twice(told):
    """(Mark, text) of a flux that is set together with what it follows from, and of two pupils: list.

    told : sequence of (Mark, path of the scenario) of what is set
    """
    marks = {path: mark for mark, path in told}
    flux, lens = (CAMERA, *FLUX), [path for path in LENS if (CAMERA, *path) in marks]
    if all((CAMERA, *path) in marks for path in PUPIL):
        first, second = ((CAMERA, *path) for path in PUPIL)
        return [(marks[second], f"{dotted(second)}: {dotted(first)} is set too; set one of them")]
    if flux not in marks or not lens:
        return []
    words = f"{dotted((CAMERA, *lens[0]))}, from which it follows, is set too; set one of them"
    return [(marks[flux], f"{dotted(flux)}: {words}")]


def filled(tree, places):
    """A tree with the flux of its star camera, which is the same tree if that is given or cannot be known.

    -> tree, list of (Mark, text) of what is missing or contradicts itself
    """
    camera = tree.get(CAMERA)
    if not isinstance(camera, dict) or not all(isinstance(camera.get(name), dict) for name in SECTIONS):
        return tree, []
    lens = [path for path in LENS if given(camera, path)]
    if given(camera, FLUX):
        if not lens:
            return tree, []
        words = f"{FLUX[1]} says so too; keep it, or {NEEDED}, from which it follows"
        return tree, [_line(places, path, words) for path in lens[:1]]
    if not lens:
        return tree, _missing(camera, places)
    wrong = list(_incomplete(camera, places))
    if wrong or not (light := of_camera(camera)):
        return tree, wrong
    optics = {**camera["optics"], FLUX[1]: f"{light.flux!r} electron/s"}
    return {**tree, CAMERA: {**camera, "optics": optics}}, []


def of_camera(camera):
    """Light of the camera of a tree, whose pupil, transmission and quantum efficiency are given.

    None if one of them is not, or cannot be read: that is told elsewhere.
    """
    band = camera["stars"].get("band") if isinstance(camera.get("stars"), dict) else "silicon"
    try:
        found = [_value(camera, path) for path in (PUPIL[1], PUPIL[0], FOCAL_LENGTH, *REST)]
    except ValidationError:
        return None
    aperture, f_number, focal_length, transmission, efficiency = found
    if aperture is None and f_number is not None and focal_length is not None:
        aperture = focal_length / f_number
    if None in (aperture, transmission, efficiency) or band not in starlight.BANDS:
        return None
    flux = starlight.zero_magnitude_flux(band, aperture, transmission, efficiency)
    return Light(flux, band, aperture, transmission, efficiency)


def of_section(camera):
    """Light of a section star_camera that has been read; None if its flux was given."""
    optics, detector = camera.optics, camera.detector
    if detector.quantum_efficiency is None:
        return None
    aperture = optics.aperture or optics.focal_length / optics.f_number
    return Light(
        optics.zero_magnitude_flux,
        camera.stars.band,
        aperture,
        optics.transmission,
        detector.quantum_efficiency,
    )


def given(camera, path):
    """Whether a tree of a camera has a value at a path."""
    inner = camera.get(path[0])
    return isinstance(inner, dict) and inner.get(path[1]) is not None


def _value(camera, path):
    """The value at a path in SI, None if there is none."""
    if not given(camera, path):
        return None
    field = section(SECTIONS[path[0]]).model_fields[path[1]]
    return TypeAdapter(Annotated[field.annotation, field]).validate_python(camera[path[0]][path[1]])


def _missing(camera, places):
    """Neither the flux nor what it follows from, unless one of them may be there under a misspelt name."""
    if any(camera[name].keys() - section(one).keys().keys() for name, one in SECTIONS.items()):
        return []
    words = f"is missing; expected for example '{FLUX[1]}: 2.5e6 electron/s', or {NEEDED}"
    return [_line(places, FLUX, words)]


def _incomplete(camera, places):
    """(Mark, text) of what the flux cannot be computed without, or with."""
    pupils = [path for path in PUPIL if given(camera, path)]
    if len(pupils) == 2:
        yield _line(places, pupils[1], "f_number says so too; keep one of them")
    missing = [] if pupils else [PUPIL[0]]
    for path in [*missing, *(one for one in REST if not given(camera, one))]:
        example = section(SECTIONS[path[0]]).model_fields[path[1]]
        shown = next(spec.example for spec in _specs(example) if hasattr(spec, "example"))
        yield _line(
            places,
            path,
            f"is missing; the flux of a star follows from {NEEDED}, such as '{path[1]}: {shown}'",
        )


def _specs(field):
    from shefex_nav.scenario.messages import bare

    return bare(field.annotation, tuple(field.metadata))[1]


def _line(places, path, words):
    """(Mark, text) about a value of the camera."""
    return places.wrong((CAMERA, *path), words)
