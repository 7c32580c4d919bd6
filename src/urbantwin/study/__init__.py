"""Studies with one motion under many rigs: what differs, and how sure that is."""
