"""Closed-form posterior of a and b in y = a x + b, uniform prior in a box, independent Gaussian noise.

`known`: the noise sd is given (`noise_sd`); the posterior is Gaussian. `jeffreys`: p(s) ∝ 1/s for the noise sd s
(that is 1/s² for its variance); the posterior is a bivariate t with n - 2 degrees of freedom. Both are
given without the box's walls; `jeffreys_box` is the same posterior cut off at the walls, by quadrature,
because a t has tails. For `known` the walls are 8 sd away and change nothing in f64.

`ln_evidence` integrates the normalised likelihood times the prior density 1/area (and, under
Jeffreys, times exactly 1/s² d(s²)). `ln_evidence_bare` is the same with exp(-misfit/2) as the likelihood,
without (2 π s²)^(-n/2), for `known` only.
"""

import numpy as np
from mpmath import betainc, gamma, log, loggamma, mp, mpf, pi, quad, sqrt
from scipy import stats
from tables import write_table

mp.dps = 30

rng = np.random.default_rng(7)
DATA = [
    # name, x, a, b, noise sd
    ("few", np.arange(10.0), 0.7, -2.0, 0.5),
    ("centred", np.round(np.linspace(-1, 1, 30), 3), 3.0, 1.5, 0.05),
    ("tutorial", np.arange(100.0), 0.2, 5.0, 2.0),
]
P = {"q05": 0.05, "q50": 0.5, "q95": 0.95}


def t_cdf(t, df):
    half = betainc(mpf(df) / 2, mpf("0.5"), 0, df / (df + t * t), regularized=True) / 2
    return half if t < 0 else 1 - half


def t_pdf(t, df):
    return gamma(mpf(df + 1) / 2) / (sqrt(df * pi) * gamma(mpf(df) / 2)) * (1 + t * t / df) ** (-mpf(df + 1) / 2)


def box_marginal(mean, scale, low, high, other_mean, other_scale, rho, other_low, other_high, df):
    """Density of one coordinate of the bivariate t, of the part inside the box (not normalised)."""

    def density(v):
        t = (v - mean) / scale
        centre = other_mean + rho * other_scale * t
        spread = other_scale * sqrt((1 - rho**2) * (df + t * t) / (df + 1))
        inside = t_cdf((other_high - centre) / spread, df + 1) - t_cdf((other_low - centre) / spread, df + 1)
        return t_pdf(t, df) / scale * inside

    knots = sorted({low, high, *(mean + k * scale for k in (-6, -4, -2, -1, 0, 1, 2, 4, 6) if low < mean + k * scale < high)})
    return density, knots


rows = []
for name, x, a, b, sd in DATA:
    y = np.round(a * x + b + rng.normal(0, sd, len(x)), 4)
    write_table(f"linear_posterior_{name}_obs.txt", ["x", "y"], zip(x, y))

    n = len(x)
    xs, ys = [mpf(v) for v in x], [mpf(v) for v in y]
    sx, sxx = sum(xs), sum(v * v for v in xs)
    sy, sxy = sum(ys), sum(u * v for u, v in zip(xs, ys))
    det = n * sxx - sx**2
    mean_a, mean_b = (n * sxy - sx * sy) / det, (sxx * sy - sx * sxy) / det
    residual = sum((v - mean_a * u - mean_b) ** 2 for u, v in zip(xs, ys))
    inverse = {"a": n / det, "b": sxx / det, "ab": -sx / det}  # of XᵀX
    mean = {"a": mean_a, "b": mean_b}
    rho = inverse["ab"] / sqrt(inverse["a"] * inverse["b"])

    box = {}
    for v in "ab":  # 8 posterior sd, rounded outwards to two digits of the sd
        step = mpf(10) ** (int(mp.floor(log(mpf(sd) * sqrt(inverse[v]), 10))))
        reach = 8 * mpf(sd) * sqrt(inverse[v])
        box[v] = (mpf(float(mp.floor((mean[v] - reach) / step) * step)), mpf(float(mp.ceil((mean[v] + reach) / step) * step)))
        box[v] = tuple(mpf(round(float(w), 10)) for w in box[v])
    write_table(
        f"linear_posterior_{name}_params.txt", ["name", "lower", "upper"], [[v, *box[v]] for v in "ab"]
    )
    ln_area = sum(log(box[v][1] - box[v][0]) for v in "ab")

    def put(noise, quantity, value):
        rows.append([name, noise, quantity, value])

    # noise sd known
    s2 = mpf(sd) ** 2
    put("known", "noise_sd", sd)
    put("known", "n", n)
    for v in "ab":
        put("known", f"mean({v})", mean[v])
        put("known", f"sd({v})", sqrt(s2 * inverse[v]))
    put("known", "cov(a,b)", s2 * inverse["ab"])
    for v in "ab":
        for q, p in P.items():
            put("known", f"{q}({v})", mean[v] + sqrt(s2 * inverse[v]) * mpf(stats.norm.ppf(p)))
    ln_bare = -residual / (2 * s2) + log(2 * pi * s2) - log(det) / 2 - ln_area
    put("known", "best_misfit", residual / s2)
    put("known", "ln_evidence", ln_bare - mpf(n) / 2 * log(2 * pi * s2))
    put("known", "ln_evidence_bare", ln_bare)

    # noise sd unknown
    df = n - 2
    scale = {v: sqrt(residual / df * inverse[v]) for v in "ab"}
    put("jeffreys", "degrees_of_freedom", df)
    put("jeffreys", "best_sum_of_squares", residual)
    for v in "ab":
        put("jeffreys", f"mean({v})", mean[v])
        put("jeffreys", f"sd({v})", scale[v] * sqrt(mpf(df) / (df - 2)))
    put("jeffreys", "cov(a,b)", residual / (df - 2) * inverse["ab"])
    for v in "ab":
        for q, p in P.items():
            put("jeffreys", f"{q}({v})", mean[v] + scale[v] * mpf(stats.t.ppf(p, df)))
    # s² is inverse gamma with shape df/2 and scale residual/2
    put("jeffreys", "mean(noise_sd)", sqrt(residual / 2) * gamma(mpf(df - 1) / 2) / gamma(mpf(df) / 2))
    for q, p in P.items():
        put("jeffreys", f"{q}(noise_sd)", sqrt(residual / mpf(stats.chi2.ppf(1 - p, df))))
    ln_jeffreys = (
        loggamma(mpf(df) / 2) - mpf(df) / 2 * log(pi) - mpf(df) / 2 * log(residual) - log(det) / 2 - ln_area
    )
    put("jeffreys", "ln_evidence", ln_jeffreys)

    # the same inside the box only
    mp.dps = 20
    for v, w in ("ab", "ba"):
        density, knots = box_marginal(mean[v], scale[v], *box[v], mean[w], scale[w], rho, *box[w], df)
        mass = quad(density, knots)
        first = quad(lambda t: t * density(t), knots) / mass
        second = quad(lambda t: (t - first) ** 2 * density(t), knots) / mass
        put("jeffreys_box", f"mean({v})", first)
        put("jeffreys_box", f"sd({v})", sqrt(second))
        for q, p in P.items():
            start = mean[v] + scale[v] * mpf(stats.t.ppf(p, df))
            below = quad(density, [k for k in knots if k < mean[v]] + [mean[v]])
            root = start
            for _ in range(6):  # Newton
                root -= (below + quad(density, [mean[v], root]) - p * mass) / density(root)
            put("jeffreys_box", f"{q}({v})", root)
        if v == "a":
            put("jeffreys_box", "mass", mass)
            put("jeffreys_box", "ln_evidence", ln_jeffreys + log(mass))
    mp.dps = 30

    # brute force on a grid, as a check on the algebra
    ga, gb = (np.linspace(float(box[v][0]), float(box[v][1]), 1201) for v in "ab")
    ss = sum((yi - ga[:, None] * xi - gb[None, :]) ** 2 for xi, yi in zip(x, y))
    cell = (ga[1] - ga[0]) * (gb[1] - gb[0])
    value = {(r[1], r[2]): float(r[3]) for r in rows if r[0] == name}
    ln_l = -0.5 * ss / sd**2
    grid = np.log(np.exp(ln_l - ln_l.max()).sum() * cell) + ln_l.max() - float(ln_area)
    assert abs(grid - value["known", "ln_evidence_bare"]) < 1e-9, grid
    ln_l = -0.5 * n * np.log(ss)
    grid = np.log(np.exp(ln_l - ln_l.max()).sum() * cell) + ln_l.max() - float(ln_area)
    grid += float(loggamma(mpf(n) / 2) - mpf(n) / 2 * log(pi))
    assert abs(grid - value["jeffreys_box", "ln_evidence"]) < 1e-4, (grid, value["jeffreys_box", "ln_evidence"])

write_table("linear_posterior.tsv", ["data", "noise", "quantity", "value"], rows)
