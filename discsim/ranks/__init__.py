"""Runs on many MPI ranks, with the same bits as on one. Imported only if a launcher started several processes.

Each rank owns the particles in some tiles of space (`division.py`), its own particles; effects process only these. Sums
over neighbours also need ghosts, copies of particles of other ranks. Ghosts are fetched as whole cells (`exchange.py`)
for SPH (`sph.py`), for drag in cells (`drag.py`), and for the deposit on the grid (`gravity.py`).

All particles of a run have a global order: the order that they would have in memory on one process, by cell at the
last sort and then by id. The key of a particle in this order is its `global_index`. Sums over own particles and ghosts
follow the global order, so that each sum has the same terms in the same order as on one rank.
"""
