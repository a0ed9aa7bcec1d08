"""Fields of a snapshot by name: each is a function with its unit, label and equation; `discsim/parts.py` lists them."""
