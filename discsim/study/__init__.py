"""What accuracy costs: errors against exact solutions, and tables of runs."""
