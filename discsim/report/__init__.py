"""A run as one page of HTML that holds all it shows: `discsim report`."""
