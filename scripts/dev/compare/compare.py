"""How many runs other calibrators take for the problems of `coverage`, and whether they are then right.

    coverage two ridge six -n 3 --seed 2000 --export DATA
    compare.py grainlearning DATA two ridge six
    compare.py pyvbmc DATA two ridge six

Each reads the measurements and true posteriors that `coverage --export` wrote. Right is: every mean within 0.25 true
standard deviations of the true one and every standard deviation within 20 %. GrainLearning goes on for up to 8 iterations
(an effective share of 0.3, 10 d ln d samples an iteration and at least 10, five components, slice sampling), `right_at` is the
first at which it is right; pyvbmc until it stops by itself.
"""

import contextlib
import io
import sys
import warnings
from pathlib import Path

import numpy as np

warnings.simplefilter("ignore")
np.seterr(all="ignore")


def two(p, u):
    return [(0.5 + p[0]) * (1 - np.exp(-(1 + 4 * p[1]) * u))]


def ridge(p, u):
    a, b, c, d = 0.3 + p[0], 0.3 + p[1], 0.5 + p[2], 0.5 + p[3]
    return [a * b * u * (1 + 2 * u) / (1 + 2 * (c / d) * u)]


def six(p, u):
    return [
        (0.5 + p[0]) * np.tanh(3 * (0.3 + p[1]) * u) + 0.8 * p[2] * u * u + 0.3 * p[5] * p[0] * u,
        (0.4 + p[3]) * np.exp(-2 * p[4] * u) * np.sin((2 + 3 * p[5] + p[1]) * u + 0.3),
    ]


PROBLEMS = {"two": (two, 2, 0.02), "ridge": (ridge, 4, 0.02), "six": (six, 6, 0.03)}
ITERATIONS = 8


def is_right(mean, sd, exact):
    shift = np.abs(mean - exact[:, 1]) / exact[:, 2]
    ratio = sd / exact[:, 2]
    return bool(np.all(shift < 0.25) and np.all(np.abs(ratio - 1) < 0.2)), shift.max(), ratio.min(), ratio.max()


def grainlearning(problem, d, noise, u, seen, exact, seed):
    from grainlearning import BayesianCalibration
    from grainlearning.dynamic_systems import DynamicSystem

    samples = max(10, int(np.ceil(10 * d * np.log(d))))

    def run(calibration):
        theta = calibration.system.param_data
        calibration.system.set_sim_data([np.array(problem(p, u)) for p in theta])

    np.random.seed(seed)
    calibration = BayesianCalibration.from_dict(
        {
            "num_iter": ITERATIONS,
            "callback": run,
            "system": {
                "system_type": DynamicSystem,
                "param_names": [f"p{j}" for j in range(d)],
                "param_min": [0.0] * d,
                "param_max": [1.0] * d,
                "num_samples": samples,
                "obs_data": seen,
                "ctrl_data": u,
                "sigma_tol": 1e-12,
            },
            "inference": {
                "Bayes_filter": {"ess_target": 0.3, "scale_cov_with_max": True},
                "sampling": {"max_num_components": 5, "n_init": 1, "random_state": seed, "slice_sampling": True},
            },
        }
    )
    right_at, runs, last = 0, 0, None
    for _ in range(ITERATIONS):
        with contextlib.redirect_stdout(io.StringIO()):
            calibration.run_one_iteration()
        runs += calibration.system.num_samples
        mean = np.asarray(calibration.system.estimated_params[-1])
        sd = np.abs(np.asarray(calibration.system.estimated_params_cv[-1]) * mean)
        last = is_right(mean, sd, exact)
        if last[0] and not right_at:
            right_at = runs
    return runs, right_at, last


def pyvbmc(problem, d, noise, u, seen, exact, seed):
    from pyvbmc import VBMC

    count = [0]

    def ln_density(x):
        count[0] += 1
        residual = (seen - np.array(problem(np.ravel(x), u))) / noise
        return -0.5 * float(np.sum(residual**2))

    np.random.seed(seed)
    low, high = np.full((1, d), -1e-6), np.full((1, d), 1 + 1e-6)
    options = {"display": "off", "plot": False}
    vbmc = VBMC(ln_density, np.full((1, d), 0.5), low, high, np.full((1, d), 0.1), np.full((1, d), 0.9), options)
    with contextlib.redirect_stdout(io.StringIO()):
        posterior, _ = vbmc.optimize()
        draws, _ = posterior.sample(20_000)
    last = is_right(draws.mean(0), draws.std(0), exact)
    return count[0], count[0] if last[0] else 0, last


def main(method, folder, names):
    print("method\tproblem\treplicate\truns\tright_at\tis_right\tshift\tsd_least\tsd_most", flush=True)
    for name in names:
        problem, d, noise = PROBLEMS[name]
        for i in range(1000):
            path = Path(folder) / f"{name}-{i}-obs.txt"
            if not path.exists():
                break
            table = np.loadtxt(path, skiprows=1)
            exact = np.loadtxt(Path(folder) / f"{name}-{i}-exact.txt", skiprows=1, usecols=(1, 2, 3))
            try:
                runs, right_at, last = globals()[method](problem, d, noise, table[:, 0], table[:, 1:].T, exact, i)
            except Exception as error:  # A calibrator that gives up is a result, too.
                print(f"{method}\t{name}\t{i}\tfailed: {type(error).__name__}: {error}", flush=True)
                continue
            numbers = "\t".join(f"{x:.2f}" for x in last[1:])
            print(f"{method}\t{name}\t{i}\t{runs}\t{right_at}\t{int(last[0])}\t{numbers}", flush=True)


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2], sys.argv[3:])
