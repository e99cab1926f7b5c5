"""Weighted samples small enough to check by hand, from natural-log weights that are not normalised (mpmath).

`quantiles_samples.tsv`: case, ln_w, x. `quantiles.tsv`: case, quantity, value.
  ess       (sum w)² / sum w², in samples; ess_fraction is that over N, zero weights counted in N
  mean, sd  of x; sd is the population's: sum W (x - mean)², W = w / sum w
  cv        sd / mean
  ln_sum    ln of the sum of the weights
  qPP       lowest x at which the cumulative weight, samples at or below x, reaches PP %
  mPP       inverse of the distribution function that has a level piece at each of the sorted samples of positive
            weight, equal x merged first, and rises between neighbours over the smaller of their weights, half of
            it on either side of where the one ends and the other begins
"""

import numpy as np
from mpmath import exp, log, mp, mpf, sqrt
from tables import write_table

mp.dps = 50
ZERO = "-inf"
P = ["0.05", "0.25", "0.5", "0.75", "0.95"]

rng = np.random.default_rng(11)
CASES = {
    "equal": ([0.0] * 5, [3.0, 1.0, 2.0, 5.0, 4.0]),
    "one": ([-3.0], [7.5]),
    "one_of_four": ([ZERO, ZERO, -900.0, ZERO], [1.0, 2.0, 3.0, 4.0]),
    "two_to_one": ([0.6931471805599453, 0.0], [0.0, 1.0]),
    "underflow": ([-1000.0, -1001.0, -1002.0, -2000.0], [1.0, -2.0, 4.0, 1e6]),
    "overflow": ([1000.0, 1001.0, 999.0, -700.0], [1.0, -2.0, 4.0, 1e6]),
    "tied_values": ([-1.0, -2.0, -1.5, -0.5, -3.0, -1.0], [2.0, 1.0, 2.0, 3.0, 1.0, 3.0]),
    "with_zero": ([-1.0, ZERO, -0.3, -2.5, ZERO, -0.7], [1.5, -100.0, 2.5, 0.5, 100.0, 3.5]),
    "offset": ([-0.1, -0.9, -0.4, -1.7], [1e9 + 1, 1e9 + 2, 1e9 + 3, 1e9 + 4]),
    "spread": (list(rng.normal(0, 3, 40).round(3)), list(rng.normal(0, 10, 40).round(3))),
}

samples, rows = [], []
for case, (ln_w, x) in CASES.items():
    samples += [[case, ln, v] for ln, v in zip(ln_w, x)]
    w = [mpf(0) if ln == ZERO else exp(mpf(ln)) for ln in ln_w]
    v = [mpf(t) for t in x]
    total = sum(w)
    big_w = [t / total for t in w]
    ess = 1 / sum(t * t for t in big_w)
    mean = sum(a * b for a, b in zip(big_w, v))
    sd = sqrt(sum(a * (b - mean) ** 2 for a, b in zip(big_w, v)))

    def put(quantity, value):
        rows.append([case, quantity, value])

    put("n", len(x))
    put("ln_sum", log(total))
    put("ess", ess)
    put("ess_fraction", ess / len(x))
    put("mean", mean)
    put("sd", sd)
    put("cv", sd / mean)

    merged = {}
    for a, b in zip(big_w, v):
        if a > 0:
            merged[b] = merged.get(b, mpf(0)) + a
    points, below = [], mpf(0)
    for b in sorted(merged):
        points.append((below + merged[b], below + merged[b] / 2, b))
        below += merged[b]
    for p in P:
        p = mpf(p)
        assert all(abs(c - p) > mpf("1e-9") for c, _, _ in points), (case, p)
        put(f"q{int(100 * p + mpf('0.5')):02d}", next(b for c, _, b in points if c >= p))
    for p in P:
        p = mpf(p)
        weights = [2 * (c - m) for c, m, _ in points]
        rises = [min(one, other) / 2 for one, other in zip(weights, weights[1:])]
        corners = []
        for (c, _, x), weight, before, after in zip(points, weights, [mpf(0)] + rises, rises + [mpf(0)]):
            corners += [(c - weight + before, x), (c - after, x)]
        value = corners[-1][1]
        for (p0, x0), (p1, x1) in zip(corners, corners[1:]):
            if p <= p1:
                value = x0 if p <= p0 else x0 + (p - p0) / (p1 - p0) * (x1 - x0)
                break
        put(f"m{int(100 * p + mpf('0.5')):02d}", value)

write_table("quantiles_samples.tsv", ["case", "ln_w", "x"], samples)
write_table("quantiles.tsv", ["case", "quantity", "value"], rows)
