"""What a scene will be, before it runs: derived numbers, warnings, forecast; and the reference of keys."""
