"""Runs on several MPI ranks, with the same bits as on one rank.

This package is imported only if a launcher started several processes. Each rank owns the particles in some tiles of
space (`division.py`), its local particles; effects process only these. Sums over neighbours also need ghosts, copies of
particles of other ranks (`exchange.py`). Ghosts are fetched as whole cells for SPH (`sph.py`) and for drag in cells
(`drag.py`), and by grid nodes for self-gravity (`gravity.py`).

All particles of a run have a global order: the order that they would have in memory on one rank, by cell at the last
sort and then by id. The key of a particle in this order is its `global_index`. Sums over local particles and ghosts
follow the global order, so that each sum has the same terms in the same order as on one rank.
"""
