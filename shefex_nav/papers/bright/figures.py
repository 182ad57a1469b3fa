"""Figures 3, 4 and 7 of the BRIGHT paper."""

import numpy as np

from shefex_nav.papers.bright import fields
from shefex_nav.papers.picture import COLOURS, tidy


def draw_brightest(figure, results, rows):
    """Figure 3, the brightest star; the third dimmest; figure 4, P by index; figure 7, stars by light."""
    table = np.vstack(results)
    seen = table[table[:, 0] >= 4]
    figure.set_size_inches(11.0, 8.0)
    (brightest, third), (ascending, light) = figure.subplots(2, 2)
    brightest.hist(seen[:, 1], bins=np.arange(-1.5, 5.01, 0.25), color=COLOURS[0])
    brightest.set_xlabel("Hp of the brightest star (figure 3)")
    for column, words, colour in ((2, "of ten", COLOURS[0]), (3, "of all", COLOURS[1])):
        third.hist(seen[:, column], np.arange(0.0, 6.01, 0.2), histtype="step", color=colour, label=words)
    published = next(row.published for row in rows if row.quantity.startswith("third dimmest"))
    third.axvline(published, color="0.3", ls=":", label="mean, published")
    third.set_xlabel("third dimmest less brightest [mag]")
    third.legend(frameon=False)
    for axis in (brightest, third):
        axis.set_ylabel("images")
    pairs = fields.pairs()[0]
    ascending.plot(np.arange(1, len(pairs.cosine) + 1), pairs.cosine, color=COLOURS[0])
    ascending.set_xlabel(f"index, of {len(pairs.cosine)} pairs (figure 4)")
    ascending.set_ylabel("P, cosine of the angle")
    flux = 10.0 ** (-0.4 * np.sort(pairs.stars.vmag))
    light.semilogy(np.arange(1, len(flux) + 1), flux, ".", ms=3, color=COLOURS[0])
    light.set_xlabel("stars by brightness (figure 7)")
    light.set_ylabel("light, 1 at magnitude 0")
    for axis in (brightest, third, ascending, light):
        tidy(axis)
