"""Fields of a snapshot by name. Each is a function with unit, label and equation, registered in `discsim/parts.py`."""
