"""One run on many MPI ranks, with the same bits as on one. Imported only where a launcher started several.

Each rank owns the particles of some tiles of space (`division.py`); effects see those alone. What looks at neighbours
fetches the particles of other ranks that it needs, as whole cells (`exchange.py`): SPH sums (`sph.py`), drag in cells
(`drag.py`) and the deposit on the grid (`gravity.py`). All particles of a run have one order, that of one process's
memory: by the cell at the last sort, then by id. It is kept in `place` and in every array, with others' particles in
between, so that each sum has the members that it has on one rank, in their order.
"""
