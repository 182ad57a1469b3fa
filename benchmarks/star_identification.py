"""Star identification on random fields: our methods and other packages on the same ones, side by side.

'possible' is a field with at least four catalogue stars (three with a good prediction): the ceiling; 'wrong'
is an attitude more than 0.5 deg off, or any from noise. The fields are drawn in V, which is told. A time is
the processor's for one call. Peers have environments of their own (`peers/`), made at the first run, and see
the first --peer-samples fields.

    uv run python benchmarks/star_identification.py [--samples 1000] [--methods default tetra3rs] [--markdown]
"""

import argparse
import json
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import star_fields
import streak_fields
from peers.run import PEERS, Unavailable, run, write_fields
from star_fields import CUT, EPOCH

from shefex_nav.geometry.rotation import rotvec_between
from shefex_nav.solve.centroids import METHODS, solve_centroids

CASES = {**star_fields.CASES, **streak_fields.CASES}
WRONG = np.radians(0.5)
NOT_BESIDE = {"bayes", "multipole"}  # the first is the default; the other needs fluxes with a zero point
OURS = ["default", *(name for name in METHODS if name not in NOT_BESIDE)]
WARM_UP = 20
SPARSE = ("0 false", "15 false", "tracking, 0.05 deg off")  # cases shown by number of stars
QUANTILES = {"median": 50, "p95": 95, "p99": 99, "max": 100}
BY_STARS = {
    "3": (3, 4),
    "4": (4, 5),
    "5": (5, 6),
    "6": (6, 7),
    "7-8": (7, 9),
    "9-11": (9, 12),
    "12+": (12, 10_000),
}


def say(text):
    """Progress."""
    print(text, file=sys.stderr, flush=True)


def source(case):
    """The module that a case's fields come from."""
    return star_fields if case in star_fields.CASES else streak_fields


def stars_needed(case):
    """Catalogue stars without which a field is not counted: four, three with a good prediction."""
    return 3 if CASES[case].get("predicted") == 0.05 else 4


def solve_all(method, camera, fields):
    """One of our methods over fields: q_ci (n, 4), NaN if unsolved; processor time (n,) [ms] a call."""
    q_ci, elapsed_ms = np.full((len(fields), 4), np.nan), np.empty(len(fields))
    for k, field in enumerate(fields):
        tracked = field.prediction is not None and method == "default"  # the others have no tracking
        options = {"prediction": field.prediction} if tracked else {}
        options |= {} if field.P_px is None else {"centroid_covariance_px": field.P_px}
        begin = time.process_time()
        found = solve_centroids(
            field.xy_px, field.flux, camera=camera, epoch=EPOCH, method=method, band="V", **options
        )
        elapsed_ms[k] = 1e3 * (time.process_time() - begin)
        if found.status == "ok":
            q_ci[k] = found.q_ci
    return q_ci, elapsed_ms


def judge(case, method, fields, q_ci, elapsed_ms):
    """Counts and times of one method on the fields of one case."""
    n_stars = np.array([field.n_stars for field in fields])
    ok = np.isfinite(q_ci[:, 0])
    error = np.full(len(fields), np.inf)
    for k in np.flatnonzero(ok):
        error[k] = np.linalg.norm(rotvec_between(q_ci[k] / np.linalg.norm(q_ci[k]), fields[k].q_ci))
    is_noise = CASES[case].get("n_false", 0) is None
    right = ok & (error < WRONG) & (not is_noise)
    possible = n_stars >= stars_needed(case)
    return {
        "case": case,
        "method": method,
        "samples": len(fields),
        "possible": int(possible.sum()),
        "solved": int((right & possible).sum()),
        "wrong": int((ok & ~right).sum()),
        "ms": {name: float(np.percentile(elapsed_ms, q)) for name, q in QUANTILES.items()},
        "by_stars": {
            name: [int((right & at).sum()), int(at.sum())]
            for name, (low, high) in BY_STARS.items()
            for at in [(n_stars >= low) & (n_stars < high)]
        },
    }


def run_ours(method, fields_of):
    """Results of one of our methods, case after case."""
    for case, fields in fields_of.items():
        solve_all(method, source(case).CAMERA, fields[:WARM_UP])  # compile, build the catalogue
    for case, fields in fields_of.items():
        yield judge(case, method, fields, *solve_all(method, source(case).CAMERA, fields))


def run_peer(name, fields_of):
    """Results of another package, case after case."""
    with tempfile.TemporaryDirectory() as folder:
        files = {f"case{k:02d}.npz": case for k, case in enumerate(fields_of)}
        for file, case in files.items():
            write_fields(Path(folder) / file, fields_of[case], source(case).CAMERA, EPOCH, CUT)
        for file, q_ci, elapsed_ms in run(name, folder, list(files), say):
            yield judge(files[file], name, fields_of[files[file]], q_ci, elapsed_ms)


def measure(methods, cases, samples, peer_samples, seed):
    """(results, {peer: why it could not run}); progress on stderr."""
    say(f"{len(cases)} cases, {samples} fields each")
    fields_of = {case: source(case).make_fields(case, samples, seed) for case in cases}
    first_of = {case: fields[:peer_samples] for case, fields in fields_of.items()}
    results, missing = [], {}
    for method in methods:
        is_peer = method in PEERS
        try:
            for result in (run_peer if is_peer else run_ours)(method, first_of if is_peer else fields_of):
                results.append(result)
                say(line(result))
        except Unavailable as error:
            missing[method] = str(error)
            say(f"{method}: not available: {error}")
    results.sort(key=lambda r: cases.index(r["case"]))
    return results, missing


HEADER = (
    f"{'case':32s} {'method':18s} {'solved':>6s} / {'possible':8s}      % {'four stars':>11s} "
    f"{'wrong':>5s}   {'median':>7s} {'p95':>8s} {'p99':>8s} {'max ms':>8s}"
)


def share(solved, possible):
    """Success in per cent, as text."""
    return f"{100.0 * solved / possible:.2f}" if possible else "-"


def line(r):
    """One result as a line of the table under HEADER."""
    return (
        f"{r['case']:32s} {r['method']:18s} {r['solved']:6d} / {r['possible']:<8d} "
        f"{share(r['solved'], r['possible']):>6s} "
        f"{'/'.join(str(count) for count in r['by_stars']['4']):>11s} {r['wrong']:5d}   "
        + " ".join(f"{r['ms'][name]:8.3f}" for name in QUANTILES)
    )


def matrix(results, cell, first_column, rows_of):
    """Markdown table: rows by rows_of(result), a column for each method."""
    methods = list(dict.fromkeys(r["method"] for r in sorted(results, key=lambda r: order_of(r["method"]))))
    lines = ["| " + " | ".join([first_column, *methods]) + " |", "|---" * (len(methods) + 1) + "|"]
    table = {}
    for r in results:
        table.setdefault(rows_of(r), {})[r["method"]] = cell(r)
    for name, cells in table.items():
        lines.append("| " + " | ".join([name, *(cells.get(m, "") for m in methods)]) + " |")
    return "\n".join(lines)


def order_of(method):
    """Place of a method in a table."""
    return [*OURS, *PEERS].index(method)


def markdown(results, missing, seed):
    """The tables for a document: success with wrong ones, times, success by number of stars."""
    samples = ", ".join(f"{r['method']} {r['samples']}" for r in {r["method"]: r for r in results}.values())
    text = [
        f"Seed {seed}; fields a case: {samples}.",
        "Success in per cent of the possible fields, in brackets wrong attitudes:",
        matrix(
            results,
            lambda r: f"{share(r['solved'], r['possible'])} ({r['wrong']})",
            "case",
            lambda r: r["case"],
        ),
        "Processor time of a call in ms, median / p95 / p99 / max:",
        matrix(
            results,
            lambda r: " / ".join(f"{r['ms'][name]:.3g}" for name in QUANTILES),
            "case",
            lambda r: r["case"],
        ),
        "Success in per cent by number of catalogue stars in the frame:",
        matrix(
            [
                {**r, "stars": name}
                for r in results
                for name, (low, _) in BY_STARS.items()
                if r["case"] in SPARSE and low >= stars_needed(r["case"])
            ],
            lambda r: share(*r["by_stars"][r["stars"]]),
            "case, stars",
            lambda r: f"{r['case']}, {r['stars']}",
        ),
    ]
    used = {r["method"] for r in results}
    text += [f"{name} ({', '.join(p.packages)}): {p.note}." for name, p in PEERS.items() if name in used]
    text += [f"{name}: not available: {why}" for name, why in missing.items()]
    return "\n\n".join(text)


def arguments():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--samples", type=int, default=1000, help="fields a case")
    parser.add_argument("--peer-samples", type=int, default=500, help="of them for the peers, some are slow")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--cases", nargs="*", default=list(CASES), choices=list(CASES), metavar="CASE")
    parser.add_argument(
        "--methods",
        nargs="*",
        default=[*OURS, *PEERS],
        choices=[*OURS, *PEERS],
        metavar="METHOD",
        help=", ".join([*OURS, *PEERS]),
    )
    parser.add_argument("--json", help="write the results there")
    parser.add_argument("--markdown", action="store_true", help="print tables for a document instead")
    return parser.parse_args()


def main():
    args = arguments()
    results, missing = measure(args.methods, args.cases, args.samples, args.peer_samples, args.seed)
    if args.markdown:
        print(markdown(results, missing, args.seed))
    else:
        print("\n".join([HEADER, *(line(r) for r in results)]))
        for name, why in missing.items():
            print(f"{name}: not available: {why}")
    if args.json:
        report = {"seed": args.seed, "results": results, "not_available": missing}
        Path(args.json).write_text(json.dumps(report, indent=1), encoding="utf-8")


if __name__ == "__main__":
    main()
