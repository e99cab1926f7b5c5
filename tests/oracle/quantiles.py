"""Weighted samples small enough to check by hand, from natural-log weights that are not normalised (mpmath).

`quantiles_samples.tsv`: case, ln_w, x. `quantiles.tsv`: case, quantity, value.
  ess       (sum w)² / sum w², in samples; ess_fraction is that over N, zero weights counted in N
  mean, sd  of x; sd is the population's: sum W (x - mean)², W = w / sum w
  cv        sd / mean
  ln_sum    ln of the sum of the weights
  qPP       lowest x at which the cumulative weight, samples at or below x, reaches PP %
  mPP       linear between (W_1 + ... + W_i - W_i / 2, x_i) of the sorted samples of positive weight, equal x
            merged first; constant beyond the ends
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
        centres = [c for _, c, _ in points]
        if p <= centres[0]:
            value = points[0][2]
        elif p >= centres[-1]:
            value = points[-1][2]
        else:
            i = next(i for i, c in enumerate(centres) if c > p)
            (_, c0, b0), (_, c1, b1) = points[i - 1], points[i]
            value = b0 + (p - c0) / (c1 - c0) * (b1 - b0)
        put(f"m{int(100 * p + mpf('0.5')):02d}", value)

write_table("quantiles_samples.tsv", ["case", "ln_w", "x"], samples)
write_table("quantiles.tsv", ["case", "quantity", "value"], rows)
