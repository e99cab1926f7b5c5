#!/usr/bin/env python3
"""Do the intervals of a posterior hold for a simulator that scatters? Its own runs tell.

    left-out.py CASE OUT [NUMBER]

OUT is a calibration of CASE by gl-calibrate. NUMBER of its runs (40), drawn by seed, are each taken for a measurement: its curves
in all tests, with noise as the case states it, and all of the scatter. gl-posterior draws from the posterior by the other runs, and
the parameters of the run, known here, are held against its intervals. A row a run and parameter: truth mean sd z inside; then for
each parameter the share of 90 % intervals that hold and the root mean square of z, which is 1 where standard deviations are right.

Runs near the bounds of the prior are left out: of them an interval with 5 % on either side does not hold by construction.
"""

import math
import os
import random
import subprocess
import sys
import tempfile

from tables import rows, settings, write

EDGE = 0.07  # of the prior's range


def joined(paths):
    tables = [rows(path) for path in paths if os.path.exists(path)]
    return [tables[0][0]] + [row for table in tables for row in table[1:]]


def main():
    if len(sys.argv) not in (3, 4) or sys.argv[1] in ("-h", "--help"):
        sys.exit(__doc__)
    case, out, number = sys.argv[1], sys.argv[2], int(sys.argv[3]) if len(sys.argv) > 3 else 40
    of_case = settings(case)
    tests = [{**of_case, **test} for test in of_case.get("test", [{"name": ""}])]
    iterations = sorted((name for name in os.listdir(out) if name.startswith("iter")), key=lambda name: int(name[4:]))
    samples = joined([os.path.join(out, name, "samples.txt") for name in iterations])
    ensembles = [
        joined([os.path.join(out, name, test["name"], "ensemble.txt") for name in iterations])
        for test in tests
    ]
    head, *parameters = rows(os.path.join(case, "params.txt"))
    prior = {row[0]: dict(zip(head, row)) for row in parameters}
    complete = set.intersection(*({row[0] for row in ensemble[1:]} for ensemble in ensembles))
    known = [row for row in samples[1:] if row[0] in complete]
    at = {name: samples[0].index(name) for name in prior}
    varied = [name for name in prior if len({row[at[name]] for row in known}) > 1]

    def share(row, name):
        scale = math.log if prior[name].get("scale") == "log" else float
        lower, value, upper = (scale(float(x)) for x in (prior[name]["lower"], row[at[name]], prior[name]["upper"]))
        return (value - lower) / (upper - lower)

    def is_inside(row):
        return all(EDGE < share(row, name) < 1 - EDGE for name in varied)

    generator = random.Random(1)
    chosen = [row for row in known if is_inside(row)]
    generator.shuffle(chosen)
    held, square = dict.fromkeys(varied, 0), dict.fromkeys(varied, 0.0)
    print("run", "parameter", "truth", "mean", "sd", "z", "inside", sep="\t")
    for run in chosen[:number]:
        with tempfile.TemporaryDirectory() as work:
            write(f"{work}/samples.txt", [samples[0]] + [row for row in known if row is not run])
            call = ["gl-posterior", "-p", os.path.join(case, "params.txt"), "-s", f"{work}/samples.txt", "--scatter", "1"]
            call += ["--summary", f"{work}/posterior.txt", "-o", f"{work}/weights.txt"]
            tables = []
            for place, (test, ensemble) in enumerate(zip(tests, ensembles)):
                names, noise = test["observables"], test["noise"]
                columns = [ensemble[0].index(name) for name in [test["control"], *names]]
                measured = [[test["control"], *names]]
                for row in ensemble[1:]:
                    if row[0] == run[0]:
                        values = [float(row[column]) for column in columns]
                        noisy = [value + generator.gauss(0, noise[name]) for name, value in zip(names, values[1:])]
                        measured.append([str(value) for value in [values[0], *noisy]])
                write(f"{work}/obs{place}.txt", measured)
                write(f"{work}/runs{place}.txt", [ensemble[0]] + [row for row in ensemble[1:] if row[0] != run[0]])
                sds = ",".join(f"{name}={noise[name]}" for name in names)
                call += ["--test", f"t{place}:{work}/obs{place}.txt:{test['control']}:{','.join(names)}:{sds}"]
                tables.append(f"t{place}={work}/runs{place}.txt")
            subprocess.run(call + tables, check=True, stderr=subprocess.DEVNULL)
            summary = dict(row[:2] for row in rows(f"{work}/posterior.txt"))
        for name in varied:
            truth = float(run[at[name]])
            mean, sd, low, high = (float(summary[f"{what}({name})"]) for what in ("mean", "sd", "q05", "q95"))
            inside, z = low <= truth <= high, (truth - mean) / sd
            held[name] += inside
            square[name] += z * z
            print(run[0], name, f"{truth:.4g}", f"{mean:.4g}", f"{sd:.3g}", f"{z:.2f}", int(inside), sep="\t", flush=True)
    count = len(chosen[:number])
    for name in varied:
        print(f"# {name}: {held[name]} of {count} intervals hold, root mean square of z {(square[name] / count) ** 0.5:.2f}")


if __name__ == "__main__":
    main()
