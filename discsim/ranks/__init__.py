"""Runs on many MPI ranks, with the same bits as on one. Imported only if a launcher started several processes.

Each rank owns the particles of some tiles of space (`division.py`); effects process these alone. Sums over neighbours
also need ghosts, particles of other ranks, which are fetched as whole cells (`exchange.py`). These sums are those of
SPH (`sph.py`), of drag in cells (`drag.py`), and of the deposit on the grid (`gravity.py`).

All particles of a run have one global order, the order in memory of a run on one process: by the cell at the last
sort, then by id; `global_index` is the index in it. Sums over own particles and ghosts follow it, so that each sum
has the same terms in the same order as on one rank.
"""
