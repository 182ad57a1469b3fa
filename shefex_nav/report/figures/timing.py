"""How long the computations took, by the clock on the wall.

A program that waits while the machine does something else has that time in it. On two cores with five other
programs 20 % of the frames took 5 or 9 ms in place of 0.7: 99 % of these had been interrupted, 2 % of the
others, and the processor had worked on them for 1.0 ms.
"""

import numpy as np

from shefex_nav.report.figures import style


@style.styled
def chain(data):
    """Time of the star tracker's chain. RunData -> Figure; None without frames."""
    times = data.compute_times
    chosen = np.isfinite(times.chain_s) & (times.chain_s > 0.0)
    if not chosen.any():
        return None
    t_s, chain_ms = times.t_s[chosen], 1e3 * times.chain_s[chosen]
    figure = style.figure(4.1)
    style.title(figure, "Time that the star tracker's chain took for a frame")
    spec = style.grid(figure, [2.6], columns=2, left=0.9, between=0.8, below=0.3)
    over_time, share = figure.add_subplot(spec[0, 0]), figure.add_subplot(spec[0, 1])
    style.dots(over_time, t_s, chain_ms, color=style.BLUE)
    style.log_scale(over_time)
    over_time.set_xlabel(style.time_label(data))
    over_time.set_ylabel("time [ms]")
    ordered = np.sort(chain_ms)
    percent = 100.0 * np.arange(1, len(ordered) + 1) / len(ordered)
    shown = style.envelope(ordered)
    share.plot(ordered[shown], percent[shown], color=style.BLUE, drawstyle="steps-post")
    median, p99 = np.percentile(chain_ms, [50, 99])
    for value, name, dashes in ((median, "median", "--"), (p99, "99 %", ":")):
        share.axvline(value, color=style.BLACK, lw=1.0, ls=dashes, label=f"{name}: {value:.2f} ms")
    share.set_xlim(0.0, 1.3 * float(np.percentile(chain_ms, 99.5)))
    share.set_ylim(0.0, 100.5)
    share.set_xlabel("time [ms]")
    share.set_ylabel("frames done [%]")
    style.legend_above(share)
    words = "Wall-clock times: work of other programs is in them, loading of compiled code in the first ones"
    figure.text(0.01, 0.01, words, ha="left", va="bottom", fontsize=9, color=style.GREY)
    return figure
