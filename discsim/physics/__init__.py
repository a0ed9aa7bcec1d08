"""Physics as functions of a scene: equations of state, laws of the drag, profiles of discs, orbits."""
