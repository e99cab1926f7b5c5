#!/usr/bin/env python3
"""Time GrainLearning on text tables, or make the tables.

    python3 peer.py --make DIR --samples 1000 --steps 100 --params 4 [--sims]
    python3 peer.py [--task filter,resample,read] [--timeout 60] DIR...

--make needs numpy; timing needs `pip install grainlearning==2.0.5`. DIR holds samples.txt, params.txt, obs.txt,
ensemble.txt, weights.txt and, with --sims, sims/<description>_sim.txt and _param.txt (and iter0, a link to sims,
where GrainLearning looks for them). Both sides read the same bytes.

filter and resample are timed in memory, after the tables are read; read is the loading of parameters and run
files by GrainLearning's own loader. Each task runs in a process of its own. `-` in the table: not done within the
limits, with the reason on stderr.
"""

import argparse
import contextlib
import io
import math
import multiprocessing
import resource
import sys
import time
import warnings
from pathlib import Path

import numpy as np

NAME = "bench"
CONTROL, OBSERVABLES = "strain", ["p", "q"]


def names(n_params):
    return [f"a{k}" for k in range(n_params)]


# making the tables


def halton(n, d):
    primes = [2, 3, 5, 7, 11, 13, 17, 19, 23, 29, 31, 37][:d]
    columns = []
    for base in primes:
        index, scale, x = np.arange(1, n + 1), 1.0, np.zeros(n)
        while index.any():
            scale /= base
            x += scale * (index % base)
            index //= base
        columns.append(x)
    return np.array(columns).T


def curves(theta, control):
    """Observables of each row of theta, shape (rows, 2, steps): positive, smooth, every parameter felt by both."""
    d = theta.shape[1]
    k = np.arange(1, d + 1)[:, None]
    shapes = np.array([1 - np.exp(-2 * k * control), control ** (k / 2) / k])  # (2, d, steps)
    return 1 + np.einsum("nd,odt->not", theta, shapes)


def tempered_weights(misfit, ess):
    low, high = -80.0, 80.0
    for _ in range(200):
        ln_sigma = (low + high) / 2
        w = np.exp(-(misfit - misfit.min()) / (2 * math.exp(ln_sigma)))
        w /= w.sum()
        low, high = (ln_sigma, high) if 1 / (len(w) * (w @ w)) < ess else (low, ln_sigma)
    return w


def write(path, header, rows, blank="\t"):
    with open(path, "w") as out:
        out.write(header + "\n")
        out.writelines(blank.join(row) + "\n" for row in rows)


def make(directory, n_samples, n_steps, n_params, sims, seed):
    rng = np.random.default_rng(seed)
    directory.mkdir(parents=True, exist_ok=True)
    control = np.linspace(0, 1, n_steps)
    theta = halton(n_samples, n_params)
    truth = rng.uniform(0.3, 0.7, (1, n_params))
    obs = curves(truth, control)[0] * (1 + rng.normal(0, 0.01, (2, n_steps)))
    runs = curves(theta, control)

    # GrainLearning looks for numbers padded to this width
    width = math.floor(math.log(n_samples, 10)) + 1
    label = [f"{NAME}_Iter0_Sample{i:0{width}d}" for i in range(n_samples)]
    text_theta = [[repr(float(v)) for v in row] for row in theta]
    text_control = [repr(float(v)) for v in control]

    write(directory / "params.txt", "name\tlower\tupper", ([name, "0.0", "1.0"] for name in names(n_params)))
    write(
        directory / "samples.txt",
        "\t".join(["!OMP_NUM_THREADS", "description", "key", *names(n_params)]),
        (["1", label[i], str(i), *text_theta[i]] for i in range(n_samples)),
    )
    write(
        directory / "obs.txt",
        "# " + " ".join([CONTROL, *OBSERVABLES]),
        ([c, repr(float(p)), repr(float(q))] for c, p, q in zip(text_control, *obs)),
        " ",
    )
    if sims:
        (directory / "sims").mkdir(exist_ok=True)
        link = directory / "iter0"
        if not link.is_symlink():
            link.symlink_to("sims")
    with open(directory / "ensemble.txt", "w") as ensemble:
        ensemble.write("\t".join(["sample", "step", CONTROL, *OBSERVABLES]) + "\n")
        for i in range(n_samples):
            text = [[c, repr(p), repr(q)] for c, p, q in zip(text_control, *runs[i].tolist())]
            ensemble.writelines(f"{label[i]}\t{t}\t{c}\t{p}\t{q}\n" for t, (c, p, q) in enumerate(text))
            if sims:
                write(directory / "sims" / f"{label[i]}_sim.txt", "# " + " ".join([CONTROL, *OBSERVABLES]), text, " ")
                write(directory / "sims" / f"{label[i]}_param.txt", "# " + " ".join(names(n_params)), [text_theta[i]], " ")

    residual = obs - runs
    misfit = ((residual / obs.max(axis=1)[:, None]) ** 2).sum(axis=(1, 2))
    error = (np.abs(residual) / np.ptp(obs, axis=1)[:, None]).mean(axis=(1, 2))
    weight = tempered_weights(misfit, 0.3)
    write(
        directory / "weights.txt",
        "\t".join(["sample", *names(n_params), "misfit", "error", "weight"]),
        ([label[i], *text_theta[i], *(repr(float(v[i])) for v in (misfit, error, weight))] for i in range(n_samples)),
    )


# reading them back


def header(path):
    with open(path) as table:
        return table.readline().replace("#", " ").split()


def columns(path, wanted):
    at = header(path)
    return np.loadtxt(path, skiprows=1, usecols=[at.index(name) for name in wanted], ndmin=2)


class Problem:
    def __init__(self, directory):
        self.directory = directory
        self.params = header(directory / "samples.txt")[3:]
        self.theta = columns(directory / "samples.txt", self.params)
        obs = columns(directory / "obs.txt", [CONTROL, *OBSERVABLES])
        self.control, self.obs = obs[:, 0], obs[:, 1:].T
        self.n_samples, self.n_steps, self.n_params = len(self.theta), len(obs), len(self.params)

    def system(self):
        from grainlearning.dynamic_systems import DynamicSystem

        return DynamicSystem.from_dict(
            {
                "param_names": self.params,
                "param_min": [0.0] * self.n_params,
                "param_max": [1.0] * self.n_params,
                "num_samples": self.n_samples,
                "obs_data": self.obs,
                "ctrl_data": self.control,
                "param_data": self.theta,
            }
        )


def inference(options):
    from grainlearning.iterative_bayesian_filter import IterativeBayesianFilter

    return IterativeBayesianFilter.from_dict(
        {
            "Bayes_filter": {"ess_target": options.ess, "scale_cov_with_max": True},
            "sampling": {
                "max_num_components": options.components,
                "random_state": 0,
                "slice_sampling": options.slice,
            },
        }
    )


# the tasks: each returns what is timed


def task_filter(problem, options):
    system, method = problem.system(), inference(options)
    ensemble = columns(problem.directory / "ensemble.txt", OBSERVABLES)
    system.set_sim_data(ensemble.reshape(problem.n_samples, problem.n_steps, 2).transpose(0, 2, 1))
    return lambda: method.run_inference(system)


def task_resample(problem, options):
    system, method = problem.system(), inference(options)
    weight = columns(problem.directory / "weights.txt", ["weight"])[:, 0]
    return lambda: method.sampling.regenerate_params(weight, system)


def task_read(problem, options):
    from grainlearning.dynamic_systems import IODynamicSystem

    system = IODynamicSystem.from_dict(
        {
            "param_names": problem.params,
            "param_min": [0.0] * problem.n_params,
            "param_max": [1.0] * problem.n_params,
            "num_samples": problem.n_samples,
            "obs_data_file": str(problem.directory / "obs.txt"),
            "obs_names": OBSERVABLES,
            "ctrl_name": CONTROL,
            "sim_name": NAME,
            "sim_data_dir": str(problem.directory),
            "sim_data_file_ext": ".txt",
            "param_data_file": str(problem.directory / "samples.txt"),
        }
    )

    def read():
        system.load_param_data()
        system.get_sim_data_files()
        system.load_sim_data()

    return read


TASKS = {"filter": task_filter, "resample": task_resample, "read": task_read}


def child(pipe, task, problem, options):
    if options.memory:
        limit = int(options.memory * 2**30)
        resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
    try:
        with contextlib.redirect_stdout(io.StringIO()), warnings.catch_warnings():
            warnings.simplefilter("ignore")  # the mixture's iterations run out: that is its default
            timed = TASKS[task](problem, options)
            pipe.send("ready")
            start = time.perf_counter()
            timed()
            seconds = time.perf_counter() - start
        pipe.send(seconds)
    except BaseException as error:
        pipe.send(f"{type(error).__name__}: {error}")


def measure(task, problem, options):
    here, there = multiprocessing.Pipe()
    process = multiprocessing.Process(target=child, args=(there, task, problem, options))
    process.start()
    there.close()
    try:
        answer = here.recv()
        if answer == "ready":
            answer = here.recv() if here.poll(options.timeout) else f"not done in {options.timeout:g} s"
    except EOFError:
        answer = "killed"
    process.kill()
    process.join()
    return answer


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("directories", nargs="*", type=Path, metavar="DIR")
    parser.add_argument("--make", type=Path, metavar="DIR", help="write the tables to DIR and stop")
    parser.add_argument("--samples", type=int, default=1000)
    parser.add_argument("--steps", type=int, default=100)
    parser.add_argument("--params", type=int, default=4, help="2 to 12")
    parser.add_argument("--sims", action="store_true", help="also write two files a run")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--task", default="filter,resample,read", help="comma-separated, of: " + ", ".join(TASKS))
    parser.add_argument("--timeout", type=float, help="seconds a task")
    parser.add_argument("--memory", type=float, default=4, help="GiB of address space a task, 0 for no limit")
    parser.add_argument("--ess", type=float, default=0.3)
    parser.add_argument("--components", type=int, default=10)
    parser.add_argument("--slice", action="store_true", help="resample by slice sampling")
    options = parser.parse_args()
    if options.make:
        make(options.make, options.samples, options.steps, options.params, options.sims, options.seed)
        return 0
    if not options.directories:
        parser.error("nothing to do: give --make DIR, or directories that it made")
    tasks = options.task.split(",")
    for task in tasks:
        if task not in TASKS:
            parser.error(f"--task: {task} is none of {', '.join(TASKS)}")

    print("task\tn_samples\tn_steps\tn_parameters\tseconds")
    for directory in options.directories:
        problem = Problem(directory)
        for task in tasks:
            answer = measure(task, problem, options)
            if isinstance(answer, str):
                print(f"peer.py: {directory}: {task}: {answer}", file=sys.stderr)
            seconds = "-" if isinstance(answer, str) else f"{answer:.6g}"
            print(task, problem.n_samples, problem.n_steps, problem.n_params, seconds, sep="\t", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
