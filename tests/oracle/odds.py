"""What a reading is expected to say of two hypotheses that predict it as normal, N(0, 1) and N(away, sd²), where the first is true and
had the probability `prior`: its mean probability and the mean of the ln odds, both by scipy's quadrature.
"""

import numpy as np
from scipy.integrate import quad
from scipy.stats import norm
from tables import write_table


def row(prior, away, sd):
    first, second = norm(0, 1), norm(away, sd)
    joint = lambda y: np.array([np.log(prior) + first.logpdf(y), np.log(1 - prior) + second.logpdf(y)])
    over = lambda f: quad(lambda y: first.pdf(y) * f(joint(y)), -12, 12, epsabs=1e-12, limit=500)[0]
    probability = over(lambda both: np.exp(both[0] - np.logaddexp(*both)))
    return prior, away, sd, probability, over(lambda both: both[0] - both[1])


write_table(
    "odds.tsv",
    ["prior", "away", "sd", "probability", "ln_odds"],
    [row(*case) for case in [(0.5, 1, 1), (0.5, 3, 1), (0.2, 2, 0.5), (0.8, 0, 3), (0.1, 1, 2), (0.5, 0, 1)]],
)
