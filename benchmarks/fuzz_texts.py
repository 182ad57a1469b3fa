"""Kinds of `fuzz`: heads of pictures, winds, studies and models, read and looked at."""

import json
from functools import partial

import fuzz_fits
import fuzz_programs
import fuzz_tables
import numpy as np
from fuzz_kind import Kind

from shefex_nav.errors import UserError
from shefex_nav.scenario import load


class Heads(Kind):
    """FITS pictures with other cards in their head."""

    def __init__(self, folder):
        super().__init__(folder)
        self.content = fuzz_fits.with_cards(fuzz_programs.picture(self.folder / "whole.fits"))

    def case(self, rng):
        (self.folder / "case.fits").write_bytes(fuzz_fits.spoilt(rng, self.content))

    def read(self, _rng):
        from shefex_nav.solve import header, picture

        try:
            header.of_header(picture.stored(self.folder / "case.fits").header)
        except ValueError as error:
            raise UserError(str(error)) from None
        if not np.isfinite(picture.read(self.folder / "case.fits").grey).all():
            raise ValueError("a picture with what is no number")


class Texts(Kind):
    """Texts of other programs with other numbers in them. texts : those of this kind"""

    texts = ()

    def case(self, rng):
        self.chosen = int(rng.integers(len(self.texts)))
        text = fuzz_tables.spoilt(rng, self.texts[self.chosen])
        (self.folder / "case.txt").write_text(text, encoding="utf-8")


class Winds(Texts):
    """Soundings, a forecast, a table of wind: what is read is a wind that there can be."""

    texts = fuzz_tables.LIST, fuzz_tables.CSV, fuzz_tables.forecast(), fuzz_tables.TABLE

    def read(self, _rng):
        from shefex_nav.scenario import soundings

        path = self.folder / "case.txt"
        if self.chosen < len(self.texts) - 1:
            told = soundings.read(path, "2011-02-22T12:56:00").override()
        else:
            told = f"wind={{file: {path}}}"
        wind = load.load("rexus_like", [told]).wind
        steps = np.diff(wind.height)
        if not (np.isfinite(wind.speed).all() and max(wind.speed) <= 300.0 and (steps > 0.0).all()):
            raise ValueError(f"no wind: {wind}")


class Models(Texts):
    """A DAVE-ML model and a trajectory of a check-case."""

    texts = fuzz_tables.MODEL, fuzz_tables.CASE

    def read(self, _rng):
        from shefex_nav.verify import data as nesc
        from shefex_nav.verify import daveml

        if self.chosen:
            nesc.on_grid(nesc.read_series(self.folder / "case.txt"), np.linspace(0.0, 0.3, 4), "mach")
            return
        model = daveml.read(self.folder / "case.txt")
        for wanted in ("y", "z"):
            if not np.isfinite(found := daveml.evaluate(model, wanted, x=12.0)):
                raise ValueError(f"{wanted} is {found}")


class Studies(Texts):
    """Lines of `verify robustness`, read back."""

    def __init__(self, folder):
        super().__init__(folder)
        words = "verify robustness rexus_like --cells 0,1,2,3,4,5 --flights 1 --out study --jobs 1"
        fuzz_programs.carry_out(words.split(), folder)
        self.texts = ((self.folder / "study" / "flights.jsonl").read_text(),)

    def read(self, _rng):
        from shefex_nav.verify.robustness import flight, lines

        found, _ = lines.read(self.folder / "case.txt", partial(flight.seed_of, 0))
        for one in found:
            json.dumps(one, allow_nan=False)
