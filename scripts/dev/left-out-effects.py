#!/usr/bin/env python3
"""Is an effect named that is known to be in it? The runs of a design tell.

    left-out-effects.py CASE OUT [NUMBER]

OUT is a diagnosis of CASE, a case of one test, by gl-diagnose. Of its design NUMBER runs (8) without an effect, and with each effect
alone, drawn by seed, are each taken for a measurement: its curves, with noise as the case states it, and all of the scatter.
gl-gap-attribute diagnoses it by the other runs. A row a run: what is in it, what comes first, its probability and that of what
is in it, effects with a rest and without together; then how many of each are right, and how many are called by another effect.
"""

import os
import random
import subprocess
import sys
import tempfile

from tables import rows, settings, write

REST = "+unexplained"


def main():
    if len(sys.argv) not in (3, 4) or sys.argv[1] in ("-h", "--help"):
        sys.exit(__doc__)
    case, out, number = sys.argv[1], sys.argv[2], int(sys.argv[3]) if len(sys.argv) > 3 else 8
    of_case = settings(case)
    control, names, noise = of_case["control"], of_case["observables"], of_case["noise"]
    rounds = [name for name in os.listdir(os.path.join(out, "design")) if name.startswith("round")]
    last = os.path.join(out, "design", max(rounds, key=lambda name: int(name[5:])))
    params, samples, ensemble = (rows(f"{last}/{name}.txt") for name in ("params", "all-samples", "all-ensemble"))
    head, *parameters = params
    effects = {}
    for row in (dict(zip(head, row)) for row in parameters):
        if row.get("effect", "-") != "-":
            effects.setdefault(row["effect"], []).append((samples[0].index(row["name"]), float(row["off"])))
    complete = {row[0] for row in ensemble[1:]}
    known = [row for row in samples[1:] if row[0] in complete]

    def is_on(run, effect):
        return any(float(run[column]) != off for column, off in effects[effect])

    groups = {name: [] for name in ["none", *effects]}
    for run in known:
        on = [effect for effect in effects if is_on(run, effect)] or ["none"]
        if len(on) == 1:
            groups[on[0]].append(run)
    generator = random.Random(1)
    columns = [ensemble[0].index(name) for name in [control, *names]]
    print("run", "in_it", "first", "probability", "of_what_is_in_it", sep="\t")
    verdicts = []
    for truth, runs in groups.items():
        for run in generator.sample(runs, min(number, len(runs))):
            measured = [[control, *names]]
            for values in ([float(row[column]) for column in columns] for row in ensemble[1:] if row[0] == run[0]):
                noisy = [value + generator.gauss(0, noise[name]) for name, value in zip(names, values[1:])]
                measured.append([str(value) for value in [values[0], *noisy]])
            with tempfile.TemporaryDirectory() as work:
                write(f"{work}/samples.txt", [samples[0]] + [row for row in known if row is not run])
                write(f"{work}/runs.txt", [ensemble[0]] + [row for row in ensemble[1:] if row[0] != run[0]])
                write(f"{work}/obs.txt", measured)
                sds = ",".join(f"{name}={noise[name]}" for name in names)
                call = ["gl-gap-attribute", "-p", f"{last}/params.txt", "--prior", os.path.join(case, "params.txt")]
                call += ["-s", f"{work}/samples.txt", "-b", f"{work}/obs.txt", "-c", control, "-v", ",".join(names)]
                call += ["--noise", sds, "--scatter", "1", "-o", f"{work}/attribution.txt", f"{work}/runs.txt"]
                subprocess.run(call, check=True, stderr=subprocess.DEVNULL)
                probability = {}
                for name, share in (row[:2] for row in rows(f"{work}/attribution.txt")[1:]):
                    cause = name.removesuffix(REST)
                    probability[cause] = probability.get(cause, 0.0) + float(share)
            first = next(iter(probability))
            verdicts.append((truth, first))
            shares = (f"{probability[first]:.3f}", f"{probability.get(truth, 0.0):.3f}")
            print(run[0], truth, first, *shares, sep="\t", flush=True)
    for truth in groups:
        said = [first for own, first in verdicts if own == truth]
        wrong = [first for first in said if first not in (truth, "none", "unexplained")]
        print(f"# {truth}: {said.count(truth)} of {len(said)} right, {len(wrong)} called by another effect")


if __name__ == "__main__":
    main()
