"""Write runs that numpy saved as tables: npy.py DEST FILE...

For each NAME.npy or NAME_sim.npy DEST gets NAME_sim.txt and NAME_param.txt. A file that cannot be read is
named on standard error, one a line. Exit code 3 where numpy is missing.
"""

import os
import pickle
import re
import sys

try:
    import numpy
except ImportError:
    sys.exit(3)

ARRAYS = {'_reconstruct', '_frombuffer', 'ndarray', 'dtype', 'scalar'}


class Arrays(pickle.Unpickler):
    # A pickle can call anything; a run needs arrays only.
    def find_class(self, module, name):
        if module.split('.')[0] == 'numpy' and name in ARRAYS:
            return super().find_class(module, name)
        raise ValueError('holds %s.%s, which is no data' % (module, name))


def columns_of(path):
    with open(path, 'rb') as file:
        version = numpy.lib.format.read_magic(file)
        read = numpy.lib.format.read_array_header_1_0 if version == (1, 0) else numpy.lib.format.read_array_header_2_0
        if not read(file)[2].hasobject:
            raise ValueError('no dictionary of columns')
        data = Arrays(file).load().item()
    return {str(name): [float(value) for value in numpy.ravel(values)] for name, values in data.items()}


def write(path, columns):
    with open(path, 'w', newline='\n') as file:
        file.write('\t'.join(columns) + '\n')
        for row in zip(*columns.values()):
            file.write('\t'.join(map(repr, row)) + '\n')


for path in sys.argv[2:]:
    try:
        columns = columns_of(path)
        longest = max(map(len, columns.values()))
        single = {name: values for name, values in columns.items() if len(values) == 1 < longest}
        name = os.path.join(sys.argv[1], re.sub(r'(_sim)?\.npy$', '', os.path.basename(path)))
        write(name + '_sim.txt', {key: values for key, values in columns.items() if key not in single})
        write(name + '_param.txt', single)
    except (OSError, ValueError, EOFError, ImportError, AttributeError, pickle.UnpicklingError) as error:
        print('%s: %s' % (path, error), file=sys.stderr)
