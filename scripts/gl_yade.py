"""Let a Yade script take part in a calibration: read a row of the samples table, write a run.

    import gl_yade

    p = gl_yade.parameters(E_m=9.0, nu=0.2)      # from the table's row, or these defaults
    ...                                          # simulate with p.E_m and p.nu
    gl_yade.write_run({'u': displacement, 'f': force})

`write_run` leaves `<description>_sim.txt` (the control column and the observables, a row a step)
and `<description>_param.txt` (one row: the parameters that were really used) in the current
folder. Both are tab-separated with a bare header, and every number reads back to the same float.

Only the Python standard library is used; Yade is imported when a function needs it.
"""

import os

__all__ = ['parameters', 'write_run', 'write_table']


def parameters(**defaults):
    """Return the parameters of this run, as attributes: `parameters(nu=0.2).nu`.

    Under `yade-batch` (or `YADE_BATCH=table:line`) they come from the table's row; a parameter the
    table does not have keeps its default. A column of the table without a default is an error of
    Yade's, which catches misspelt names. `key`, which every samples table has, needs no default.
    """
    from yade import params, utils

    defaults.setdefault('key', 0)
    utils.readParamsFromTable(**defaults)
    return params.table


def write_run(columns, parameters=None, description=None, folder='.'):
    """Write a finished run's two files.

    columns      the control column first, then the observables: {name: sequence of numbers},
                 all of one length
    parameters   {name: number}; by default what Yade's `params.table` holds, without `key`
    description  the run's name; by default Yade's tag, `default` for a script run by hand
    folder       where to write

    The parameters are written first and the simulation last, each under its final name only when
    it is complete and on disk: where there is a `_sim.txt` the run is finished.
    """
    if parameters is None:
        parameters = _table_parameters()
    if description is None:
        description = _description()
    base = os.path.join(folder, description)
    write_table(base + '_param.txt', {name: [value] for name, value in parameters.items()})
    write_table(base + '_sim.txt', columns)


def write_table(path, columns):
    """Write {name: sequence of numbers} as a tab-separated table that appears whole or not at all."""
    if not columns:
        raise ValueError('%s: no columns to write' % path)
    for name in columns:
        if not name or name != ''.join(str(name).split()) or name.startswith('#'):
            raise ValueError('%s: %r is no column name' % (path, name))
    lengths = {name: len(values) for name, values in columns.items()}
    if len(set(lengths.values())) > 1:
        raise ValueError('%s: columns of different lengths: %s' % (path, lengths))
    rows = zip(*([repr(float(value)) for value in values] for values in columns.values()))

    # Beside the target, so that the rename stays on one file system and is atomic.
    partial = '%s.%d.part' % (path, os.getpid())
    try:
        with open(partial, 'w', newline='\n') as file:
            file.write('\t'.join(columns) + '\n')
            file.writelines('\t'.join(row) + '\n' for row in rows)
            file.flush()
            os.fsync(file.fileno())
        os.replace(partial, path)
    except BaseException:
        if os.path.exists(partial):
            os.remove(partial)
        raise


def _table_parameters():
    from yade import params

    table = {name: value for name, value in vars(params.table).items() if not name.startswith('_')}
    table.pop('key', None)
    return table


def _description():
    from yade import O

    return O.tags['description'] if 'description' in O.tags.keys() else 'default'
