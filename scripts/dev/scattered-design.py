#!/usr/bin/env python3
"""A design of any size in closed form, whose readings scatter by themselves: what gl-gap-attribute is timed on.

    scattered-design.py RUNS BASE EFFECTS SCATTER OUT

RUNS of a model with BASE parameters and EFFECTS that are off in a fifth of them, on one at a time in two fifths and two at a time in
the others; two observables at 41 steps, each a sum of sines, and on each reading an independent normal scatter of standard deviation
SCATTER. OUT gets params.txt, samples.txt, ens.txt and obs.txt, a measurement with the second effect in and a noise of 0.01:

    gl-gap-attribute -p params.txt -s samples.txt -b obs.txt -c x -v f,q --noise f=0.01,q=0.01 ens.txt
"""

import os
import sys

import numpy as np

STEPS = 41
NOISE = 0.01


def main():
    if len(sys.argv) != 6 or sys.argv[1] in ("-h", "--help"):
        sys.exit(__doc__)
    runs, base, effects, scatter, out = (kind(text) for kind, text in zip((int, int, int, float, str), sys.argv[1:]))
    os.makedirs(out, exist_ok=True)
    random = np.random.default_rng(7)
    x = np.linspace(0, 1, STEPS)
    names = [f"p{i}" for i in range(base)] + [f"e{i}" for i in range(effects)]
    heights = random.normal(size=(2, base + effects, 4))
    rates = random.uniform(0.5, 9, size=(2, base + effects, 4))

    def curves(values):
        both = []
        for j in range(2):
            y = np.zeros(STEPS)
            for i, v in enumerate(values):
                y = y + sum(heights[j, i, k] * np.sin(rates[j, i, k] * x + v) * v * 0.3 for k in range(4))
            both.append(y * (1 + 0.2 * np.sin(values[0] * 3) * x) + scatter * random.normal(size=STEPS))
        return both

    values = random.uniform(size=(runs, base + effects))
    with open(f"{out}/params.txt", "w") as params:
        params.write("name\tlower\tupper\teffect\toff\n")
        params.writelines(f"p{i}\t0\t1\t-\t-\n" for i in range(base))
        params.writelines(f"e{i}\t0.1\t1\teff{i}\t0\n" for i in range(effects))
    with open(f"{out}/samples.txt", "w") as samples, open(f"{out}/ens.txt", "w") as ensemble:
        samples.write("description\tkey\t" + "\t".join(names) + "\n")
        ensemble.write("sample\tstep\tx\tf\tq\n")
        switches = []
        for _ in range(runs):
            share, is_on = random.uniform(), np.zeros(effects, bool)
            if share > 0.2:
                is_on[random.choice(effects, size=1 if share < 0.6 else 2, replace=False)] = True
            switches.append(is_on)
        values[:, base:] = np.where(switches, 0.1 + 0.9 * values[:, base:], 0)
        for i, row in enumerate(values):
            samples.write(f"r{i}\t{i}\t" + "\t".join(f"{v:.8g}" for v in row) + "\n")
            for t, (at, f, q) in enumerate(zip(x, *curves(row))):
                ensemble.write(f"r{i}\t{t}\t{at:.6g}\t{f:.8g}\t{q:.8g}\n")
    truth = np.r_[np.full(base, 0.45), np.zeros(effects)]
    truth[base + 1] = 0.7
    with open(f"{out}/obs.txt", "w") as measured:
        measured.write("x\tf\tq\n")
        for at, f, q in zip(x, *curves(truth)):
            measured.write(f"{at:.6g}\t{f + NOISE * random.normal():.8g}\t{q + NOISE * random.normal():.8g}\n")


if __name__ == "__main__":
    main()
