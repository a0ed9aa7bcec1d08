"""What is computed: equations of state, laws of the drag, profiles of discs, as functions of a scene."""
