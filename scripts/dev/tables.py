"""Tables and cases, for the scripts beside it."""

import os
import tomllib


def rows(path):
    """A table as its rows of fields, the header among them."""
    with open(path) as table:
        return [line.rstrip("\n").split("\t") for line in table]


def write(path, table):
    with open(path, "w") as file:
        file.writelines("\t".join(row) + "\n" for row in table)


def settings(case):
    """What case.toml says."""
    with open(os.path.join(case, "case.toml"), "rb") as file:
        return tomllib.load(file)
