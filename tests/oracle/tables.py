"""Plain text tables beside the scripts: tab-separated, bare header, repr() floats."""

import json
from pathlib import Path

HERE = Path(__file__).resolve().parent


def cell(value):
    if isinstance(value, str):
        return value
    if isinstance(value, (int, bool)):
        return str(int(value))
    return repr(float(value))


def write_table(name, header, rows):
    lines = ["\t".join(header)]
    for row in rows:
        row = list(row)
        assert len(row) == len(header), (name, header, row)
        lines.append("\t".join(map(cell, row)))
    (HERE / name).write_text("\n".join(lines) + "\n")


def write_json(name, value):
    """One line an entry of the top level's lists, so that a diff stays readable."""
    lines = []
    for key, entry in value.items():
        if isinstance(entry, list):
            body = ",\n".join("  " + json.dumps(e, separators=(",", ":")) for e in entry)
            lines.append(f"{json.dumps(key)}: [\n{body}\n]")
        else:
            lines.append(f"{json.dumps(key)}: {json.dumps(entry)}")
    (HERE / name).write_text("{\n" + ",\n".join(lines) + "\n}\n")
