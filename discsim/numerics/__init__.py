"""How it is computed: particles, threads, neighbours, grids, gravity, sums over particles. No scene decides here."""
