"""Physics as functions of a scene: equations of state, drag laws, profiles of discs, orbits."""
