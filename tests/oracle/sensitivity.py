"""First-order and total Sobol indices by SALib (Saltelli's sampling, 2^14 base points, 95 % confidence half-widths by its
bootstrap) of Ishigami's function (a = 7, b = 0.1) and of Sobol's g with a = 0, 1, 4.5, 9, 99.
"""

import numpy as np
from SALib.analyze import sobol as analyze
from SALib.sample import sobol as sample
from SALib.test_functions import Ishigami
from tables import write_table

A = np.array([0, 1, 4.5, 9, 99])


def g(x):
    return np.prod((np.abs(4 * x - 2) + A) / (1 + A), axis=1)


def rows(function, bounds, evaluate):
    names = [f"x{j + 1}" for j in range(len(bounds))]
    problem = {"num_vars": len(names), "names": names, "bounds": bounds}
    x = sample.sample(problem, 2**14, calc_second_order=False, seed=1)
    found = analyze.analyze(problem, evaluate(x), calc_second_order=False, seed=1)
    return [
        (function, name, found["S1"][j], found["S1_conf"][j], found["ST"][j], found["ST_conf"][j])
        for j, name in enumerate(names)
    ]


write_table(
    "sensitivity.tsv",
    ["function", "parameter", "first", "first_conf", "total", "total_conf"],
    rows("ishigami", [[-np.pi, np.pi]] * 3, Ishigami.evaluate) + rows("g", [[0, 1]] * 5, g),
)
