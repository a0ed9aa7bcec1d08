"""A scene in motion: the step loop, and a run with its directory, progress and costs."""
