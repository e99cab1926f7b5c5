"""Inverse CDF and log density of every kind of prior, in 60 digits (mpmath), checked against scipy where scipy is sound.

`kind` is `uniform` or `normal` (truncated to lower..upper). On the `log` scale the distribution is that
of ln x: `mean` and `sd` are those of ln x before truncation, `lower` and `upper` are in units of x.
`ln_density` is the density of x itself, per unit of x. `mean` and `sd` are `-` where there are none.
"""

from mpmath import erfc, exp, isfinite, log, mp, mpf, pi, sqrt
from scipy import stats
from tables import write_table

mp.dps = 60

U = [0.0, 1e-12, 1e-6, 0.01, 0.1, 0.25, 0.5, 0.75, 0.9, 0.99, 1 - 1e-6, 1 - 2.0**-53, 1.0]

UNIFORM = [
    # scale, lower, upper
    ("linear", 0.0, 1.0),
    ("linear", -3.0, 7.0),
    ("linear", 100e9, 200e9),
    ("log", 1e-3, 1e3),
    ("log", 1e6, 1e9),
    ("log", 0.5, 0.50001),
    ("log", 1e-300, 1e300),
]

NORMAL = [
    # scale, lower, upper, mean, sd
    ("linear", -1.0, 1.0, 0.0, 1.0),
    ("linear", 0.0, 1.0, 0.3, 0.2),
    ("linear", 100e9, 200e9, 140e9, 30e9),
    ("linear", -50.0, 50.0, 0.0, 1.0),
    ("linear", 0.0, 1.0, 0.5, 1e6),  # flat within the bounds
    ("linear", 0.0, 1.0, 0.5, 1e-3),  # narrow within the bounds
    ("linear", 6.0, 8.0, 0.0, 1.0),  # upper tail
    ("linear", -8.0, -6.0, 0.0, 1.0),  # lower tail
    ("linear", 20.0, 21.0, 0.0, 1.0),
    ("linear", 38.0, 60.0, 0.0, 1.0),  # the mass outside of the bounds is 1 to f64
    ("linear", -60.0, -38.0, 0.0, 1.0),
    ("linear", 0.0, 1.0, 2.0, 0.25),  # mean above the bounds
    ("linear", 0.0, 1.0, -1.5, 0.1),  # mean below the bounds
    ("linear", 0.2, 0.45, 1.3, 0.05),
    ("linear", -1.0, 30.0, 0.0, 1.0),
    ("log", 1e6, 1e9, float(log(3e7)), 1.0),
    ("log", 1e-3, 1e3, 0.0, 2.0),
    ("log", 0.1, 10.0, 5.0, 0.5),  # mean above the bounds
    ("log", 1e2, 1e4, -2.0, 1.0),  # mean below the bounds
]


def lower_tail(z):
    return erfc(-z / sqrt(mpf(2))) / 2


def truncated_quantile(a, b, u):
    """z with P(Z <= z | a <= Z <= b) = u for a standard normal Z, by bisection."""
    if a + b > 0:  # reflected, so that no digit is lost to 1 - tiny
        return -truncated_quantile(-b, -a, 1 - u)
    target = lower_tail(a) + u * (lower_tail(b) - lower_tail(a))
    low, high = a, b
    for _ in range(230):
        middle = (low + high) / 2
        if lower_tail(middle) < target:
            low = middle
        else:
            high = middle
    return (low + high) / 2


def mass(a, b):
    return lower_tail(-a) - lower_tail(-b) if a + b > 0 else lower_tail(b) - lower_tail(a)


rows = []
for scale, lower, upper in UNIFORM:
    low, high = (log(mpf(lower)), log(mpf(upper))) if scale == "log" else (mpf(lower), mpf(upper))
    for u in U:
        t = low + mpf(u) * (high - low)
        x = exp(t) if scale == "log" else t
        ln_density = -log(high - low) - (t if scale == "log" else 0)
        rows.append(["uniform", scale, lower, upper, "-", "-", u, x, ln_density])

for scale, lower, upper, mean, sd in NORMAL:
    low, high = (log(mpf(lower)), log(mpf(upper))) if scale == "log" else (mpf(lower), mpf(upper))
    a, b = (low - mpf(mean)) / mpf(sd), (high - mpf(mean)) / mpf(sd)
    for u in U:
        z = a if u == 0 else b if u == 1 else truncated_quantile(a, b, mpf(u))
        t = mpf(mean) + mpf(sd) * z
        if abs(t) < mpf(10) ** -40 * (high - low):  # the middle of a symmetric interval
            t = mpf(0)
        x = exp(t) if scale == "log" else t
        ln_density = -z * z / 2 - log(2 * pi) / 2 - log(mpf(sd)) - log(mass(a, b)) - (t if scale == "log" else 0)
        assert isfinite(ln_density)
        if max(abs(a), abs(b)) < 10 and 1e-7 < u < 1 - 1e-7:
            peer = stats.truncnorm.ppf(u, float(a), float(b), loc=mean, scale=sd)
            assert abs(peer - float(t)) < 1e-9 * max(float(high - low), abs(float(t))), (scale, lower, upper, mean, sd, u, peer, t)
        rows.append(["normal", scale, lower, upper, mean, sd, u, x, ln_density])

write_table("prior.tsv", ["kind", "scale", "lower", "upper", "mean", "sd", "u", "x", "ln_density"], rows)
