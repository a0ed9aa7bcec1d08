"""Fields of a snapshot, such as "gas.v_r": functions with unit, label and equation, listed in `discsim/parts.py`."""
